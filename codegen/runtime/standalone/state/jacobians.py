"""Jacobians of the accelerations, all or some."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import all_finite
from ..calls.arguments import Seeds
from ..calls.functions import STATE
from ..calls.non_finite import tell_infinite
from ..calls.package import Package
from ..calls.results import empty, overlap, places, put
from .derivatives import ARRAYS, MATRICES, Jacobians, asked_for, jacobians_of


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
