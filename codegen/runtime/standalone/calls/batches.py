"""Batches in C: states one after the other, or several at once in the lanes of vectors; on threads, if asked for."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import CompileError, NoCompilerError
from ..files.build import build_apart
from ..warning import warn
from .functions import Function

STRIDED = """
typedef struct {{ {0} *at; long state, direction, entry; }} strided;
typedef struct {{ long count, directions, failed; int code, *codes; strided {1}; {0} *work; }} states;
"""
"""The struct that functions over several states at once work on."""

WORTH_COMPILING = 2048
"""So many states of batches, those along directions too, and the functions over several at once are compiled."""

WORTH_A_THREAD = 64
"""States; a thread gets at least as many."""

EVEN = 8
"""Parts of a batch are multiples of as many states as vectors hold at most."""

MOST_SWEPT = 48_000
"""Doubles that sweeps along directions go over for one state, up to which several states at once are faster: with more they
are beyond the caches of a core, where those of one state still are within."""

MOST_IN_LANES = 8_000_000
"""Doubles of memory of several states at once; with more they gain nothing over one after the other."""

Failed = dict[int, int]
"""Numbers of states of a batch, and what was singular there, as the C says it."""

_pools: dict[tuple[int, int], ThreadPoolExecutor] = {}
_pooling = threading.Lock()


def pool(threads: int) -> ThreadPoolExecutor:
    """So many threads, kept; a process that was forked has its own."""
    key = os.getpid(), threads
    with _pooling:
        if key not in _pools:
            _pools[key] = ThreadPoolExecutor(threads, "ordernm-batch")
        return _pools[key]


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
        self._several: dict[str, Callable[[Any], int]] = {}
        self._libraries: dict[str, Any] = {}
        self._seen = 0
        self._lock = threading.RLock()

    # -- parts of a batch ----------------------------------------------------------------------------------------------

    def _parts(self, count: int) -> list[tuple[int, int]]:
        """Where the parts of a batch begin and end, one for each thread."""
        n = max(1, min(self._target.threads, count // WORTH_A_THREAD))
        size = max(-(-count // (n * EVEN)), 1) * EVEN
        return [(start, min(start + size, count)) for start in range(0, count, size)]

    def run(self, part: Callable[[int, int], Failed], count: int) -> Failed:
        """Work on all parts; what has failed, in the order of the states."""
        parts = self._parts(count)
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
        if self._over_states["workspace"] > MOST_IN_LANES or (f.seeds and self._over_states["swept"] > MOST_SWEPT):
            return False
        self._seen += count * (1 + k)
        return ("states" in self._libraries or self._seen >= WORTH_COMPILING) and self._opened() is not False

    def prepare(self) -> None:
        """Compile the functions over several states at once, and what shares them among threads, where there are any."""
        if self._over_states and self._opened() is not False and self._target.threads > 1:
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
        library = self._apart("threads", declared, "batches are worked on by one thread", self._ffi.RTLD_NODELETE)
        return library and getattr(library, symbol)

    def _apart(self, part: str, declared: str, instead: str, flags: int = 0) -> Any:
        """The library of ``NAME_<part>.c``; False where it cannot be had, and then what happens instead is told once."""
        with self._lock:
            if part not in self._libraries:
                try:
                    path, ffi = build_apart(self._folder, self._model, part, self._sealed).library(), self._ffi
                    ffi.cdef(declared, override=True)
                    self._libraries[part] = ffi.dlopen(str(path), ffi.RTLD_NOW | flags)
                except (CompileError, NoCompilerError, OSError) as error:
                    warn(f"{self._model}: {instead}: {error}")
                    self._libraries[part] = False
            return self._libraries[part]

    def states(
        self,
        f: Function,
        given: Mapping[str, tuple[Any, int, int]],
        results: Sequence[Array],
        count: int,
        k: int,
    ) -> Failed:
        """Run a function for several states at once; given are pointers and their steps from state to state and from direction
        to direction. Results are NaN where something was singular.
        """
        ffi, target = self._ffi, self._target
        symbol = f"{self._model}_{f.name}_states"
        with self._lock:
            if symbol not in self._several:
                ffi.cdef(f"int {symbol}(states *);", override=True)
                self._several[symbol] = getattr(self._opened(), symbol)
            call = self._several[symbol]
        arrays = dict(given)
        for r, name, shape in zip(results, f.results, f.shapes, strict=True):
            n = math.prod(shape)
            arrays[name] = target.pointer(r), n, count * n

        threads = min(self._target.threads, count // WORTH_A_THREAD)
        shared: Any = self._shared() if threads > 1 else False
        codes = np.zeros(count, np.intc)
        work = np.empty(self._over_states["workspace"] * (threads if shared else 1), target.dtype)
        b = ffi.new("states *", {"count": count, "directions": k, "work": target.pointer(work)})
        b.codes = ffi.from_buffer("int[]", codes)
        for name, (at, state, direction) in arrays.items():
            setattr(b, name, (at, state, direction, 1))
        code = shared(call, b, threads) if shared else call(b)
        return {int(i): int(codes[i]) for i in np.flatnonzero(codes)} if code else {}


__all__ = ["Batches", "Failed"]
