"""The structure of a model file: which keys stand where and what kind of value each takes.

Pydantic models, one for each kind of entry. They know nothing of names and values: numbers arrive as parsed
expressions, references as parsed names, and the modules of `sections` give them their meaning. Types of joints
stand in `joints`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, Union

from pydantic import Field, PlainValidator, WrapValidator, create_model, model_validator

from .entries import (
    ZERO,
    Axis,
    Entry,
    Expr,
    FaceOrName,
    OptionalExpr,
    OptionalVector,
    Origin,
    PlacedEntry,
    PointOrName,
    Reference,
    Vector,
    complaint,
    list_or_one,
    seen,
    written,
)
from .joints import JOINTS, JointType
from .joints.fixed import Fixed

SECTIONS: Final = (
    *("model", "gravity", "constants", "parameters", "inputs"),
    *("bodies", "points", "loops", "loop_tolerance", "forces", "initial", "independent", "outputs"),
)
LATER_SECTIONS: Final = ("motion",)
LATER_FORCES: Final = ("body", "force", "torque", "moment", "wrench", "point")
"""Whatever one calls a force on a body."""
ENERGIES: Final = ("kinetic_energy", "potential_energy")


class JointEntry(PlacedEntry):
    """What every joint between a body and its parent has: where it stands in the parent."""


class LoopJointEntry(Entry):
    """What every joint that closes a loop has: nothing but its type, since its faces say where it stands."""


def _in_role(kind: type[JointType], name: str, role: type[Entry]) -> type[Entry]:
    """The entry of a type of joint under one of its names, for a body or for a loop."""
    tag: Any = Literal[name]
    return create_model(f"{kind.__name__}{role.__name__}", __base__=(kind, role), type=(tag, ...))


if TYPE_CHECKING:

    class BodyJoint(JointType, JointEntry):
        """A joint that carries a body."""

    class LoopJoint(JointType, LoopJointEntry):
        """A joint that closes a loop."""

else:
    BodyJoint = Annotated[
        Union[tuple(_in_role(kind, kind.name, JointEntry) for kind in JOINTS.values() if kind.carries)],  # noqa: UP007
        Field(discriminator="type"),
    ]
    LoopJoint = Annotated[
        Union[  # noqa: UP007
            tuple(
                _in_role(kind, name, LoopJointEntry)
                for kind in JOINTS.values()
                if kind.closure
                for name in (kind.name, *kind.synonyms)
            )
        ],
        Field(discriminator="type"),
    ]


class ShapeEntry(Entry):
    """What every shape has."""

    center: Vector = Origin
    mass: OptionalExpr = None
    density: OptionalExpr = None


class BoxEntry(ShapeEntry):
    type: Literal["box"]
    size: Vector


class CylinderEntry(ShapeEntry):
    type: Literal["cylinder"]
    axis: Axis
    length: Expr
    radius: Expr


class CapsuleEntry(ShapeEntry):
    type: Literal["capsule"]
    axis: Axis
    length: Expr
    radius: Expr


class SphereEntry(ShapeEntry):
    type: Literal["sphere"]
    radius: Expr


class RodEntry(ShapeEntry):
    type: Literal["rod"]
    axis: Axis
    length: Expr


AnyShape = Annotated[BoxEntry | CylinderEntry | CapsuleEntry | SphereEntry | RodEntry, Field(discriminator="type")]


def _check_mode(value: Any) -> str:
    if value not in ("error", "warn"):
        raise complaint(f"{seen(value)}; error or warn is allowed: whether an impossible inertia stops the model")
    return str(value)


class InertiaEntry(Entry):
    xx: Expr = ZERO
    yy: Expr = ZERO
    zz: Expr = ZERO
    xy: Expr = ZERO
    xz: Expr = ZERO
    yz: Expr = ZERO
    check: Annotated[str, PlainValidator(_check_mode)] = "error"


class BodyEntry(Entry):
    placeholders: ClassVar[dict[str, Any]] = {"joint": {"type": Fixed.name}, "parent": "ground"}

    parent: Reference
    joint: BodyJoint
    mass: OptionalExpr = None
    com: OptionalVector = None
    inertia: Annotated[InertiaEntry | None, WrapValidator(written)] = None
    shape: Annotated[AnyShape | None, WrapValidator(written)] = None

    @model_validator(mode="after")
    def _one_source_of_mass(self) -> BodyEntry:
        shape = self.shape
        if shape is None:
            return self
        if self.mass is None:
            if self.com is not None or self.inertia is not None:
                raise complaint(
                    "com or inertia beside a shape that gives them; give mass too, or leave them to the shape"
                )
            if (shape.mass is None) == (shape.density is None):
                seen = "neither mass nor density" if shape.mass is None else "both mass and density"
                raise complaint(f"a shape with {seen}; exactly one is needed where the body has no mass of its own")
        elif shape.mass is not None or shape.density is not None:
            raise complaint(
                "mass both in the body and in its shape; with a mass in the body the shape is for display only"
            )
        return self


class ParameterEntry(Entry):
    value: Expr
    unit: str = ""
    min: OptionalExpr = None
    max: OptionalExpr = None


class LoopEntry(Entry):
    placeholders: ClassVar[dict[str, Any]] = {"joint": {"type": Fixed.name}, "from": "ground", "to": "ground"}

    joint: LoopJoint
    start: FaceOrName = Field(alias="from")
    end: FaceOrName = Field(alias="to")


class JointForceEntry(Entry):
    type: Literal["joint"]
    joint: Reference
    value: Annotated[tuple[Expr, ...], WrapValidator(list_or_one)]


class SpringEntry(Entry):
    placeholders: ClassVar[dict[str, Any]] = {"from": "ground", "to": "ground", "stiffness": "0"}

    type: Literal["spring"]
    start: PointOrName = Field(alias="from")
    end: PointOrName = Field(alias="to")
    stiffness: Expr
    damping: Expr = ZERO
    free_length: Expr = ZERO


AnyForce = Annotated[JointForceEntry | SpringEntry, Field(discriminator="type")]


class OutputEntry(Entry):
    position: Annotated[PointOrName | None, WrapValidator(written)] = None
    velocity: Annotated[PointOrName | None, WrapValidator(written)] = None
    axis: Annotated[Axis | None, WrapValidator(written)] = None
    value: OptionalExpr = None

    @model_validator(mode="after")
    def _one_measure(self) -> OutputEntry:
        given = [k for k in ("position", "velocity", "value") if getattr(self, k) is not None]
        if len(given) != 1:
            raise complaint(
                f"{' and '.join(given) or 'no measure'}; an output has exactly one of position, velocity, value, "
                f"or is {' or '.join(ENERGIES)}"
            )
        if given == ["value"] and self.axis is not None:
            raise complaint("an axis beside value; axis belongs to position and velocity")
        if given != ["value"] and self.axis is None:
            raise complaint(f"{given[0]} without axis; add axis: x, y, z or a vector in the ground frame")
        return self
