"""The structure of a model file: its keys, and the kind of value that each key takes.

Each kind of entry is a Pydantic model. Names and values are not known here: numbers become parsed expressions, references
parsed names, and the modules of `sections` resolve them. The types of joints are in `joints`, those of force elements in
`forces`, those of outputs in `outputs`.
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
    shown,
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
        "visuals",
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
    """Keys of every joint between a body and its parent: its frame in the parent, and its rotors."""

    armature: Annotated[tuple[Expr, ...] | None, WrapValidator(_armature)] = None


class LoopJointEntry(Entry):
    """Key of every loop joint: only the type, since the two faces determine the place."""


def _in_role(kind: type[Entry], name: str, role: type[Entry]) -> type[Entry]:
    """The entry class of a joint or condition type under one of its names, for the role of a body's joint or of a loop."""
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
        raise complaint(f"{shown(value)}; give a file by its path from this one: parts/leg.yaml")
    return value


class ShapeEntry(Entry):
    """Keys that every shape has."""

    center: Vector = Origin
    mass: OptionalExpr = None
    density: OptionalExpr = None


class BoxEntry(ShapeEntry):
    type: Literal["box"]
    size: Vector


class LongEntry(ShapeEntry):
    """Keys that every shape along an axis has."""

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
                    "com or inertia is given besides a shape that determines them; give mass too, or leave them to the shape"
                )
            if (shape.mass is None) == (shape.density is None):
                given = "neither mass nor density" if shape.mass is None else "both mass and density"
                raise complaint(f"a shape with {given}; give exactly one if the body has no mass of its own")
        elif shape.mass is not None or shape.density is not None:
            raise complaint(
                "mass is given both in the body and in its shape; with a mass in the body the shape is for display only"
            )
        return self


def _number_or_vector(value: Any) -> Any:
    return _three.validate_python(value) if isinstance(value, (list, tuple)) else _one.validate_python(value)


_one: Final = TypeAdapter(Expr)
_three: Final = TypeAdapter(tuple[Expr, Expr, Expr])
Numbers = Annotated[Any, PlainValidator(_number_or_vector)]
"""A value that is one expression, or a vector of three."""


class ParameterEntry(Entry):
    """A parameter. If it is a vector, a bound that is one number holds for all three components."""

    value: Numbers
    unit: str = ""
    min: Numbers = None
    max: Numbers = None


class SubmodelEntry(PlacedEntry):
    """A submodel: the model file that it uses, and the place of the file's ground."""

    placeholders: ClassVar[dict[str, Any]] = {"use": ""}

    use: Annotated[str, PlainValidator(_check_path)]
    on: Reference = Expression(("name", "ground"))
    given: dict[str, Any] = Field(default={}, alias="with")


class TableEntry(Entry):
    """Points of a function of one number."""

    placeholders: ClassVar[dict[str, Any]] = {"x": ["0", "1"], "y": ["0", "0"], "outside": "constant"}

    x: tuple[Expr, ...]
    y: tuple[Expr, ...]
    kind: Annotated[str, one_of(*KINDS, what="the interpolation between the points")] = "linear"
    outside: Annotated[str, one_of(*OUTSIDE, what="the values beyond the first and last point")]
    period: OptionalExpr = None


class LoopEntry(Entry):
    placeholders: ClassVar[dict[str, Any]] = {"joint": {"type": Fixed.name}, "from": "ground", "to": "ground"}

    joint: LoopJoint
    start: FaceOrName = Field(alias="from")
    end: FaceOrName = Field(alias="to")


def _followed(value: Any, handler: Any) -> Any:
    return handler({value: ONE} if isinstance(value, str) else value)


class CouplingEntry(Entry):
    """A coordinate expressed by other coordinates: ``{joint: wheel, follows: {crank: -z1/z2}, offset: c}``."""

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
"""Outputs whose entry in a model file is only their name, without keys."""


def _keys_of_outputs() -> dict[str, Any]:
    """The keys of all outputs, output by output; a key that several outputs have follows the last of them."""
    keys: dict[str, Any] = {}
    for measure in _KEYED:
        for key, value in measure.keys.items():
            keys.pop(key, None)
            keys[key] = (value, None)
    return keys


def some_of(names: list[str]) -> str:
    """Some names in words: ``a, b or c``."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


class _OneMeasure(Entry):
    """Base class of an output that is a mapping: one measure with its keys."""

    @property
    def measure(self) -> type[Measure]:
        """The first measure whose key the entry gives."""
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
                raise complaint(f"{with_article(key)} is given with {measure.name}; {key} belongs to {some_of(owners)}")
            if not is_given and key in measure.hints:
                raise complaint(f"{measure.name} needs {key}; add {key}: {measure.hints[key]}")
        return self


if TYPE_CHECKING:
    OutputEntry = _OneMeasure
else:
    OutputEntry = create_model("OutputEntry", __base__=_OneMeasure, **_keys_of_outputs())
