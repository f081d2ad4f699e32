"""Jacobians of the accelerations, all or some."""

from __future__ import annotations

import difflib
import functools
import itertools
import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, all_finite
from ..calls.arguments import Seeds
from ..calls.functions import STATE, Wanted
from ..calls.non_finite import tell_infinite
from ..calls.package import Package
from ..calls.results import empty, overlap, places, put


@dataclass(slots=True, eq=False, repr=False)
class Jacobians:
    """Partial derivatives of udot; None in the place of those that were not asked for.

    Attributes
    ----------
    q : (..., nu, nq)
    u : (..., nu, nu)
    p : (..., nu, np)
    inputs : (..., nu, ninputs)
    t : (..., nu)
    """

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Array

    def __repr__(self) -> str:
        shapes = ", ".join(f"{n} {getattr(self, n).shape}" for n in JACOBIANS if getattr(self, n) is not None)
        return f"<Jacobians of udot: {shapes}>"


JACOBIANS = ("q", "u", "p", "inputs", "t")
"""What udot is differentiated in, in the order of `Jacobians`."""


MATRICES = {
    asked: Wanted("jacobians", [f"J_{n}" for n in asked])
    for r in range(1, 6)
    for asked in itertools.combinations(JACOBIANS, r)
}
"""What they are called among results, by which ones are asked for."""

ARRAYS = {asked: operator.attrgetter(*asked) for asked in MATRICES}
"""What takes these out of `Jacobians`."""


def jacobians_of(matrices: Mapping[str, Array]) -> Jacobians:
    """Those of some of `JACOBIANS`; the others were not asked for."""
    found: list[Any] = [matrices.get(n) for n in JACOBIANS]
    return Jacobians(*found)


def asked_for(wrt: str | Iterable[str] | None) -> tuple[str, ...]:
    """What derivatives are asked for: names of `JACOBIANS`, in a list or with commas between them; all if left out.

    Raises
    ------
    ValueError
        A name is not among them, or there is none.
    TypeError
        Neither names nor None.
    """
    if wrt is None:
        return JACOBIANS
    if isinstance(wrt, str):
        return _in_words(wrt)
    if not isinstance(wrt, Iterable):
        raise TypeError(f"wrt is {wrt!r}, expected names such as 'q, u', of {', '.join(JACOBIANS)}")
    return _in_order(list(wrt))


@functools.lru_cache(maxsize=64)  # loops ask for the same
def _in_words(wrt: str) -> tuple[str, ...]:
    return _in_order([n.strip() for n in wrt.split(",")])


def _in_order(names: list[str]) -> tuple[str, ...]:
    for name in names:
        if name not in JACOBIANS:
            near = difflib.get_close_matches(str(name), JACOBIANS, 1, 0.4)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"wrt: udot is not differentiated by {name!r}{hint}; it may be by {', '.join(JACOBIANS)}")
    if not names:
        raise ValueError(f"wrt: nothing is asked for; it may be {', '.join(JACOBIANS)}, or be left out for all")
    return tuple(n for n in JACOBIANS if n in names)


def jacobians(
    package: Package, given: tuple[Any, ...], wrt: str | Sequence[str] | None, out: Jacobians | None
) -> Jacobians:
    """See `Solver.jacobians`."""
    asked, opened = asked_for(wrt), package._opened
    f = package._find(opened, "jacobians")
    if out is not None and not isinstance(out, Jacobians):
        raise ValueError(f"out is {type(out).__name__}, expected Jacobians, such as those of an earlier call")
    if package._watched and "p" in asked:
        package._look_at_directions("jacobians", given, (None, None, np.eye(package.np), None, None))
    else:
        found = package._calls[MATRICES[asked]](given, None, None if out is None else ARRAYS[asked](out))
        if found is not None:
            return out or (Jacobians(*found) if len(found) == 5 else jacobians_of(dict(zip(asked, found, strict=True))))
    arrays, batch = package._arguments.take(dict(zip(STATE, given, strict=True)), package._left_out)
    shapes = {f"J_{n}": batch + package._shapes[f"J_{n}"] for n in asked}
    J = out or jacobians_of({n: empty(shapes[f"J_{n}"], package._arguments.dtype) for n in asked})
    if not f.has_entries():
        return J
    taken = places(
        [getattr(J, n) for n in asked], [f"J.{n}" for n in asked], list(shapes.values()), package._arguments.dtype
    )
    named = dict(zip(shapes, taken, strict=True))
    # udot, which is computed beside them, has no place
    whole = f.whole_shapes(batch)
    wanted: list[Any] = [
        empty(s, package._arguments.dtype) if r == "udot" else named.get(r)
        for r, s in zip(f.results, whole, strict=True)
    ]
    if out is not None and overlap(taken, arrays):
        put(opened.target.compute(f, arrays, batch), wanted)
    else:
        opened.target.compute(f, arrays, batch, out=wanted)
    if not all(all_finite(x) for x in wanted if x is not None):
        sizes = {f"d{n}": math.prod(package._shapes[n]) for n in f.arguments}
        every, ends = np.eye(sum(sizes.values())), itertools.accumulate(sizes.values())
        units = {s: every[:, end - n : end] for (s, n), end in zip(sizes.items(), ends, strict=True)}
        tell_infinite(opened, f, wanted, arrays, batch, Seeds(units, len(every)))
    for name, place in named.items():
        if name not in f.results:
            place[...] = 0.0
    return J
