"""Visuals: solids and meshes that views show of a body, placed in its frame. They have no effect on the dynamics."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import Field, PlainValidator, TypeAdapter

from .axes import Vector
from .entries import ONE, ZERO, Axis, Expr, PlacedEntry, complaint, shown
from .entries import Vector as VectorEntry
from .expressions import Expression

SIZES: Final = {
    "box": ("size",), "sphere": ("radius",), "ellipsoid": ("radii",), "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"), "rod": ("length",), "mesh": ("scale",),
}  # fmt: skip
"""Keys of the sizes of each type, in the order of `Visual.sizes`. A rod is a type of shapes only."""

_COLOR: Final = re.compile("#(?:[0-9a-fA-F]{6}|[0-9a-fA-F]{8})")


@dataclass(frozen=True, slots=True, eq=False)
class Visual:
    """A solid or a mesh that views show, fixed in a body.

    Attributes
    ----------
    type : str
        A key of `SIZES`.
    sizes : tuple of Expression
        Edges of a box, radius of a sphere, semi-axes of an ellipsoid, radius and length of a cylinder or capsule, length of a
        rod, m; the three scale factors of a mesh.
    at : Vector
        Centre of a solid, or origin of a mesh, in the body frame, m.
    rotation : tuple of (Vector, Expression)
        Rotations of its frame in the body frame, in sequence about the moving axes, rad. Empty: the axes are parallel.
    axis : Vector or None
        Axis of a cylinder, capsule or rod in its frame, not normalised.
    color : str
        ``#rrggbb`` or ``#rrggbbaa``; ``""`` where the view chooses.
    file : str
        File of a mesh, as the model names it.
    """

    type: str
    sizes: tuple[Expression, ...]
    at: Vector
    rotation: tuple[tuple[Vector, Expression], ...] = ()
    axis: Vector | None = None
    color: str = ""
    file: str = ""


def _color(value: Any) -> str:
    if isinstance(value, str) and _COLOR.fullmatch(value):
        return value.lower()
    raise complaint(f'{shown(value)}; a colour is "#rrggbb" or "#rrggbbaa", in quotation marks')


def _file(value: Any) -> str:
    if isinstance(value, str) and value.strip():
        return value
    raise complaint(f"{shown(value)}; a mesh file is needed, by its path from the model's folder: meshes/arm.stl")


def _scale(value: Any) -> Any:
    return (_THREE if isinstance(value, (list, tuple)) else _ONE).validate_python(value)


_ONE: Final = TypeAdapter(Expr)
_THREE: Final = TypeAdapter(tuple[Expr, Expr, Expr])


class VisualEntry(PlacedEntry):
    """Keys of every visual: its place in the body, and a colour."""

    color: Annotated[str, PlainValidator(_color)] = ""


class _Long(VisualEntry):
    """Base class of visuals along an axis."""

    axis: Axis = (ZERO, ZERO, ONE)
    length: Expr
    radius: Expr


class BoxVisual(VisualEntry):
    type: Literal["box"]
    size: VectorEntry


class SphereVisual(VisualEntry):
    type: Literal["sphere"]
    radius: Expr


class EllipsoidVisual(VisualEntry):
    type: Literal["ellipsoid"]
    radii: VectorEntry


class CylinderVisual(_Long):
    type: Literal["cylinder"]


class CapsuleVisual(_Long):
    type: Literal["capsule"]


class MeshVisual(VisualEntry):
    placeholders: ClassVar[dict[str, Any]] = {"file": "mesh"}

    type: Literal["mesh"]
    file: Annotated[str, PlainValidator(_file)]
    scale: Annotated[Any, PlainValidator(_scale)] = ONE


AnyVisual = Annotated[
    BoxVisual | SphereVisual | EllipsoidVisual | CylinderVisual | CapsuleVisual | MeshVisual,
    Field(discriminator="type"),
]
