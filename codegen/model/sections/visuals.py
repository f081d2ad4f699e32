"""Visuals of bodies, which views show: those that a body lists, or its shape."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from .. import checks
from ..entries import shown
from ..expressions import Expression
from ..model import Body
from ..parts import Instance
from ..positions import Path_
from ..reading import Reader
from ..schema import BodyEntry
from ..visuals import SIZES, AnyVisual, MeshVisual, Visual
from .placement import Bound, bound_expressions, rotation, vector

_VECTORS: Final = {"size", "radii"}


def read_visuals(reader: Reader, spec: BodyEntry, at: Instance, bound: Bound) -> tuple[Visual, ...] | None:
    """The visuals of a body, from its expressions by their paths; the shape if the body lists no visuals; None without
    either.

    Reports negative sizes and axes without direction.
    """
    if spec.visuals is not None:
        return tuple(_visual(reader, x, at, ("visuals", i), bound) for i, x in enumerate(spec.visuals))
    if spec.shape is None:
        return None
    sizes = _sizes(spec.shape, ("shape",), bound)
    axis = vector(bound, "shape", "axis") if hasattr(spec.shape, "axis") else None
    return (Visual(spec.shape.type, sizes, vector(bound, "shape", "center"), axis=axis),)


def read_visuals_of_ground(reader: Reader, bodies: list[Body]) -> tuple[Visual, ...]:
    """The section ``visuals``: visuals on the ground. Those of a submodel are added to the body that replaces its ground."""
    found: dict[str, list[Visual]] = {}
    for part in reader.parts:
        at = part.entry("visuals")
        if at.value is not None and not isinstance(at.value, list):
            reader.report(at, (), f"{shown(at.value)}; a list of visuals is needed: [{{type: box, size: [1, 1, 0.1]}}]")
            continue
        for i, value in enumerate(at.value or ()):
            one = Instance(i, value, at.value, ("visuals",), {}, part)  # type: ignore[arg-type]
            entry = reader.spec(AnyVisual, one)
            if reader.is_whole(entry):
                visual = _visual(reader, entry, one, (), bound_expressions(reader, entry, one, ()))
                found.setdefault(part.ground, []).append(visual)
    for i, b in enumerate(bodies):
        if b.name in found:
            bodies[i] = replace(b, visuals=(*(b.visuals or ()), *found[b.name]))
    return tuple(found.get("ground", ()))


def _visual(reader: Reader, entry: Any, at: Instance, sub: Path_, bound: Bound) -> Visual:
    sizes, axis = _sizes(entry, sub, bound), None
    check_sizes(reader, entry.type, at, sub, bound)
    if hasattr(entry, "axis"):
        axis = vector(bound, *sub, "axis")
        reader.direction(axis, at, (*sub, "axis"))
    file = entry.file if isinstance(entry, MeshVisual) else ""
    turns = rotation(reader, entry, at, sub, bound, exact=False)
    return Visual(entry.type, sizes, vector(bound, *sub, "at"), turns, axis, entry.color, file)


def check_sizes(reader: Reader, type_: str, at: Instance, sub: Path_, bound: Bound) -> None:
    """Report sizes of a solid that are negative at the default parameters."""
    for key in SIZES[type_] if type_ != "mesh" else ():
        for path in [(key, i) for i in range(3)] if key in _VECTORS else [(key,)]:
            size = bound.get((*sub, *path))
            if size is not None and (value := reader.numeric(size)) < 0:
                message = f"{checks.with_value(size, value)} is negative; a size must be at least 0"
                reader.report(at, (*sub, *path), message)


def _sizes(entry: Any, sub: Path_, bound: Bound) -> tuple[Expression, ...]:
    found: list[Expression] = []
    for key in SIZES[entry.type]:
        value = getattr(entry, key)
        if isinstance(value, tuple):
            found += [bound[*sub, key, i] for i in range(3)]
        else:
            found += [bound[*sub, key]] * (3 if key == "scale" else 1)
    return tuple(found)
