"""Jacobians of the accelerations with respect to all or some variables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..calls.package import Package
from .derivatives import ARRAYS, MATRICES, Jacobians, asked_for, jacobians_of


def jacobians(
    package: Package, given: tuple[Any, ...], wrt: str | Sequence[str] | None, out: Jacobians | None
) -> Jacobians:
    """See `Solver.jacobians`."""
    asked = asked_for(wrt)
    if out is not None and not isinstance(out, Jacobians):
        raise ValueError(f"out is {type(out).__name__}, expected Jacobians, such as those of an earlier call")
    found = package._call(MATRICES[asked], given, None, None if out is None else ARRAYS[asked](out))
    return out or (Jacobians(*found) if len(found) == 5 else jacobians_of(dict(zip(asked, found, strict=True))))
