"""The structure of a model file: which keys stand where and what kind of value each takes.

Pydantic models, one for each kind of entry. They know nothing of names and values: numbers arrive as parsed
expressions, references as parsed names, and the modules of `sections` give them their meaning. Types of joints
stand in `joints`, of force elements in `forces`, of outputs in `outputs`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, Union

from pydantic import Field, PlainValidator, TypeAdapter, WrapValidator, create_model, model_validator

from .conditions import CONDITIONS
from .entries import (
    ONE,
    ZERO,
    Axis,
    Coordinate,
    Entry,
    Expr,
    FaceOrName,
    OptionalExpr,
    OptionalVector,
    Origin,
    PlacedEntry,
    Reference,
    Vector,
    complaint,
    list_or_one,
    one_of,
    seen,
    written,
)
from .errors import with_article
from .expressions import Expression
from .forces import FORCES, ForceEntry
from .joints import JOINTS, Fixed, JointType
from .outputs import MEASURES, Measure
from .tables import KINDS, OUTSIDE
from .visuals import AnyVisual

SECTIONS: Final = (
    *("model", "include", "gravity", "constants", "parameters", "inputs", "tables", "expressions"),
    *(
        "bodies",
        "motion",
        "submodels",
        "points",
        "loops",
        "couplings",
        "loop_tolerance",
        "forces",
        "initial",
        "independent",
        "outputs",
    ),
)


def _armature(value: Any, handler: Any) -> Any:
    return written(value, lambda given: list_or_one(given, handler))


class JointEntry(PlacedEntry):
    """What every joint between a body and its parent has: where it stands in the parent, and rotors that turn with it."""

    armature: Annotated[tuple[Expr, ...] | None, WrapValidator(_armature)] = None


class LoopJointEntry(Entry):
    """What every joint that closes a loop has: nothing but its type, since its faces say where it stands."""


def _in_role(kind: type[Entry], name: str, role: type[Entry]) -> type[Entry]:
    """The entry of a type of joint, or of condition, under one of its names, for a body or for a loop."""
    tag: Any = Literal[name]
    return create_model(f"{kind.__name__}{role.__name__}", __base__=(kind, role), type=(tag, ...))


if TYPE_CHECKING:

    class BodyJoint(JointType, JointEntry):
        """A joint that carries a body."""

    class LoopJoint(JointType, LoopJointEntry):
        """A joint, or a condition on a point, that closes a loop."""

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
            + tuple(_in_role(kind, kind.name, LoopJointEntry) for kind in CONDITIONS.values())
        ],
        Field(discriminator="type"),
    ]


def _check_path(value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise complaint(f"{seen(value)}; a file is needed, by its path from this one: parts/leg.yaml")
    return value


class ShapeEntry(Entry):
    """What every shape has."""

    center: Vector = Origin
    mass: OptionalExpr = None
    density: OptionalExpr = None


class BoxEntry(ShapeEntry):
    type: Literal["box"]
    size: Vector


class LongEntry(ShapeEntry):
    """What every shape along an axis has."""

    type: str
    axis: Axis
    length: Expr


class CylinderEntry(LongEntry):
    type: Literal["cylinder"]
    radius: Expr


class CapsuleEntry(LongEntry):
    type: Literal["capsule"]
    radius: Expr


class SphereEntry(ShapeEntry):
    type: Literal["sphere"]
    radius: Expr


class RodEntry(LongEntry):
    type: Literal["rod"]


AnyShape = Annotated[BoxEntry | CylinderEntry | CapsuleEntry | SphereEntry | RodEntry, Field(discriminator="type")]


class InertiaEntry(Entry):
    xx: Expr = ZERO
    yy: Expr = ZERO
    zz: Expr = ZERO
    xy: Expr = ZERO
    xz: Expr = ZERO
    yz: Expr = ZERO
    check: Annotated[str, one_of("error", "warn", what="whether an impossible inertia stops the model")] = "error"


class BodyEntry(Entry):
    placeholders: ClassVar[dict[str, Any]] = {"joint": {"type": Fixed.name}, "parent": "ground"}

    parent: Reference
    joint: BodyJoint
    mass: OptionalExpr = None
    com: OptionalVector = None
    inertia: Annotated[InertiaEntry | None, WrapValidator(written)] = None
    shape: Annotated[AnyShape | None, WrapValidator(written)] = None
    visuals: Annotated[tuple[AnyVisual, ...] | None, WrapValidator(written)] = None

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


def _number_or_vector(value: Any) -> Any:
    return _three.validate_python(value) if isinstance(value, (list, tuple)) else _one.validate_python(value)


_one: Final = TypeAdapter(Expr)
_three: Final = TypeAdapter(tuple[Expr, Expr, Expr])
Numbers = Annotated[Any, PlainValidator(_number_or_vector)]
"""An expression, or three: a vector."""


class ParameterEntry(Entry):
    """A parameter with all that may be said of it. Of a vector, a bound that is one number holds for all three."""

    value: Numbers
    unit: str = ""
    min: Numbers = None
    max: Numbers = None


class SubmodelEntry(PlacedEntry):
    """A file that is read once more, and where its ground stands."""

    placeholders: ClassVar[dict[str, Any]] = {"use": ""}

    use: Annotated[str, PlainValidator(_check_path)]
    on: Reference = Expression(("name", "ground"))
    given: dict[str, Any] = Field(default={}, alias="with")


class TableEntry(Entry):
    """Points of a function of one number."""

    placeholders: ClassVar[dict[str, Any]] = {"x": ["0", "1"], "y": ["0", "0"], "outside": "constant"}

    x: tuple[Expr, ...]
    y: tuple[Expr, ...]
    kind: Annotated[str, one_of(*KINDS, what="what lies between the points")] = "linear"
    outside: Annotated[str, one_of(*OUTSIDE, what="what lies beyond the first and last point")]
    period: OptionalExpr = None


class LoopEntry(Entry):
    placeholders: ClassVar[dict[str, Any]] = {"joint": {"type": Fixed.name}, "from": "ground", "to": "ground"}

    joint: LoopJoint
    start: FaceOrName = Field(alias="from")
    end: FaceOrName = Field(alias="to")


def _followed(value: Any, handler: Any) -> Any:
    return handler({value: ONE} if isinstance(value, str) else value)


class CouplingEntry(Entry):
    """A coordinate by others: ``{joint: wheel, follows: {crank: -z1/z2}, offset: c}``."""

    placeholders: ClassVar[dict[str, Any]] = {"joint": "joint", "follows": {}}

    joint: Coordinate
    follows: Annotated[dict[str, Expr], WrapValidator(_followed)]
    offset: Expr = ZERO


if TYPE_CHECKING:
    AnyForce = ForceEntry
else:
    AnyForce = Annotated[Union[FORCES], Field(discriminator="type")]  # noqa: UP007

_KEYED: Final = [measure for measure in MEASURES.values() if measure.keys]
ENERGIES: Final = tuple(measure.name for measure in MEASURES.values() if not measure.keys)
"""Outputs that are written as their name alone."""


def _keys_of_outputs() -> dict[str, Any]:
    """All keys of outputs, those that several share behind the last of these."""
    keys: dict[str, Any] = {}
    for measure in _KEYED:
        for key, value in measure.keys.items():
            keys.pop(key, None)
            keys[key] = (value, None)
    return keys


def some_of(names: list[str]) -> str:
    """A list of names in words."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


class _OneMeasure(Entry):
    """What every output is that is a mapping: one of the measures with a key."""

    @property
    def measure(self) -> type[Measure]:
        """The first of those whose key is given."""
        return next(measure for measure in _KEYED if getattr(self, measure.name) is not None)

    @model_validator(mode="after")
    def _one_measure(self) -> _OneMeasure:
        given = [measure.name for measure in _KEYED if getattr(self, measure.name) is not None]
        if len(given) != 1:
            raise complaint(
                f"{' and '.join(given) or 'no measure'}; an output has exactly one of "
                f"{', '.join(measure.name for measure in _KEYED)}, or is {' or '.join(ENERGIES)}"
            )
        measure = self.measure
        for key in type(self).model_fields:
            is_given = getattr(self, key) is not None
            if is_given and key not in measure.keys:
                owners = [other.name for other in _KEYED if key in other.keys]
                raise complaint(f"{with_article(key)} beside {measure.name}; {key} belongs to {some_of(owners)}")
            if not is_given and key in measure.hints:
                raise complaint(f"{measure.name} without {key}; add {key}: {measure.hints[key]}")
        return self


if TYPE_CHECKING:
    OutputEntry = _OneMeasure
else:
    OutputEntry = create_model("OutputEntry", __base__=_OneMeasure, **_keys_of_outputs())
