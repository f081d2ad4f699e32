"""Direct calls of the compiled functions, for one state or a small batch along one axis.

A call takes arguments in `Function.order`, seeds in `Function.directions` or None, and arrays for results or None. It
returns a tuple of arrays, or None if an argument is not a float64 array, a number is not finite, or the state is
singular. The general path then converts the arguments, or raises an error. ``direct_call.c`` implements these calls. If
this file cannot be compiled, `PlainCall` replaces it for one state in float64 arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from .arguments import SMALLEST_QUATERNION
from .functions import ARGUMENTS, SEEDS, SELECTIVE, Function, Wanted
from .results import empty, overlapping, put

Call = Callable[[tuple[Any, ...], tuple[Any, ...] | None, Any], tuple[Array, ...] | None]

FEW, FEW_ALONG = 96, 32
"""Largest numbers of states of a small batch, without and with directions; above them, other code is faster."""

SLOT = {
    n: i
    for i, n in enumerate(
        (*ARGUMENTS, *SEEDS, "default_p", "default_inputs", "work", "lanes", "few", "points", "steps", "results")
    )
}
"""Indices in the table of pointers that the functions of ``NAME_calls.c`` take."""

WITH_DEFAULT = ("p", "inputs")


def general(given: tuple[Any, ...], seeds: tuple[Any, ...] | None = None, out: Any = None) -> None:
    """A direct call that does nothing and returns None, after which the general path is taken."""


class NoCalls(dict[Any, Call]):
    """The direct calls of a target that has none: `general` for every function."""

    def __missing__(self, wanted: str | Wanted) -> Call:
        return general


class Calls(dict[Any, Call]):
    """The direct calls of a compiled target, created at their first use. Threads may share one.

    Parameters
    ----------
    target : CTarget
    caller : module or None
        See `find_caller`.
    """

    def __init__(self, target: Any, caller: Any):
        super().__init__()
        self.target, self.caller = target, caller
        self.pool = None if caller is None else caller.pool()

    def __missing__(self, wanted: str | Wanted) -> Call:
        if isinstance(wanted, str):
            f = self.target.functions.get(wanted)
            wanted, key = Wanted(wanted, f.results if f else ()), wanted
        else:
            f, key = wanted.function or self.target.functions.get(wanted.name), wanted
        if f is None:
            return general
        call: Call = PlainCall(self.target, f, wanted) if self.caller is None else self._compiled(f, wanted)
        self[key] = call
        return call

    def _compiled(self, f: Function, wanted: Wanted) -> Call:
        target = self.target
        table = None if wanted.table is None else wanted.table.astype(target.dtype, copy=False)
        fixed: dict[str, Any] = dict(zip(("default_p", "default_inputs"), target.default_pointers, strict=True))
        fixed |= {"few": target.few_pointer, "points": target.pointer(table)}
        address = {n: int(target.ffi.cast("intptr_t", pointer)) for n, pointer in fixed.items()}

        large, arrays, work_of_states = target.batches.together(f)

        def place(name: str) -> int:
            return arrays.index(name) if name in arrays else -1

        def taken(
            name: str, of: str, needed: int, rest: int = 0
        ) -> tuple[int, int, int, dict[str, int] | None, int, int]:
            """How C reads an argument: slot, size, whether it is required, indices of names, default values, index in large
            batches."""
            names = {} if name in ("q", "u") else {n: i for i, n in enumerate(target.names.get(of, ()))}
            return SLOT[name], math.prod(target.shapes[of]), needed, names or None, rest, place(name)

        takes = [
            (0, 0, 0, None, 0, place("t")) if n == "t"
            else taken(n, n, int(n in f.takes and n not in WITH_DEFAULT), address.get(f"default_{n}", 0))
            for n in f.order
        ]  # fmt: skip
        seeds = [taken(s, s[1:], -1 if s == "dt" else 0) for s in f.directions]
        results = [
            (math.prod(shape), int(derived), place_of(r, i, f, wanted), place(r))
            for i, (r, shape, derived) in enumerate(zip(f.results, f.shapes, f.derived, strict=True))
        ]
        returns = []
        for r in wanted.returned:
            if r in f.results:
                i = f.results.index(r)
                returns.append((int(f.derived[i]), 0, f.shapes[i]))
            else:
                returns.append((int(bool(f.seeds)), 1, target.shapes[r.removeprefix("d")]))
        lanes = f.per_direction * max(f.widths, default=0)
        call: Call = self.caller.Call(
            self.pool, int(target.ffi.cast("intptr_t", target.function(f))), target.dtype.itemsize,
            (target.workspace, lanes, SLOT["work"], SLOT["lanes"]), (FEW, FEW_ALONG),
            [address.get(n, 0) for n in SLOT if n != "results"], takes, seeds, results, returns,
            (table, target.defaults, target.library_of_call(f), target.few_pointer),
            (large, len(arrays), work_of_states, target.batches.quaternions, SMALLEST_QUATERNION**2),
        )  # fmt: skip
        return call


def place_of(result: str, i: int, f: Function, wanted: Wanted) -> int:
    """Index of a result among those returned; -1 if it is not returned, -2 if it is not even computed."""
    if result in wanted.returned:
        return wanted.returned.index(result)
    return -2 if i and f.name in SELECTIVE else -1


class PlainCall:
    """A direct call in Python, by cffi's ABI mode, for one state and its seeds in float64 arrays.

    Parameters
    ----------
    target : CTarget
    f : Function
    wanted : Wanted
    """

    def __init__(self, target: Any, f: Function, wanted: Wanted):
        self.target, self.f, self.dtype, self.run = target, f, target.dtype, target.function(f)
        self.table = None if wanted.table is None else wanted.table.astype(target.dtype, copy=False)
        self.shapes = f.whole_shapes(())
        self.free: list[tuple[Any, ...]] = []
        """Tables of pointers that are free at present, each with its memory."""
        # bit, slot (-1 for t) and shape of each argument and seed
        self.takes = [(0, -1, ()) if n == "t" else (1 << SLOT[n], SLOT[n], target.shapes[n]) for n in f.order]
        self.seeds = [(1 << SLOT[s], SLOT[s], target.shapes[s[1:]]) for s in f.directions]
        self.needed = sum(1 << SLOT[n] for n in f.takes if n not in (*WITH_DEFAULT, "t"))
        self.optional = sum(1 << SLOT[n] for n in WITH_DEFAULT)
        self.places = [place_of(r, i, f, wanted) for i, r in enumerate(f.results)]
        self.returned = [
            (f.results.index(r), ()) if r in f.results else (-1, target.shapes[r.removeprefix("d")])
            for r in wanted.returned
        ]

    def __call__(self, given: tuple[Any, ...], seeds: tuple[Any, ...] | None = None, out: Any = None) -> Any:
        try:
            room = self.free.pop()
        except IndexError:
            room = self.room()
        try:
            return self.results(room[0], given, seeds, out)
        finally:
            self.free.append(room)

    def room(self) -> tuple[Any, ...]:
        """A table of pointers, and the memory that it points to."""
        target, f = self.target, self.f
        work = target.pointer(np.empty(target.workspace, self.dtype))
        lanes = target.pointer(np.empty(f.per_direction * max(f.widths, default=0), self.dtype))
        x = target.pointers({}, work, lanes, [None] * len(f.results))
        x[SLOT["points"]] = target.pointer(self.table)
        return x, work, lanes

    def is_plain(self, x: Any) -> bool:
        """Whether C can read an array without a copy."""
        return type(x) is np.ndarray and x.dtype is self.dtype and x.flags.c_contiguous and x.flags.aligned

    def results(self, x: Any, given: tuple[Any, ...], seeds: tuple[Any, ...] | None, out: Any) -> Any:
        """Computes results in C; None if this is impossible, or if `out` cannot be written directly."""
        pointer = self.target.pointer
        bits, k, t = 0, 0, None
        for (bit, slot, shape), a in zip(self.takes, given, strict=True):
            if slot < 0:
                t = a
            elif a is not None:
                if not self.is_plain(a) or a.shape != shape:
                    return None
                bits |= bit
                x[slot] = pointer(a)
        if not isinstance(t, float) or bits & ~self.optional != self.needed:
            return None
        for (bit, slot, shape), a in zip(self.seeds, seeds or (), strict=True):
            if a is not None:
                rows = len(a) if type(a) is np.ndarray and a.ndim > len(shape) else 1
                if not self.is_plain(a) or a.shape not in (shape, (rows, *shape)) or not a.ndim or k not in (0, rows):
                    return None
                bits, k = bits | bit, rows
                x[slot] = pointer(a)
        if self.seeds and not k:
            return None
        shapes = self.f.whole_shapes((), k) if self.seeds else self.shapes
        computed: list[Any] = []
        for i, (place, shape) in enumerate(zip(self.places, shapes, strict=True), SLOT["results"]):
            computed.append(None if place == -2 else empty(shape, self.dtype))
            x[i] = pointer(computed[-1])
        lead = (k,) if self.seeds else ()
        found: list[Any] = [computed[i] if i >= 0 else np.zeros(lead + shape, self.dtype) for i, shape in self.returned]
        if out is not None:
            out = [out] if seeds is None and type(out) is np.ndarray else out
            if not (isinstance(out, (tuple, list)) and fits(out, found)):
                return None
        if self.run(x, bits, t, k):
            return None
        return tuple(found if out is None else put(found, out))


def fits(places: Sequence[Any], found: Sequence[Array]) -> bool:
    """Whether results may be written to these arrays."""
    if len(places) != len(found):
        return False
    for x, result in zip(places, found, strict=True):
        if type(x) is not np.ndarray or x.dtype != result.dtype or x.shape != result.shape or not x.flags.carray:
            return False
    return not overlapping(places)
