"""Batches in C: states one after the other, or several at once in the lanes of vectors; on several threads, where it pays."""

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
"""The struct that functions over several states at once work on."""

WORTH_COMPILING = 2048
"""So many states of batches, those along directions too, and the functions over several at once are compiled."""

LEAST_STATES = 64
"""A thread gets at least as many."""

IN_LANES, ALONE, PER_STATE = 0.05, 0.1, 50
"""Nanoseconds, about: of an addition with several states in the lanes of vectors, of one with states one after the other, and of
the call of each of these states besides."""

MATRICES = ("J_q", "J_u", "J_p", "J_inputs", "J_t", "M", "inverse_M")
"""Results that are computed as directions, one for each column."""

WEIGHTS = {"additions": 1, "multiplications": 1, "divisions": 4, "functions": 30}
"""In additions."""

EVEN = 8
"""Parts of a batch are multiples of as many states as vectors hold at most."""

MOST_SWEPT = 48_000
"""Doubles that sweeps along directions go over for one state, up to which several states at once are faster: with more they
are beyond the caches of a core, where those of one state still are within."""

MOST_IN_LANES = 8_000_000
"""Doubles of memory of several states at once; with more they gain nothing over one after the other."""

MOST_KEPT = 1_000_000
"""Numbers of memory that is kept from one batch to the next."""

Failed = dict[int, int]
"""Numbers of states of a batch, and what was singular there, as the C says it."""

_pools: dict[int, ThreadPoolExecutor] = {}
_pooling = threading.Lock()


def pool(threads: int) -> ThreadPoolExecutor:
    """A pool of that many threads, which is kept."""
    with _pooling:
        if threads not in _pools:
            _pools[threads] = ThreadPoolExecutor(threads, "ordernm-batch")
        return _pools[threads]


def _begin_anew() -> None:
    """A process that was forked has none of the threads, and the lock may have been held."""
    global _pooling
    _pooling = threading.Lock()
    _pools.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)


class Batches:
    """Calls the functions over a batch of a compiled package.

    Parameters
    ----------
    target : CTarget
    folder : Path
        The package.
    manifest : dict
    """

    def __init__(self, target: Any, folder: Path, manifest: Mapping[str, Any], sealed: str = ""):
        self._sealed = sealed
        self._target, self._ffi, self._folder = target, target.ffi, folder
        self._model: str = manifest["name"]
        self._over_states: Mapping[str, Any] = manifest.get("over_states", {})
        self._functions, self._operations = manifest["functions"], manifest["operations"]
        self._quaternions: bool = bool(manifest["quaternions"])  # whose lengths are checked in Python
        self._costs: dict[str, tuple[int, int]] = {}
        self._several: dict[str, Callable[[Any], int]] = {}
        self._libraries: dict[str, Any] = {}
        self._errors: dict[str, Exception] = {}
        self._seen = 0
        self._work: list[Array] = []
        """Workspaces of several states at once that no call uses."""
        self._lock = threading.RLock()

    # -- parts of a batch ----------------------------------------------------------------------------------------------

    def threads(self, f: Function, count: int, k: int, in_lanes: bool) -> int:
        """How many threads share a batch of a function, along k directions."""
        wanted = self._target.threads
        if wanted is None:
            once, along = self._cost(f)
            operations = once + k * along
            wanted = batch_threads(count * (IN_LANES * operations if in_lanes else ALONE * operations + PER_STATE))
        return max(1, min(wanted, count // LEAST_STATES))

    def _cost(self, f: Function) -> tuple[int, int]:
        """Operations of one state, and of each direction, in additions. The columns of matrices are directions."""
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
        """Work on all parts, one for each thread; what has failed, in the order of the states."""
        size = max(-(-count // (threads * EVEN)), 1) * EVEN
        parts = [(start, min(start + size, count)) for start in range(0, count, size)]
        if len(parts) < 2:  # none for no states
            return part(0, count)
        others = [pool(len(parts) - 1).submit(part, start, end) for start, end in parts[1:]]
        try:
            found = part(*parts[0])
        finally:  # their memory is to be there until all have ended
            rest = [f.result() for f in others]
        for of_part in rest:
            found |= of_part
        return found

    # -- several at once -----------------------------------------------------------------------------------------------

    def takes(self, f: Function, count: int, k: int = 0) -> bool:
        """Whether to work on several states of so many at once; what that needs is compiled when it has become worth it."""
        if f.name not in self._over_states.get("functions", ()) or count < EVEN:
            return False
        if self._swept_far(f):
            return False
        self._seen += count * (1 + k)
        return ("states" in self._libraries or self._seen >= WORTH_COMPILING) and self._opened() is not False

    def together(
        self, f: Function
    ) -> tuple[Callable[[int, int], tuple[int, int, int] | None] | None, Sequence[str], int]:
        """What a call of ``direct_call.c`` does with large batches of a function: None, or what it asks for their numbers of
        threads and addresses of C functions; the arrays of several states at once; and their workspace."""
        over = self._over_states
        if f.name not in over.get("functions", ()) or self._swept_far(f) or self._quaternions:
            return None, (), 0
        this, symbol = weakref.proxy(self), self._symbol(f)

        def way(count: int, k: int) -> tuple[int, int, int] | None:
            call = this._several.get(symbol)
            if call is None:
                return None
            threads = this.threads(f, count, k, True)
            shared = this._shared() if threads > 1 else False
            address = this._address
            return (threads, address(call), address(shared)) if shared else (1, address(call), 0)

        return way, over["arrays"], over["workspace"]

    def _address(self, function: Any) -> int:
        return int(self._ffi.cast("intptr_t", function))

    def _symbol(self, f: Function) -> str:
        return f"{self._model}_{f.name}_states"

    def _swept_far(self, f: Function) -> bool:
        """Whether several states at once take more memory than they gain time."""
        over = self._over_states
        return bool(over["workspace"] > MOST_IN_LANES or (f.seeds and over["swept"] > MOST_SWEPT))

    def prepare(self) -> None:
        """Compile the functions over several states at once, and what shares them among threads, where there are any."""
        threads = self._target.threads or processors()
        if self._over_states and self._opened() is not False and threads > 1:
            self._shared()

    def _opened(self) -> Any:
        """The library of ``NAME_states.c``; False where it cannot be had."""
        declared = STRIDED.format(self._target.real, ", ".join(self._over_states["arrays"]))
        return self._apart("states", declared, "states of batches are worked on one after the other")

    def _shared(self) -> Any:
        """The C function that shares a batch over states among threads; False where it cannot be had."""
        symbol = f"{self._model}_on_threads"
        declared = f"int {symbol}(int (*)(states *), states *, int);"
        # never unloaded: its threads outlive whoever has opened it
        instead = "" if self._target.threads is None else "batches are worked on by one thread"
        library = self._apart("threads", declared, instead, self._ffi.RTLD_NODELETE)
        return library and getattr(library, symbol)

    def _apart(self, part: str, declared: str, instead: str, flags: int = 0) -> Any:
        """The library of ``NAME_<part>.c``; False where it cannot be had. A warning says once what happens instead."""
        with self._lock:
            if part not in self._libraries:
                try:
                    path, ffi = build_apart(self._folder, self._model, part, self._sealed).library(), self._ffi
                    ffi.cdef(declared, override=True)
                    self._libraries[part] = ffi.dlopen(str(path), ffi.RTLD_NOW | flags)
                except (CompileError, NoCompilerError, OSError) as error:
                    self._libraries[part], self._errors[part] = False, error
            if instead and part in self._errors:
                warn(f"{self._model}: {instead}: {self._errors.pop(part)}")
            return self._libraries[part]

    def states(
        self,
        f: Function,
        given: Mapping[str, tuple[Any, int, int]],
        results: Sequence[Array],
        count: int,
        k: int,
        all_codes: bool,
    ) -> tuple[Failed, bool]:
        """Run a function for several states at once; given are pointers and their steps from state to state and from direction
        to direction. Results are NaN where something was singular.

        Returns
        -------
        failed : dict of int to int
            All states that fail, or only the first of them.
        finite : bool
            Whether all numbers were, those given and results.
        """
        ffi, target = self._ffi, self._target
        symbol = self._symbol(f)
        with self._lock:
            if symbol not in self._several:
                ffi.cdef(f"int {symbol}(states *);", override=True)
                self._several[symbol] = getattr(self._opened(), symbol)
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
