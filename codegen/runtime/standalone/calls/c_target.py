"""Calls the compiled functions of a package through cffi."""

from __future__ import annotations

import math
import threading
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import C_TYPES, Array, Shape, filled
from ..errors import (
    CompileError,
    NoCompilerError,
    SingularForceError,
    SingularJointError,
    SingularLoopError,
    SingularOutputError,
    singular_forces,
)
from ..files.build import Build, builds
from ..files.compiler import find_compiler
from ..warning import warn
from .batches import Batches, Failed
from .caller import DIRECT, find_caller
from .functions import BESIDE, Function, names_of
from .single_calls import SLOT, Calls
from .task import Target, Task

CHECKED = 1 << SLOT["default_p"]
"""Flag of functions in ``NAME_calls.c``: C does not test numbers, because Python tests arguments and results."""

OVER = """
int {0}(int (*)({1} *const *, long, double, long), {1} **, long (*)[2], long, long, const double *, long, long *, long);
"""
"""C signature of the loop over the states of a batch. Its arguments are a function, pointers, strides, a mask, times,
the number of directions, and the first and last state."""


MOST_RESULTS = 16
"""Maximum number of results of a function; the same as in ``direct_call.h``."""


@dataclass(slots=True)
class Table:
    """A table of pointers for the calls of one thread, with the memory to which it points."""

    x: Any
    work: Any
    lanes: Any = None
    lanes_size: int = 0


class CTarget(Target):
    """Calls the compiled functions of a package through cffi, which releases the GIL.

    Parameters
    ----------
    folder : Path
    manifest : mapping
        The manifest of the partition.
    functions : mapping of str to Function
    shapes : mapping of str to Shape
    sealed : str
        The seal of the package's manifest.
    first : bool
        Whether this is the first partition. Libraries of other partitions are compiled at the first call.

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
        sealed: str = "",
        first: bool = True,
    ):
        try:
            from cffi import FFI
        except ImportError:
            raise NoCompilerError("cffi is not installed, and the C target needs it: pip install cffi") from None
        super().__init__(manifest)
        self.ffi = FFI()
        self.model: str = manifest["name"]
        self.links: list[str] = manifest["links"]
        self.loops: list[str] = manifest.get("loops", [])
        self.singular_forces = singular_forces(manifest)
        self.outputs: list[str] = manifest["output_names"]
        self.workspace: int = manifest["workspace"]
        self.functions = functions
        self.shapes = shapes
        self.names = names_of(manifest)
        self.real = C_TYPES[self.dtype.char]
        """The C type of a package's numbers."""
        self.defaults = np.array(manifest["parameters"], self.dtype), self.zeros(len(manifest["input_names"]))
        self.builds = builds(folder, manifest, sealed)
        parts = manifest.get("libraries", {})
        self._part_of = {f: part for part, x in parts.items() for f in x["functions"]}
        if not first:  # only motions use other partitions, whose functions are therefore compiled as one library
            self._part_of |= {f: part for part, x in parts.items() for f in x.get("too", ())}
        self._over_few: Mapping[str, Sequence[int]] = parts.get("few", {}).get("over_few", {})
        self._of_few = [f"{self.model}_{f}_{w}" for f, widths in self._over_few.items() for w in widths]
        self._few = self.ffi.new("void *[]", len(self._of_few) + 1)
        """Memory to which ``x[FEW]`` in ``NAME_calls.c`` points: a flag, set if the functions for few directions are
        unavailable, then the addresses of these functions."""
        self.few_pointer = self.ffi.cast(f"{self.real} *", self._few)
        self._libraries: dict[str, Any] = {}
        self._kept: list[Any] = []
        self._opening = threading.Lock()
        if len(self.builds) == 1 or self.builds[""].found() is not None:
            self._part_of, self._over_few = {}, {}
        if first or not self._part_of:
            self._library(next(iter(parts)) if self._part_of else "")
        elif not any(build.found() for build in self.builds.values()):
            find_compiler()  # raises now, while NumPy can still be used instead
        caller = find_caller(folder) if self.dtype.char in DIRECT else None
        self.mode = "abi" if caller is None else "api"
        self._numbers, self._doubles, self._longs = map(self.ffi.typeof, (f"{self.real}[]", "double[]", "long[]"))
        self._number, self._pairs = map(self.ffi.typeof, (f"{self.real} *", "long[][2]"))
        self._calls: dict[str, Any] = {}
        self.batches = Batches(weakref.proxy(self), folder, manifest, sealed)
        self._addresses: dict[str, int] = {}
        self._lock = threading.Lock()
        self._blank = [self.ffi.NULL] * SLOT["default_p"]
        self.default_pointers = [self.pointer(a) for a in self.defaults]
        self._tables: list[Table] = []
        self.calls = Calls(weakref.proxy(self), caller)

    def _library(self, part: str) -> Any:
        """A library of the package, compiled at the first use."""
        library = self._libraries.get(part)
        if library is None:
            with self._opening:
                if part not in self._libraries:
                    self._libraries[part] = self._open(self.builds[part])
                library = self._libraries[part]
        return library

    def library_of(self, function: str, width: int = 0) -> Any:
        """The library of a function; `width` is the number of directions at once."""
        if width in self._over_few.get(function, ()):
            return self._library("few")
        return self._library(self._part_of.get(function, ""))

    def give_few(self) -> None:
        """Opens the library of functions for few directions at their first call; warns if it is not available."""
        try:
            few = self._library("few")
        except (CompileError, NoCompilerError) as error:
            warn(f"{self.model}: one or two directions take as long as eight: {error}")
            self._few[0] = self._few
            return
        with self._lock:
            for i, symbol in reversed(
                [*enumerate(self._of_few, 1)]
            ):  # the first address is set last, because the C code tests only this address
                self.ffi.cdef(f"int {symbol}(void);", override=True)
                self._few[i] = self.ffi.cast("void *", getattr(few, symbol))

    def prepare(self, f: Function) -> None:
        """Compiles everything that calls of a function need."""
        self.function(f)
        if f.name in self._over_few and not self._few[0] and not self._few[1]:
            self.give_few()

    def _open(self, build: Build) -> Any:
        path = build.library()
        try:
            return self._opened(path)
        except OSError:  # the library is damaged, or from another machine
            path = build.library(rebuild=True)
        try:
            return self._opened(path)
        except OSError as error:
            raise CompileError(f"{path} was compiled but cannot be opened: {error}") from None

    def _opened(self, path: Path) -> Any:
        try:
            return self.ffi.dlopen(str(path))
        except UnicodeEncodeError:  # a path that the user's locale cannot encode; cffi accepts text only
            import ctypes

            self._kept.append(ctypes.CDLL(str(path)))
            return self.ffi.dlopen(self.ffi.cast("void *", self._kept[-1]._handle))

    def zeros(self, shape: int | Shape) -> Array:
        return np.zeros(shape, self.dtype)

    def plain(self, x: Any) -> Array:
        """A contiguous array of the C type."""
        return np.ascontiguousarray(x, self.dtype)

    def pointer(self, x: Array | None) -> Any:
        """Pointer to an array, which it keeps alive; NULL for a result that is not requested."""
        return self.ffi.NULL if x is None else self.ffi.from_buffer(self._numbers, x)

    def motion_system(self) -> int:
        """The address of the model's ``ordernm_system``, which describes the model to the integrators."""
        symbol = f"{self.model}_motion"
        if symbol in self._addresses:
            return self._addresses[symbol]
        library = self.library_of("state_rates")
        with self._lock:
            if symbol not in self._addresses:
                self.ffi.cdef(f"void *{symbol}(void);", override=True)
                self._addresses[symbol] = int(self.ffi.cast("intptr_t", getattr(library, symbol)()))
            return self._addresses[symbol]

    def run_backwards(self, system: Any) -> None:
        """Adds the functions for adjoint integration to an ``ordernm_system``, if they are in a separate library."""
        if "sensitivities_transposed" not in self._part_of:
            return
        symbol = f"{self.model}_backwards"
        give = self._calls.get(symbol)
        if give is None:
            library = self.library_of("sensitivities_transposed")
            with self._lock:
                self.ffi.cdef(f"void {symbol}(void *);", override=True)
                give = self._calls[symbol] = getattr(library, symbol)
        give(self.ffi.cast("void *", system))

    def function(self, f: Function) -> Any:
        """The C function, with the signature that all functions share. It is declared at its first call, so that
        loading is fast."""
        call = self._calls.get(f.name)
        if call is None:
            symbol = f"{self.model}_call_{f.name}"
            library = self.library_of_call(f)
            with self._lock:
                self.ffi.cdef(f"int {symbol}({self.real} *const *, long, double, long);", override=True)
                call = self._calls[f.name] = getattr(library, symbol)
        return call

    def library_of_call(self, f: Function) -> Any:
        """The library that contains the call of a function."""
        return self.library_of(BESIDE.get(f.name, f.name))

    def pointers(self, given: Mapping[int, Any], work: Any, lanes: Any, results: Sequence[Any]) -> Any:
        """The table of pointers for a call; `given` contains pointers to arguments and seeds, by slot."""
        x = self.ffi.new(
            f"{self.real} *[]",
            [
                *self._blank,
                *self.default_pointers,
                work,
                lanes,
                self.few_pointer,
                self.ffi.NULL,
                self.ffi.NULL,
                *map(self.pointer, results),
            ],
        )
        for slot, pointer in given.items():
            x[slot] = pointer
        return x

    # -- any number of states ------------------------------------------------------------------------------------------

    def run(self, task: Task) -> bool:
        f, of, k, batch = task.f, task.seeds.of, task.seeds.k, task.batch
        given = {a: self._row(task.arrays[a], batch) for a in f.arguments if a != "t"}
        given |= {s: self._rows(of[s], k, batch, task.states) for s in f.seeds if s in of}
        if batch and self.batches.takes(f, task.states, k):
            if "t" in f.arguments:
                t = np.asarray(task.arrays["t"], self.dtype)
                given["t"] = self._whole(t, t.shape and batch), min(t.ndim, 1), 0
            task.look(but=given)
            found, finite = self.batches.states(f, given, task.out, task.states, k, task.failed is not None)
            if not finite:
                task.look()
        else:
            task.look()
            found, finite = self._one_by_one(task, given), False
        if found and task.failed is None:
            number = min(found)
            raise self.singular(found[number], f" (state {list(task.place(number))} of the batch)" if batch else "")
        if found and task.failed is not None:
            task.failed.update({number: self.singular(code) for number, code in found.items()})
            task.spoil(task.out, f.derived, found)
        return finite

    def _one_by_one(self, task: Task, given: Mapping[str, tuple[Any, int, int]]) -> Failed:
        """Computes one state after another, up to the first failure or through the whole batch; returns the failed states.

        `given` are pointers to arguments and seeds, with strides between states and between directions.
        """
        f, k, count, first = task.f, task.seeds.k, task.states, SLOT["results"]
        if k % max(f.widths, default=1) in self._over_few.get(f.name, ()):
            self.prepare(f)
        over, call, null = self._over(f), self.function(f), self.ffi.NULL
        times, steps = null, null
        if "t" in f.arguments:
            times = self.ffi.from_buffer(self._doubles, filled(task.batch or (1,), task.arrays["t"]))
        sizes = [math.prod(shape) for shape in f.shapes]
        if f.seeds:
            steps = self.ffi.new(self._longs, [0] * first + [count * n for n in sizes])
            for name, (_, _, direction) in given.items():
                steps[SLOT[name]] = direction
        x = {SLOT[n]: (at, state) for n, (at, state, _) in given.items()}
        bits = CHECKED | sum([1 << i for i in x])
        x |= {first + i: (self.pointer(r), n) for i, (r, n) in enumerate(zip(task.out, sizes, strict=True))}
        moves = [(i, step) for i, (at, step) in x.items() if step and at]
        moving = self.ffi.new(self._pairs, moves)

        def part(start: int, end: int) -> Failed:
            failed: Failed = {}
            table = self._table(f)
            for i, (at, step) in x.items():
                table.x[i] = at + start * step if start and at else at
            table.x[SLOT["steps"]] = self.ffi.cast(self._number, steps)
            ended = self.ffi.new(self._longs, [start])
            while ended[0] < end and not (failed and task.failed is None):
                status = over(call, table.x, moving, len(moves), bits, times, k, ended, end)
                if status:
                    failed[ended[0] - 1] = status
            self._tables.append(table)
            return failed

        return self.batches.run(part, count, self.batches.threads(f, count, k, False))

    def _table(self, f: Function) -> Table:
        """A table of pointers with memory for a function, which no other call uses at present."""
        try:
            table = self._tables.pop()
        except IndexError:
            work = self.pointer(np.empty(self.workspace, self.dtype))
            table = Table(self.pointers({}, work, self.ffi.NULL, [None] * MOST_RESULTS), work)
        if f.widths and table.lanes_size < (size := f.per_direction * max(f.widths)):
            table.lanes, table.lanes_size = self.pointer(np.empty(size, self.dtype)), size
            table.x[SLOT["lanes"]] = table.lanes
        return table

    def _over(self, f: Function) -> Any:
        """The C function that loops over states and calls a given function."""
        over = self._calls.get(f"over {f.name}")
        if over is None:
            symbol, library = f"{self.model}_over", self.library_of_call(f)
            with self._lock:
                self.ffi.cdef(OVER.format(symbol, self.real), override=True)
                over = self._calls[f"over {f.name}"] = getattr(library, symbol)
        return over

    def singular(self, status: int, where: str = "") -> SingularJointError:
        """The error for the status that a compiled function returned."""
        links, loops, forces = len(self.links), len(self.loops), len(self.singular_forces)
        if status > links + loops + forces:
            return SingularOutputError(self.outputs[status - 1 - links - loops - forces], where)
        if status > links + loops:
            return SingularForceError(*self.singular_forces[status - 1 - links - loops], where)
        if status > links:
            loop = self.loops[status - 1 - links]
            return SingularLoopError(loop, where, loop in self.couplings)
        return SingularJointError(self.links[status - 1], where)

    def _whole(self, x: Array, shape: Shape) -> Any:
        """Pointer to an array, broadcast to `shape` if necessary."""
        return self.pointer(self.plain(x if x.shape == shape else np.broadcast_to(x, shape)))

    def _row(self, x: Array, batch: Shape) -> tuple[Any, int, int]:
        """Pointer to an argument, its stride between states, and the stride 0 between directions."""
        n = x.shape[-1]
        return (self._whole(x, x.shape), 0, 0) if x.ndim == 1 else (self._whole(x, (*batch, n)), n, 0)

    def _rows(self, seed: Array, k: int, batch: Shape, count: int) -> tuple[Any, int, int]:
        """Pointer to a seed, and its strides between states and between directions."""
        n = seed.shape[-1]
        if seed.size == len(seed) * n:  # all states share the seed
            return self.pointer(self.plain(seed)), 0, n if len(seed) == k else 0
        return self._whole(seed, (k, *batch, n)), n, count * n
