"""The compiled functions of a package, called through cffi."""

from __future__ import annotations

import math
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .arrays import Array, Shape
from .build import Build
from .caller import TAKES, find_caller
from .errors import (
    CompileError,
    NoCompilerError,
    SingularForceError,
    SingularJointError,
    SingularLoopError,
    SingularOutputError,
    singular_forces,
)
from .functions import ARGUMENTS, SEEDS, Function, split
from .results import empty
from .short_calls import ARRAY_HEAD, Desk

SLOT = {n: i for i, n in enumerate((*ARGUMENTS, *SEEDS, "default_p", "default_inputs", "work", "lanes", "results"))}
"""Places in the table of pointers that the functions of ``NAME_calls.c`` take."""


BATCH = """
typedef struct {{ double *at; long step; }} rows;
typedef struct {{ long count, failed; rows {}; double *work; }} batch;
"""
"""The struct that functions over a batch work on, as the package's header declares it."""


class CTarget:
    """The compiled functions of a package, called through cffi, which releases the GIL.

    Raises
    ------
    NoCompilerError, CompileError
    """

    name = "c"

    def __init__(
        self,
        folder: Path,
        manifest: Mapping[str, Any],
        functions: Mapping[str, Function],
        shapes: Mapping[str, Shape],
    ):
        try:
            from cffi import FFI
        except ImportError:
            raise NoCompilerError("cffi is not installed, and the C target needs it: pip install cffi") from None
        self.ffi = FFI()
        self.model: str = manifest["name"]
        self.links: list[str] = manifest["links"]
        self.loops: list[str] = manifest.get("loops", [])
        self.singular_forces = singular_forces(manifest)
        self.outputs: list[str] = manifest["output_names"]
        self.workspace: int = manifest["workspace"]
        self.functions = functions
        self.shapes = shapes
        self.defaults = np.array(manifest["parameters"], float), np.zeros(len(manifest["input_names"]))
        self.build = Build(folder, self.model, manifest.get("sources", ()))
        self.library = self._open()
        caller = find_caller(folder)
        self.mode = "abi" if caller is None else "api"
        self._caller = caller
        self.ffi.cdef(ARRAY_HEAD)
        self._doubles = self.ffi.typeof("double[]")
        self._calls: dict[str, Any] = {}
        self._batches: dict[tuple[str, int], Callable[[Any], int]] = {}
        self._batch_arrays: list[str] = manifest["batch"]
        self._addresses: dict[str, int] = {}
        self._lock = threading.Lock()
        self._zeros = self.pointer(np.zeros(8))
        self.desk = Desk(weakref.proxy(self))

    def _open(self) -> Any:
        path = self.build.library()
        try:
            return self._opened(path)
        except OSError:  # damaged, or of another machine
            path = self.build.library(rebuild=True)
        try:
            return self._opened(path)
        except OSError as error:
            raise CompileError(f"{path} was compiled but cannot be opened: {error}") from None

    def _opened(self, path: Path) -> Any:
        try:
            return self.ffi.dlopen(str(path))
        except UnicodeEncodeError:  # a name that is no text in the user's locale: cffi takes texts only
            import ctypes

            self._ctypes_library = ctypes.CDLL(str(path))
            return self.ffi.dlopen(self.ffi.cast("void *", self._ctypes_library._handle))

    def pointer(self, x: Array) -> Any:
        """Where an array begins; keeps it alive."""
        return self.ffi.from_buffer(self._doubles, x)

    def address(self, symbol: str) -> int:
        """What a function of the library without arguments returns: the address of a struct."""
        with self._lock:
            if symbol not in self._addresses:
                self.ffi.cdef(f"void *{symbol}(void);", override=True)
                self._addresses[symbol] = int(self.ffi.cast("intptr_t", getattr(self.library, symbol)()))
            return self._addresses[symbol]

    def _function(self, f: Function) -> Any:
        """The C function with the one signature of all; declared when first called, which keeps loading quick."""
        call = self._calls.get(f.name)
        if call is None:
            symbol = f"{self.model}_call_{f.name}"
            with self._lock:
                self.ffi.cdef(f"int {symbol}(double **, long, double, long);", override=True)
                call = self._calls[f.name] = getattr(self.library, symbol)
        return call

    def take(self, kind: str, f: Function, desk: Any) -> Callable[..., int]:
        """What calls a function with arrays' objects: the desk, ``id`` of each, 0 for what is left out."""
        symbol = f"{self.model}_take_{kind}"
        desk.function = self.ffi.cast("void *", self._function(f))
        with self._lock:
            self.ffi.cdef(f"int {symbol}(void *, {TAKES[kind]});", override=True)
            take: Callable[..., int] = getattr(self.library, symbol)
        desk.take = self.ffi.cast("void *", take)
        return take if self._caller is None else getattr(self._caller, f"ordernm_{kind}")

    def _batch_function(self, f: Function, width: int) -> Callable[[Any], int]:
        """The C function that loops over a batch."""
        call = self._batches.get((f.name, width))
        if call is None:
            symbol = f"{self.model}_{f.name}" + (f"_{width}" if width else "") + "_batch"
            with self._lock:
                if not self._batches:
                    self.ffi.cdef(BATCH.format(", ".join(self._batch_arrays)), override=True)
                self.ffi.cdef(f"int {symbol}(batch *);", override=True)
                call = self._batches[f.name, width] = getattr(self.library, symbol)
        return call

    def _nothing(self, size: int) -> Any:
        """So many zeros: a seed that was left out."""
        zeros = self._zeros  # another thread may put shorter ones there meanwhile
        if len(zeros) < size:
            zeros = self._zeros = self.pointer(np.zeros(size))
        return zeros

    # -- one state -----------------------------------------------------------------------------------------------------

    def table(self, f: Function, given: Mapping[str, Array], results: Sequence[Array], work: Any) -> tuple[Any, Any]:
        """The pointers of a call, and what must live as long as they."""
        derived = sum(math.prod(s) for s, d in zip(f.shapes, f.derived, strict=True) if d)
        lanes = np.empty((sum(f.seeds.values()) + derived) * max(f.widths, default=0))  # of the widest call
        pointers = {n: self.pointer(a) for n, a in given.items()}
        pointers |= {n: self.pointer(a) for n, a in zip(("default_p", "default_inputs"), self.defaults, strict=True)}
        pointers |= {"work": work, "lanes": self.pointer(lanes)}
        x = self.ffi.new("double *[]", SLOT["results"] + len(results))
        for name, pointer in pointers.items():
            x[SLOT[name]] = pointer
        of_results = [self.pointer(r) for r in results]
        for i, pointer in enumerate(of_results):
            x[SLOT["results"] + i] = pointer
        return x, (pointers, of_results)

    def _single(
        self, f: Function, arrays: Mapping[str, Any], seeds: Mapping[str, Array], k: int, results: Sequence[Array]
    ) -> None:
        """Compute the results of one state, directions as rows."""
        given = {n: a for n, a in arrays.items() if n in SLOT}
        given |= {s: np.ascontiguousarray(a) for s, a in seeds.items() if s in f.seeds}
        x, kept = self.table(f, given, results, self.desk.work)
        bits = sum(1 << SLOT[n] for n in given)
        status = self._function(f)(x, bits, arrays.get("t", 0.0), k)
        del kept
        if status > 0:
            raise self.singular(status)

    # -- any number of states ------------------------------------------------------------------------------------------

    def values(self, f: Function, arrays: Mapping[str, Any], batch: Shape, out: Sequence[Array] = ()) -> list[Array]:
        """Results (*batch, *shape) of a function without directions, in `out` if there is one.

        `arrays` hold (..., n), with leading axes that broadcast to the batch; ``t`` is a float or (...).
        """
        results = list(out) or [empty(shape) for shape in f.whole_shapes(batch)]
        if batch:
            self.run_batch(f, 0, [self._row(arrays[a], batch, a == "t") for a in f.arguments], results, batch)
        else:
            self._single(f, arrays, {}, 0, results)
        return results

    def singular(self, status: int, where: str = "") -> SingularJointError:
        """The error for what a compiled function has returned."""
        links, loops, forces = len(self.links), len(self.loops), len(self.singular_forces)
        if status > links + loops + forces:
            return SingularOutputError(self.outputs[status - 1 - links - loops - forces], where)
        if status > links + loops:
            return SingularForceError(*self.singular_forces[status - 1 - links - loops], where)
        if status > links:
            return SingularLoopError(self.loops[status - 1 - links], where)
        return SingularJointError(self.links[status - 1], where)

    def along(
        self,
        f: Function,
        arrays: Mapping[str, Any],
        seeds: Mapping[str, Array],
        k: int,
        batch: Shape,
        out: Sequence[Array] = (),
    ) -> list[Array]:
        """Results of a function over directions: (*batch, *shape), derivatives (k, *batch, *shape), in `out` if there is one.

        `seeds` hold (k, ..., n) with as many batch axes as the batch, ``dt`` (k, ..., 1); missing ones are zero.
        """
        results = list(out) or [empty(shape) for shape in f.whole_shapes(batch, k)]
        if not batch:
            self._single(f, arrays, seeds, k, results)
            return results
        count = math.prod(batch)
        arguments = [self._row(arrays[a], batch, a == "t") for a in f.arguments]
        start = 0
        for width in split(k, f.widths) or [min(f.widths)]:  # without directions there are values still
            end = min(start + width, k)
            given = list(arguments)
            for s, n in f.seeds.items():
                if s in seeds:
                    given.append(self._lanes(seeds[s][start:end], width, batch, count))
                else:
                    given.append((self._nothing(n * width), 0))
            taken: list[Array] = []
            lanes: list[tuple[Array, Array]] = []
            for result, shape, derived in zip(results, f.shapes, f.derived, strict=True):
                if derived and (width > 1 or start == end):
                    taken.append(empty((count, math.prod(shape), width)))
                    lanes.append((taken[-1], result[start:end]))
                else:
                    taken.append(result[start] if derived else result)
            self.run_batch(f, width, given, taken, batch)
            for lane, part in lanes:
                part[...] = np.moveaxis(lane[..., : end - start], -1, 0).reshape(part.shape)
            start = end
        return results

    def run_batch(
        self, f: Function, width: int, given: Sequence[tuple[Any, int]], results: Sequence[Array], batch: Shape
    ) -> None:
        """Run over the states of a batch, in C; given are pointers and their steps from state to state, in doubles."""
        count = math.prod(batch)
        call = self._batch_function(f, width)
        b = self.ffi.new("batch *", {"count": count, "work": self.desk.work})
        sizes = [math.prod(s) * (width if d and width else 1) for s, d in zip(f.shapes, f.derived, strict=True)]
        taken = [(self.pointer(r), n) for r, n in zip(results, sizes, strict=True)]
        for name, rows in zip((*f.arguments, *f.seeds, *f.results), (*given, *taken), strict=True):
            setattr(b, name, rows)
        status = call(b)
        if status:
            state = ", ".join(str(int(j)) for j in np.unravel_index(b.failed, batch))
            raise self.singular(status, f" (state [{state}] of the batch)")

    def _row(self, x: Any, batch: Shape, scalar: bool) -> tuple[Any, int]:
        """Where an argument begins, and its step from state to state."""
        if scalar:
            if isinstance(x, float):
                return self.pointer(np.array([x])), 0
            return self.pointer(np.ascontiguousarray(np.broadcast_to(x, batch))), 1
        if x.ndim == 1:
            return self.pointer(x), 0
        n = x.shape[-1]
        return self.pointer(np.ascontiguousarray(np.broadcast_to(x, (*batch, n)))), n

    def _lanes(self, part: Array, width: int, batch: Shape, count: int) -> tuple[Any, int]:
        """Some directions of a seed, direction last, and the step; lanes beyond its end are zero."""
        m, n = len(part), part.shape[-1]
        if part.size == m * n:  # the same for all states
            if width == m == 1:
                return self.pointer(np.ascontiguousarray(part)), 0
            lanes = np.zeros((n, width))
            lanes[:, :m] = part.reshape(m, n).T
            return self.pointer(lanes), 0
        lanes = np.zeros((count, n, width))
        lanes[..., :m] = np.moveaxis(np.broadcast_to(part, (m, *batch, n)).reshape(m, count, n), 0, -1)
        return self.pointer(lanes), n * width
