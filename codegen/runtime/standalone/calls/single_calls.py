"""Calls of the compiled functions with one state in plain arrays: the C reads copies of them, at addresses that stay.

A copy of a few numbers takes less time than finding out where an array begins. `memoryview` compares type and shape as it copies.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..arrays import Array, Shape
from .functions import ARGUMENTS, SEEDS, Function, Wanted
from .results import overlapping

LARGEST = 2**15
"""Numbers of all seeds and results of a call; above this size the C reads and writes the arrays themselves."""

SELECTIVE = ("jacobians",)
"""Functions that leave out results with no place to go, but for the first."""

SLOT = {
    n: i
    for i, n in enumerate(
        (*ARGUMENTS, *SEEDS, "default_p", "default_inputs", "work", "lanes", "few", "points", "results")
    )
}
"""Places in the table of pointers that the functions of ``NAME_calls.c`` take."""


Q, U, P, INPUTS = (1 << SLOT[n] for n in ("q", "u", "p", "inputs"))
"""Bits that say which arguments are given."""


class CallMemory(dict[Any, "PreparedCall"]):
    """Memory of one call at a time: the workspace, arguments, and of each function what `PreparedCall` has.

    Parameters
    ----------
    target : CTarget

    Attributes
    ----------
    work : pointer
        To the workspace.
    arguments : dict of str to memoryview
    pointers : dict of str to pointer
        To the arguments.
    q, u, p, inputs : memoryview
        The arguments that most functions take.
    """

    __slots__ = ("arguments", "inputs", "p", "pointers", "q", "target", "u", "work")

    def __init__(self, target: Any):
        super().__init__()
        self.target = target
        self.work = target.pointer(np.empty(target.workspace, target.dtype))
        arrays = {n: target.zeros(target.shapes[n]) for n in ARGUMENTS}
        self.arguments: dict[str, Any] = {n: x.data for n, x in arrays.items()}
        self.pointers = {n: target.pointer(x) for n, x in arrays.items()}
        self.q, self.u, self.p, self.inputs = (self.arguments[n] for n in ("q", "u", "p", "inputs"))

    def prepare(self, wanted: str | Wanted) -> PreparedCall:
        """The call of a function.

        Raises
        ------
        KeyError
            There is none.
        ValueError
            It has too many results.
        """
        if isinstance(wanted, str):
            f = self.target.functions[wanted]
            wanted = Wanted(wanted, f.results)
        else:
            f = wanted.function or self.target.functions[wanted.name]
        if sum(map(math.prod, f.shapes)) > LARGEST:
            raise ValueError
        return PreparedCall(f, wanted, self)


class PreparedCall:
    """A function with what the C needs: a table of pointers, and memory for seeds and results.

    Parameters
    ----------
    f : Function
    wanted : Wanted
    memory : CallMemory

    Attributes
    ----------
    call, function
        What calls a function, and the function.
    x : pointer
        The table of pointers.
    needed : int
        The bits of arguments that must be given.
    extra : (int, memoryview)
        The bit of the argument behind t, and its copy.
    k : int
        Directions for which there is room now.
    seeds : list of tuples
        Of each seed its bit, the copies of a single direction and of all, and the shape of these.
    results : list of arrays
        The results that are returned.
    """

    __slots__ = (
        "call",
        "capacity",
        "dtype",
        "extra",
        "f",
        "fitting",
        "function",
        "k",
        "kept",
        "looked_at",
        "needed",
        "per_direction",
        "places",
        "pointer",
        "results",
        "returned",
        "rows",
        "seeds",
        "shapes",
        "x",
    )  # fmt: skip

    def __init__(self, f: Function, wanted: Wanted, memory: CallMemory):
        target = memory.target
        self.f, self.returned, self.pointer, self.call = f, wanted.returned, target.pointer, target.call
        self.function = target.address(f)
        self.shapes, self.dtype = target.shapes, target.dtype
        self.needed = sum(1 << SLOT[n] for n in f.takes if n not in ("p", "inputs", "t"))
        self.extra: tuple[int, Any] = (
            1 << SLOT[f.order[-1]] if len(f.order) > 5 else 0,
            memory.arguments.get(f.order[-1]),
        )
        derived = sum(math.prod(s) for s, d in zip(f.shapes, f.derived, strict=True) if d)
        self.per_direction = sum(f.seeds.values()) + derived
        self.k, self.capacity = 0, -1
        lanes = np.empty(self.per_direction * max(f.widths, default=0), target.dtype)
        self.x = target.pointers(memory.pointers, memory.work, lanes, [None] * len(f.results))
        table = None if wanted.table is None else wanted.table.astype(target.dtype, copy=False)
        self.x[SLOT["points"]] = target.pointer(table)
        self.kept = memory.pointers, lanes, table
        self.rows: dict[str, Array] = {}
        self.places: dict[str, Array | None] = {}
        self.fit(0)

    def fit(self, k: int) -> bool:
        """Make room for k directions; returns whether that number is allowed."""
        f = self.f
        if sum(map(math.prod, f.shapes)) + k * self.per_direction > LARGEST:
            return False
        if k > self.capacity:
            self.capacity = max(k, 8) if f.seeds else 0
            for i, (r, shape) in enumerate(zip(f.results, f.whole_shapes((), self.capacity), strict=True)):
                computed = not i or r in self.returned or f.name not in SELECTIVE
                self.places[r] = np.empty(shape, self.dtype) if computed else None
                self.x[SLOT["results"] + i] = self.pointer(self.places[r])
            for r in self.returned:
                if r not in f.results:
                    shape = self.shapes[r.removeprefix("d")]
                    self.places[r] = np.zeros((self.capacity, *shape) if f.seeds else shape, self.dtype)
            for s in f.directions:
                self.rows[s] = np.zeros((self.capacity, math.prod(self.shapes[s[1:]])), self.dtype)
                self.x[SLOT[s]] = self.pointer(self.rows[s])
        self.k = k
        self.seeds: list[tuple[int, Any, Array, Shape]] = []
        for s, rows in self.rows.items():
            every = rows[:k, 0] if s == "dt" else rows[:k]
            self.seeds.append((1 << SLOT[s], rows[0].data, every, every.shape))
        values = {r for r, derived in zip(f.results, f.derived, strict=True) if not derived or not f.seeds}
        self.results: list[Any] = [
            place if place is None or r in values or not f.seeds else place[:k]
            for r, place in ((r, self.places[r]) for r in self.returned)
        ]
        self.fitting: list[int] = []
        return True

    def fits(self, out: Any) -> bool:
        """Whether the results may be written there. The arrays that were looked at last are known by their addresses until one of
        them is gone, so that loops have them looked at once."""
        if type(out) not in LISTS:
            return False
        places = [*map(id, out)]
        if places == self.fitting:
            return True
        found = fits(out, self.results)
        self.fitting = places if found else []
        self.looked_at = [weakref.ref(x, self.forget) for x in out] if found else []
        return found

    def forget(self, reference: Any) -> None:
        """An array is gone; another one may have its address."""
        self.fitting = []

    def take_seeds(self, seeds: Sequence[Any]) -> int:
        """Copy the seeds; the bits of those that are given.

        Raises
        ------
        ValueError
            They are not plain arrays of as many directions as there is room for.
        """
        bits, of_seeds, k = 0, self.seeds, self.k
        for i, x in enumerate(seeds):
            if x is not None:
                bit, row, rows, shape = of_seeds[i]
                bits |= bit
                if type(x) is not ARRAY:
                    if shape != (1,) or not isinstance(x, float):
                        raise ValueError
                    rows[0] = x
                elif x.shape == shape and x.dtype is self.dtype:
                    rows[...] = x
                elif k == 1:
                    row[:] = x
                else:
                    raise ValueError
        if not bits:
            raise ValueError
        return bits

    def take_other_seeds(self, seeds: Sequence[Any]) -> int:
        """The same for seeds of another number of directions."""
        for x, (_, _, rows, _) in zip(seeds, self.seeds, strict=True):
            if x is not None:
                several = type(x) is ARRAY and x.ndim == rows.ndim
                k = len(x) if several else 1
                if k not in (0, self.k) and self.fit(k):
                    return self.take_seeds(seeds)
                break
        raise ValueError


class SingleCalls:
    """Calls a target's functions with one state. Any number of threads may call at once: each call has memory to itself.

    Parameters
    ----------
    target : CTarget
    """

    def __init__(self, target: Any):
        self.target = target
        self.free: list[CallMemory] = []
        self.run = _run(target, self.free)

    def take(self) -> CallMemory:
        """Memory that no other call has until it is put back into `free`; that of a call which is interrupted is lost."""
        try:
            return self.free.pop()
        except IndexError:
            return CallMemory(self.target)


def _run(target: Any, free: list[CallMemory]) -> Callable[..., Sequence[Array] | None]:
    """What calls functions with memory that is free; a closure, since that takes less time than a method."""
    pop, push = free.pop, free.append

    def run(
        wanted: str | Wanted,
        given: Sequence[Any],
        seeds: Sequence[Any] | None = None,
        out: Any = None,
    ) -> Sequence[Array] | None:
        """Results of a function, in `out` if there is one.

        Parameters
        ----------
        wanted : str or Wanted
            The function, or which of its results.
        given, seeds : sequence of Any
            As they were passed, in the order of `Function.order` and `Function.directions`.
        out : sequence of arrays, optional
            One for each result that is returned; the array itself for a function with one.

        Returns
        -------
        sequence of arrays, or None
            None unless the arguments are plain arrays of one valid state, and the results finite.
        """
        try:
            memory = pop()
        except IndexError:
            memory = CallMemory(target)
        found: Sequence[Array] | None = None
        try:
            call = memory.get(wanted) or memory.setdefault(wanted, memory.prepare(wanted))
            if len(given) == 5:
                q, u, p, inputs, t = given
                bits = 0
            else:
                q, u, p, inputs, t, extra = given
                bits, numbers = call.extra
                if type(extra) is not ARRAY:
                    raise ValueError
                numbers[:] = extra
            if type(q) is ARRAY:
                memory.q[:] = q
                bits |= Q
            if type(u) is ARRAY:
                memory.u[:] = u
                bits |= U
            if bits == call.needed and (type(t) is float or isinstance(t, (float, int))):
                if type(p) is ARRAY:
                    memory.p[:] = p
                    bits |= P
                elif p is not None:
                    raise ValueError
                if type(inputs) is ARRAY:
                    memory.inputs[:] = inputs
                    bits |= INPUTS
                elif inputs is not None:
                    raise ValueError
                if seeds is not None:
                    try:
                        bits |= call.take_seeds(seeds)
                    except ValueError:
                        bits |= call.take_other_seeds(seeds)
                results = call.results
                if seeds is None and type(out) is ARRAY:
                    out = (out,)
                if (out is None or call.fits(out)) and not call.call(call.function, call.x, bits, t, call.k):
                    if out is not None:
                        for i, place in enumerate(out):
                            place[...] = results[i]
                        found = out
                    elif len(results) == 1:
                        found = (results[0].copy(),)
                    elif len(results) == 2:
                        found = results[0].copy(), results[1].copy()
                    else:
                        found = [x.copy() for x in results]
        except (KeyError, OverflowError, TypeError, ValueError):  # other types and shapes
            pass
        push(memory)
        return found

    return run


ARRAY, LISTS = np.ndarray, (tuple, list)


def fits(out: Sequence[Any], results: Sequence[Array]) -> bool:
    """Whether results may be written there."""
    if len(out) != len(results):
        return False
    for x, result in zip(out, results, strict=True):
        if type(x) is not ARRAY or x.dtype != result.dtype or x.shape != result.shape or not x.flags.carray:
            return False
    return not overlapping(out)
