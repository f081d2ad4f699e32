"""Poses of frames: the expressions of an entry by their paths, and the rotations made from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from ..entries import ZERO, Entry, PlacedEntry
from ..expressions import Expression
from ..model import Vector
from ..parts import Instance
from ..positions import Path_
from ..reading import Reader
from .digits import check_angle, check_axis, check_degrees

Bound = Mapping[Path_, Expression]
"""Bound expressions of an entry by their paths in it."""

_REFERENCES: Final = frozenset({"parent", "body", "position", "velocity"})
_AXES: Final = tuple(tuple(Expression.number(int(i == k)) for i in range(3)) for k in range(3))


def expressions_of(entry: Entry, sub: Path_ = ()) -> Iterator[tuple[Path_, Expression]]:
    """The expressions of an entry with their paths; values of `_REFERENCES` are names, not expressions."""
    for key, value in entry:
        if key not in _REFERENCES:
            yield from _expressions_in(value, (*sub, key))


def _expressions_in(value: Any, sub: Path_) -> Iterator[tuple[Path_, Expression]]:
    if isinstance(value, Expression):
        yield sub, value
    elif isinstance(value, Entry):
        yield from expressions_of(value, sub)
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from _expressions_in(item, (*sub, i))


def bound_expressions(reader: Reader, entry: Entry, at: Instance, sub: Path_) -> dict[Path_, Expression]:
    """The bound expressions of a validated entry, by path; computed once for all equal repetitions."""
    same = reader.bound_once.get((id(at.part), id(entry), sub))
    if same is not None:
        return same
    listed = list(expressions_of(entry, sub))
    errors = reader.errors
    bound = {path: reader.bound(e, at, path, "parameters") for path, e in listed}
    if reader.errors == errors and not any(index in e.names for index in at.indices for _, e in listed):
        reader.bound_once[id(at.part), id(entry), sub] = bound
    return bound


def bound_entry(entry: Entry, bound: Bound, sub: Path_) -> Any:
    """A copy of the entry at a path with its expressions bound."""

    def of(value: Any, path: Path_) -> Any:
        if isinstance(value, tuple):
            return tuple(of(item, (*path, i)) for i, item in enumerate(value))
        return bound.get(path, value) if isinstance(value, Expression) else value

    return entry.model_copy(update={key: of(value, (*sub, key)) for key, value in entry})


def vector(bound: Bound, *sub: str | int) -> Vector:
    """The vector at a path; zero if there is none."""
    x, y, z = (bound.get((*sub, i), ZERO) for i in range(3))
    return x, y, z


def rotation(
    reader: Reader, spec: PlacedEntry, at: Instance, sub: Path_, bound: Bound, *, exact: bool = True
) -> tuple[tuple[Vector, Expression], ...]:
    """``rotate`` or ``rpy`` of the frame at a path, as rotations about the rotated axes; rotations by zero are left
    out. With `exact`, rounded angles and axes cause warnings."""

    def check(angle: Expression, path: Path_) -> None:
        check_degrees(reader, angle, at, path)
        if exact:
            check_angle(reader, angle, at, path)

    turns: list[tuple[Vector, Expression]] = []
    for i in range(len(spec.rotate or ())):
        axis = vector(bound, *sub, "rotate", i, "axis")
        reader.direction(axis, at, (*sub, "rotate", i, "axis"))
        if exact:
            check_axis(reader, axis, at, (*sub, "rotate", i, "axis"))
        check(bound[*sub, "rotate", i, "angle"], (*sub, "rotate", i, "angle"))
        turns.append((axis, bound[*sub, "rotate", i, "angle"]))
    if spec.rpy is not None:
        for k in range(3):
            check(bound[*sub, "rpy", k], (*sub, "rpy", k))
        # roll, pitch, yaw about fixed axes x, y, z: yaw, pitch, roll about the rotated axes z, y, x
        turns = [(_AXES[k], bound[*sub, "rpy", k]) for k in (2, 1, 0)]  # type: ignore[misc]
    return tuple(t for t in turns if t[1] is not ZERO)
