"""Batches in C: states one by one or several at once in SIMD lanes, on several threads if this is faster."""

from __future__ import annotations

import math
import os
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import CompileError, NoCompilerError
from ..files.build import build_apart
from ..warning import warn
from .functions import BESIDE, Function
from .threads import batch_threads, processors

STRIDED = """
typedef struct {{ {0} *at; long state, direction, entry; }} strided;
typedef struct {{ long count, directions, failed; int code, infinite, *codes; strided {1}; {0} *work; }} states;
"""
"""The C structs of the functions that compute several states at once."""

WORTH_COMPILING = 2048
"""Number of states of batches, times directions, after which functions for several states at once are compiled."""

LEAST_STATES = 64
"""Smallest number of states per thread."""

IN_LANES, ALONE, PER_STATE = 0.05, 0.1, 50
"""Estimated ns of an addition in SIMD lanes, of an addition for a single state, and of the call for each state."""

MATRICES = ("J_q", "J_u", "J_p", "J_inputs", "J_t", "M", "inverse_M")
"""Results that are matrices, whose columns are computed as directions."""

WEIGHTS = {"additions": 1, "multiplications": 1, "divisions": 4, "functions": 30}
"""Cost of each kind of operation, in units of an addition."""

EVEN = 8
"""The largest number of SIMD lanes. The numbers of states in the parts of a batch are multiples of this number."""

MOST_SWEPT = 48_000
"""If the sweeps over directions use more doubles than this for one state, several states at once exceed the cache of a core
and are slower than one after another."""

MOST_IN_LANES = 8_000_000
"""If several states at once need more doubles of workspace than this, they are no faster than one after another."""

MOST_COPIED = 4096
"""Largest batch, in states times (1 + directions), whose arguments are copied in order to compute one state after
another."""

MOST_KEPT = 1_000_000
"""Largest workspace, in numbers, that is kept between batches."""

Failed = dict[int, int]
"""Indices of the states of a batch that failed, with their error codes from C."""

_pools: dict[int, ThreadPoolExecutor] = {}
_pooling = threading.Lock()


def pool(threads: int) -> ThreadPoolExecutor:
    """A pool of `threads` threads, created at its first use."""
    with _pooling:
        if threads not in _pools:
            _pools[threads] = ThreadPoolExecutor(threads, "ordernm-batch")
        return _pools[threads]


def _begin_anew() -> None:
    """Replaces pools and lock after a fork, because the child process has no threads and the lock may be held."""
    global _pooling
    _pooling = threading.Lock()
    _pools.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)


def library_of_states(number: int) -> str:
    """Name of the library that computes several states at once, for the functions of the library of this number."""
    return "states" if number < 2 else f"states {number}"


class Batches:
    """Calls the functions over a batch of a compiled package.

    Parameters
    ----------
    target : CTarget
    folder : Path
        The folder of the package.
    manifest : dict
    """

    def __init__(self, target: Any, folder: Path, manifest: Mapping[str, Any], sealed: str = ""):
        self._sealed = sealed
        self._target, self._ffi, self._folder = target, target.ffi, folder
        self._model: str = manifest["name"]
        self._over_states: Mapping[str, Any] = manifest.get("over_states", {})
        self._functions, self._operations = manifest["functions"], manifest["operations"]
        over = self._over_states.get("functions", ())
        self._numbers = {
            f: x["number"] for x in manifest.get("libraries", {}).values() for f in x["functions"] if f in over
        }
        """The library of each function for several states at once."""
        self.quaternions = tuple(manifest["quaternions"])
        self._costs: dict[str, tuple[int, int]] = {}
        self._several: dict[str, Callable[[Any], int]] = {}
        self._libraries: dict[str, Any] = {}
        self._errors: dict[str, Exception] = {}
        self._seen: dict[int, int] = {}
        """Number of states of batches so far, times directions, by library."""
        self._work: list[Array] = []
        """Workspaces for several states at once that are free at present."""
        self._lock = threading.RLock()

    # -- parts of a batch ----------------------------------------------------------------------------------------------

    def threads(self, f: Function, count: int, k: int, in_lanes: bool) -> int:
        """Number of threads for a batch of `count` states of a function, along k directions."""
        wanted = self._target.threads
        if wanted is None:
            once, along = self._cost(f)
            operations = once + k * along
            wanted = batch_threads(count * (IN_LANES * operations if in_lanes else ALONE * operations + PER_STATE))
        return max(1, min(wanted, count // LEAST_STATES))

    def _cost(self, f: Function) -> tuple[int, int]:
        """Operations per state, and per direction, in units of additions. Columns of matrices are directions."""
        found = self._costs.get(f.name)
        if found is None:
            sweeps = self._functions[BESIDE.get(f.name, f.name)].get("sweeps", ())
            once, along = (
                sum(n * self._operations[s][part][kind] for s in sweeps for kind, n in WEIGHTS.items())
                for part in ("per_call", "per_direction")
            )
            columns = sum(shape[-1] for r, shape in zip(f.results, f.shapes, strict=True) if r in MATRICES)
            found = self._costs[f.name] = once + columns * along, along
        return found

    def run(self, part: Callable[[int, int], Failed], count: int, threads: int) -> Failed:
        """Computes all parts of a batch, one per thread, and returns the failed states in order."""
        size = max(-(-count // (threads * EVEN)), 1) * EVEN
        parts = [(start, min(start + size, count)) for start in range(0, count, size)]
        if len(parts) < 2:  # an empty batch has no parts
            return part(0, count)
        others = [pool(len(parts) - 1).submit(part, start, end) for start, end in parts[1:]]
        try:
            found = part(*parts[0])
        finally:  # wait for all threads, since they use the memory of this call
            rest = [f.result() for f in others]
        for of_part in rest:
            found |= of_part
        return found

    # -- several states at once ----------------------------------------------------------------------------------------

    def takes(self, f: Function, count: int, k: int = 0) -> bool:
        """Whether to compute several states at once; if enough states have been computed, the code for this is
        compiled."""
        if not self._in_lanes(f) or count < EVEN:
            return False
        number = self._numbers.get(f.name, 0)
        seen = self._seen[number] = self._seen.get(number, 0) + count * (1 + k)
        return (seen >= WORTH_COMPILING or library_of_states(number) in self._libraries) and self.opened(f) is not False

    def together(self, f: Function) -> tuple[Callable[[int, int], tuple[int, int, int] | None], Sequence[str], int]:
        """How ``direct_call.c`` computes a large batch of a function: a callable, the names of the arrays, and the size of the
        workspace. The callable returns the number of threads and the addresses of two C functions. Zeros mean one state
        after another; None means the general path."""
        over, in_lanes = self._over_states, self._in_lanes(f)
        this, symbol = weakref.proxy(self), self._symbol(f)

        def way(count: int, k: int) -> tuple[int, int, int] | None:
            threads = this.threads(f, count, k, in_lanes)
            if not in_lanes:
                return (1, 0, 0) if threads == 1 and count * (k + 1) <= MOST_COPIED else None
            call = this._several.get(symbol)
            if call is None:
                return None
            shared = this._shared() if threads > 1 else False
            address = this._address
            return (threads, address(call), address(shared)) if shared else (1, address(call), 0)

        return way, over.get("arrays", ()), over.get("workspace", 0)

    def _in_lanes(self, f: Function) -> bool:
        """Whether several states of a function may be computed at once."""
        return f.name in self._over_states.get("functions", ()) and not self._swept_far(f)

    def _address(self, function: Any) -> int:
        return int(self._ffi.cast("intptr_t", function))

    def _symbol(self, f: Function) -> str:
        return f"{self._model}_{f.name}_states"

    def _swept_far(self, f: Function) -> bool:
        """Whether several states at once would need too much memory to be faster."""
        over = self._over_states
        return bool(over["workspace"] > MOST_IN_LANES or (f.seeds and over["swept"] > MOST_SWEPT))

    def prepare(self) -> None:
        """Compiles the functions for several states at once and the function that distributes states over threads."""
        threads = self._target.threads or processors()
        opened = [self._opened(number) is not False for number in sorted({*self._numbers.values()})]
        if any(opened) and threads > 1:
            self._shared()

    def opened(self, f: Function) -> Any:
        """The library of ``NAME_states.c`` with a function; False if it is not available."""
        return self._opened(self._numbers.get(f.name, 0))

    def _opened(self, number: int) -> Any:
        declared = ""
        if not any(
            key.startswith("states") and made for key, made in self._libraries.items()
        ):  # cffi treats types declared twice as different
            declared = STRIDED.format(self._target.real, ", ".join(self._over_states["arrays"]))
        instead = "the states of a batch are computed one after another"
        return self._apart("states", declared, instead, number=number)

    def _shared(self) -> Any:
        """The C function that distributes states over threads; False if it is not available."""
        symbol = f"{self._model}_on_threads"
        declared = f"int {symbol}(int (*)(states *), states *, int);"
        # the library is never unloaded: its threads may outlive the solver
        instead = "" if self._target.threads is None else "batches are computed on one thread"
        library = self._apart("threads", declared, instead, self._ffi.RTLD_NODELETE)
        return library and getattr(library, symbol)

    def _apart(self, part: str, declared: str, instead: str, flags: int = 0, number: int = 0) -> Any:
        """The library of ``NAME_<part>.c``; False if it is not available. In this case a warning, once, names the
        slower code that is used."""
        key, ffi = library_of_states(number) if part == "states" else part, self._ffi
        with self._lock:
            if key not in self._libraries:
                try:
                    path = build_apart(self._folder, self._model, part, self._sealed, number).library()
                    ffi.cdef(declared, override=True)
                    self._libraries[key] = ffi.dlopen(str(path), ffi.RTLD_NOW | flags)
                except (CompileError, NoCompilerError, OSError) as error:
                    self._libraries[key], self._errors[key] = False, error
            if instead and key in self._errors:
                warn(f"{self._model}: {instead}: {self._errors.pop(key)}")
            return self._libraries[key]

    def states(
        self,
        f: Function,
        given: Mapping[str, tuple[Any, int, int]],
        results: Sequence[Array],
        count: int,
        k: int,
        all_codes: bool,
    ) -> tuple[Failed, bool]:
        """Runs a function for several states at once; `given` are pointers, with strides between states and between directions.
        Results are NaN where something was singular.

        Returns
        -------
        failed : dict of int to int
            All states that fail, or only the first one.
        finite : bool
            Whether all arguments, seeds and results are finite.
        """
        ffi, target = self._ffi, self._target
        symbol = self._symbol(f)
        with self._lock:
            if symbol not in self._several:
                ffi.cdef(f"int {symbol}(states *);", override=True)
                self._several[symbol] = getattr(self.opened(f), symbol)
            call = self._several[symbol]
        arrays = dict(given)
        for r, name, shape in zip(results, f.results, f.shapes, strict=True):
            n = math.prod(shape)
            arrays[name] = target.pointer(r), n, count * n

        threads = self.threads(f, count, k, True)
        shared: Any = self._shared() if threads > 1 else False
        size = self._over_states["workspace"] * (threads if shared else 1)
        try:
            work = self._work.pop()
        except IndexError:
            work = np.empty(0, target.dtype)
        if work.size < size:
            work = np.empty(size, target.dtype)
        b = ffi.new("states *", {"count": count, "directions": k, "work": target.pointer(work)})
        if all_codes:
            codes = np.empty(count, np.intc)
            b.codes = ffi.from_buffer("int[]", codes)
        for name, (at, state, direction) in arrays.items():
            setattr(b, name, (at, state, direction, 1))
        code = shared(call, b, threads) if shared else call(b)
        if work.size <= MOST_KEPT:
            self._work.append(work)
        failed: Failed = {}
        if code:
            failed = {int(i): int(codes[i]) for i in np.flatnonzero(codes)} if all_codes else {b.failed: code}
        return failed, not b.infinite


__all__ = ["Batches", "Failed"]
