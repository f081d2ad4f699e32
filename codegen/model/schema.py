"""The structure of a model file: which keys stand where and what kind of value each takes.

Pydantic models, one for each kind of entry. They know nothing of names and values: numbers arrive as parsed
expressions, references as parsed names, and the modules of `sections` give them their meaning. A new type of joint or
force is a class here, listed in its union, and its conversion there.
"""

from __future__ import annotations

import numbers
from collections.abc import Callable
from typing import Annotated, Any, Final, Literal, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    TypeAdapter,
    ValidationError,
    WrapValidator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from .errors import nearest
from .expressions import FUNCTIONS, Expression, ExpressionError, parse
from .positions import Path_

ZERO: Final = Expression.number(0)
ONE: Final = Expression.number(1)

SECTIONS: Final = (
    *("model", "gravity", "constants", "parameters", "inputs"),
    *("bodies", "points", "loops", "loop_tolerance", "forces", "initial", "independent", "outputs"),
)
LATER_SECTIONS: Final = ("motion",)
LATER_TYPES: Final = {
    "joint": ("screw", "cylindrical", "planar"), "loop joint": ("screw",),
    "force": ("body", "force", "torque", "moment", "wrench", "point"),  # whatever one calls a force on a body
}  # fmt: skip
RESERVED: Final = frozenset({"t", "q", "u", "pi", "ground", *FUNCTIONS})
ENERGIES: Final = ("kinetic_energy", "potential_energy")


def _custom(message: str, column: int | None = None) -> PydanticCustomError:
    return PydanticCustomError("model", "{message}", {"message": message, "column": column or 0})


def seen(value: Any) -> str:
    """A value as messages show it."""
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    if isinstance(value, int) and abs(value) >= 10**60:  # Python does not print those of some thousand digits
        return f"a number of about 10**{int(value.bit_length() * 0.30103)}"
    text = str(value) if isinstance(value, Expression) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _expression(value: Any) -> Expression:
    if type(value) is str:
        try:
            return parse(value)
        except ExpressionError as error:
            raise _custom(f"{seen(value)}: {error.message}", error.column) from None
    if isinstance(value, Expression):
        return value
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        try:
            return Expression.number(int(value) if isinstance(value, numbers.Integral) else float(value))
        except (OverflowError, ValueError):
            raise _custom(f"{seen(value)}; a finite number or an expression is needed") from None
    raise _custom(f"{seen(value)}; a number or an expression is needed")


def _reference(value: Any) -> Expression:
    tree = parse_name(value)
    return Expression(tree)


def parse_name(value: Any, prefix: str = "") -> tuple[Any, ...]:
    """Tree of a name or an indexed name such as ``link(k-1)``, with `prefix` (``q.`` or ``u.``) put before it.

    Raises
    ------
    PydanticCustomError
        A ValueError that says what was seen and what a name is.
    """
    if not isinstance(value, str):
        raise _custom(f"{seen(value)}; a name is needed")
    if not prefix and value in RESERVED:
        return ("name", value)  # "pi" is a number to the parser; who refers to a name decides whether it exists
    try:
        tree = parse(prefix + value).tree
    except ExpressionError:
        tree = ("none",)
    if tree[0] not in ("name", "indexed") or ("." in tree[1] and not prefix):
        raise _custom(
            f"{seen(value)} is no name; a name has letters, digits and _ and begins with no digit, "
            f"and may have repeat indices: link(k)"
        )
    return tree


_LETTERS: Final = {
    sign + letter: tuple(Expression.number((-1 if sign else 1) if k == i else 0) for k in range(3))
    for i, letter in enumerate("xyz")
    for sign in ("", "-")
}


def _axis(value: Any, handler: Callable[[Any], Any]) -> Any:
    if isinstance(value, str):
        if value not in _LETTERS:
            raise _custom(f"{seen(value)} is no axis; x, y, z, -x, -y, -z or a vector [x, y, z] is allowed")
        return _LETTERS[value]
    return handler(value)


def _list_or_one(value: Any, handler: Callable[[Any], Any]) -> Any:
    return handler(value if isinstance(value, (list, tuple)) else (value,))


def _written(value: Any, handler: Callable[[Any], Any]) -> Any:
    """For keys that may be left out: when written they need a value."""
    if value is None:
        raise _custom("nothing after the colon; a value is needed, or leave the key out")
    return handler(value)


Expr = Annotated[Expression, PlainValidator(_expression)]
OptionalExpr = Annotated[Expression | None, PlainValidator(_expression)]
Reference = Annotated[Expression, PlainValidator(_reference)]
Vector = tuple[Expr, Expr, Expr]
Axis = Annotated[Vector, WrapValidator(_axis)]
OptionalVector = Annotated[Vector | None, WrapValidator(_written)]
Origin: Final = (ZERO, ZERO, ZERO)


class Entry(BaseModel):
    """A mapping of the file with fixed keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class Turn(Entry):
    axis: Axis
    angle: Expr


class PlacedEntry(Entry):
    """A frame and where it stands in a body."""

    at: Vector = Origin
    rotate: Annotated[tuple[Turn, ...] | None, WrapValidator(_written)] = None
    rpy: OptionalVector = None

    @model_validator(mode="after")
    def _one_rotation(self) -> PlacedEntry:
        if self.rotate is not None and self.rpy is not None:
            raise _custom("rotate and rpy are both given; one of them is allowed")
        return self


class JointEntry(PlacedEntry):
    """What every joint between a body and its parent has: where it stands in the parent."""


class FixedEntry(JointEntry):
    type: Literal["fixed"]


class RevoluteEntry(JointEntry):
    type: Literal["revolute"]
    axis: Axis


class PrismaticEntry(JointEntry):
    type: Literal["prismatic"]
    axis: Axis


class UniversalEntry(JointEntry):
    type: Literal["universal"]
    axes: tuple[Axis, Axis]


class SphericalEntry(JointEntry):
    type: Literal["spherical"]


class FreeEntry(JointEntry):
    type: Literal["free"]


AnyJoint = Annotated[
    FixedEntry | RevoluteEntry | PrismaticEntry | UniversalEntry | SphericalEntry | FreeEntry,
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
        raise _custom(f"{seen(value)}; error or warn is allowed: whether an impossible inertia stops the model")
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
    parent: Reference
    joint: AnyJoint
    mass: OptionalExpr = None
    com: OptionalVector = None
    inertia: Annotated[InertiaEntry | None, WrapValidator(_written)] = None
    shape: Annotated[AnyShape | None, WrapValidator(_written)] = None

    @model_validator(mode="after")
    def _one_source_of_mass(self) -> BodyEntry:
        shape = self.shape
        if shape is None:
            return self
        if self.mass is None:
            if self.com is not None or self.inertia is not None:
                raise _custom(
                    "com or inertia beside a shape that gives them; give mass too, or leave them to the shape"
                )
            if (shape.mass is None) == (shape.density is None):
                seen = "neither mass nor density" if shape.mass is None else "both mass and density"
                raise _custom(f"a shape with {seen}; exactly one is needed where the body has no mass of its own")
        elif shape.mass is not None or shape.density is not None:
            raise _custom(
                "mass both in the body and in its shape; with a mass in the body the shape is for display only"
            )
        return self


class ParameterEntry(Entry):
    value: Expr
    unit: str = ""
    min: OptionalExpr = None
    max: OptionalExpr = None


class PointEntry(Entry):
    body: Reference
    at: Vector = Origin


def _point(value: Any, handler: Callable[[Any], Any]) -> Any:
    return _reference(value) if isinstance(value, str) else handler(value)


PointOrName = Annotated[PointEntry, WrapValidator(_point)]


class FaceEntry(PlacedEntry):
    """One side of a joint that closes a loop."""

    body: Reference


FaceOrName = Annotated[FaceEntry, WrapValidator(_point)]


class LoopJointEntry(Entry):
    """What every joint that closes a loop has: nothing but its type, since its faces say where it stands."""


class FixedLoop(LoopJointEntry):
    type: Literal["fixed"]


class RevoluteLoop(LoopJointEntry):
    type: Literal["revolute"]
    axis: Axis


class PrismaticLoop(LoopJointEntry):
    type: Literal["prismatic"]
    axis: Axis


class UniversalLoop(LoopJointEntry):
    type: Literal["universal"]
    axes: tuple[Axis, Axis]


class SphericalLoop(LoopJointEntry):
    type: Literal["spherical"]


class PointLoop(LoopJointEntry):
    type: Literal["point"]


class CylindricalLoop(LoopJointEntry):
    type: Literal["cylindrical"]
    axis: Axis


class PlanarLoop(LoopJointEntry):
    type: Literal["planar"]
    normal: Axis


class InlineLoop(LoopJointEntry):
    type: Literal["inline"]
    axis: Axis


AnyLoopJoint = Annotated[
    FixedLoop
    | RevoluteLoop
    | PrismaticLoop
    | UniversalLoop
    | SphericalLoop
    | PointLoop
    | CylindricalLoop
    | PlanarLoop
    | InlineLoop,
    Field(discriminator="type"),
]


class LoopEntry(Entry):
    joint: AnyLoopJoint
    start: FaceOrName = Field(alias="from")
    end: FaceOrName = Field(alias="to")


class JointForceEntry(Entry):
    type: Literal["joint"]
    joint: Reference
    value: Annotated[tuple[Expr, ...], WrapValidator(_list_or_one)]


class SpringEntry(Entry):
    type: Literal["spring"]
    start: PointOrName = Field(alias="from")
    end: PointOrName = Field(alias="to")
    stiffness: Expr
    damping: Expr = ZERO
    free_length: Expr = ZERO


AnyForce = Annotated[JointForceEntry | SpringEntry, Field(discriminator="type")]


class OutputEntry(Entry):
    position: Annotated[PointOrName | None, WrapValidator(_written)] = None
    velocity: Annotated[PointOrName | None, WrapValidator(_written)] = None
    axis: Annotated[Axis | None, WrapValidator(_written)] = None
    value: OptionalExpr = None

    @model_validator(mode="after")
    def _one_measure(self) -> OutputEntry:
        given = [k for k in ("position", "velocity", "value") if getattr(self, k) is not None]
        if len(given) != 1:
            raise _custom(
                f"{' and '.join(given) or 'no measure'}; an output has exactly one of position, velocity, value, "
                f"or is {' or '.join(ENERGIES)}"
            )
        if given == ["value"] and self.axis is not None:
            raise _custom("an axis beside value; axis belongs to position and velocity")
        if given != ["value"] and self.axis is None:
            raise _custom(f"{given[0]} without axis; add axis: x, y, z or a vector in the ground frame")
        return self


_PLACEHOLDERS: Final[dict[type[Entry], dict[str, Any]]] = {
    BodyEntry: {"joint": {"type": "fixed"}, "parent": "ground"},
    PointEntry: {"body": "ground"},
    LoopEntry: {"joint": {"type": "fixed"}, "from": "ground", "to": "ground"},
    SpringEntry: {"from": "ground", "to": "ground", "stiffness": "0"},
}
"""What stands in the place of an obligatory value that is missing or wrong."""


def validate(cls: Any, value: Any) -> Any:
    """An entry of a class, or of one of the classes of a union."""
    adapter = _adapters.get(id(cls))
    if adapter is None:
        adapter = _adapters[id(cls)] = TypeAdapter(cls)
    return adapter.validate_python(value)


_adapters: Final[dict[int, TypeAdapter[Any]]] = {}


def repaired(cls: Any, value: Any, error: ValidationError) -> Any:
    """An entry of `cls` in which everything wrong is left out or replaced, to read what else is in it; or None."""
    if not isinstance(value, dict):
        return None
    choices = _models(cls)
    chosen = next((c for c in choices if len(choices) == 1 or _tag(c) == value.get("type")), None)
    if chosen is None:
        return None
    placeholders = _PLACEHOLDERS.get(chosen, {})
    result = _copied(value)
    for item in error.errors(include_url=False):
        path = _without_alternatives(cls, tuple(item["loc"]))
        if not path:
            result.pop("shape", None)
        elif path[0] in placeholders:
            result[path[0]] = placeholders[str(path[0])]
        elif item["type"] == "extra_forbidden" and _at(result, path[:-1]) is not None:
            _at(result, path[:-1]).pop(path[-1], None)
        elif item["type"] == "model" and _at(result, path[:-1]) is not None:
            _at(result, path[:-1])[path[-1]] = "1"
        else:
            result.pop(path[0], None)
    try:
        return validate(cls, result)
    except ValidationError:
        return None


def _copied(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _copied(v) for k, v in value.items()}
    return [_copied(v) for v in value] if isinstance(value, (list, tuple)) else value


def _at(value: Any, path: Path_) -> Any:
    """The mapping or list at a path, or None."""
    for part in path:
        if not isinstance(value, (dict, list)):
            return None
        try:
            value = value[part]  # type: ignore[index]
        except (KeyError, IndexError, TypeError):
            return None
    return value if isinstance(value, (dict, list)) else None


# --- pydantic's errors in our words -----------------------------------------------------------------------------


def explain(cls: Any, error: ValidationError) -> list[tuple[Path_, str, bool, int]]:
    """What pydantic found, in the words of the format.

    Parameters
    ----------
    cls : type or union
        What `validate` was asked for.
    error : ValidationError

    Returns
    -------
    list of (path, message, at_key, column)
        `path` relative to the entry; `at_key` if the key is wrong and not its value; `column` inside a text, or 0.
    """
    result: list[tuple[Path_, str, bool, int]] = []
    said: set[tuple[Path_, str]] = set()
    items = error.errors(include_url=False)
    unknown = [(tuple(i["loc"][:-1]), str(i["loc"][-1])) for i in items if i["type"] == "extra_forbidden"]
    misspelt = {(loc, _unknown_key(key, _entry_at(cls, loc)).rpartition("; ")[2]) for loc, key in unknown}
    for item in items:
        loc: Path_ = tuple(item["loc"])
        kind, value, context = item["type"], item["input"], item.get("ctx", {})
        here = _entry_at(cls, loc[:-1] if kind in ("missing", "extra_forbidden") else loc)
        shown = _without_alternatives(cls, loc)
        at_key, column = False, 0
        if kind == "model":
            message, column = str(context["message"]), int(context["column"])
        elif kind == "missing" and isinstance(loc[-1], int):
            loc, shown = loc[:-1], shown[:-1]
            message = f"too few numbers; {_wanted(loc)}"
        elif kind in ("too_long", "too_short", "tuple_type", "list_type"):
            message = f"{seen(value)}; {_wanted(loc)}"
        elif kind == "missing":
            if (loc[:-1], f"did you mean {loc[-1]!r}?") in misspelt:
                continue  # said at the misspelt key
            message = f"key {loc[-1]!r} is missing; keys here: {_keys(here)}"
            shown = shown[:-1]
        elif kind == "extra_forbidden":
            message = _unknown_key(str(loc[-1]), here)
            at_key = True
        elif kind == "union_tag_not_found":
            message = f"key 'type' is missing; one of {_tags(_alternatives(cls, loc))} is needed"
        elif kind == "union_tag_invalid":
            message = _unknown_type(value, _alternatives(cls, loc))
            shown = (*shown, "type")
        elif kind in ("model_type", "model_attributes_type", "dict_type"):
            choices = _alternatives(cls, loc)
            keys = f"the keys {_keys(here)}" if len(choices) < 2 else f"a type: one of {_tags(choices)}"
            named = "the name of a point or " if loc and here in (PointEntry, FaceEntry) else ""
            message = f"{seen(value)}; {named}a mapping is needed with {keys}"
        elif kind == "string_type":
            message = f"{seen(value)}; a text is needed"
        else:
            message = f"{seen(value)}: {item['msg']}"
        if (shown, message) not in said:
            said.add((shown, message))
            result.append((shown, message, at_key, column))
    return result


def _wanted(loc: Path_) -> str:
    last = loc[-1] if loc else ""
    if last == "axes":
        return "two axes are needed: [y, x]"
    if last == "rotate":
        return "a list of rotations is needed: [{axis: z, angle: 0.5}]"
    if last in ("axis", "normal") or isinstance(last, int):
        return "x, y, z, -x, -y, -z or a vector [x, y, z] is allowed"
    if last == "rpy":
        return "three angles are needed: [roll, pitch, yaw]"
    return "three numbers are needed: [x, y, z]"


def _fields(cls: type[Entry]) -> dict[str, Any]:
    """What an entry may hold, by the keys of the file."""
    return {f.alias or name: f for name, f in cls.model_fields.items()}


def _keys(cls: type[Entry]) -> str:
    return ", ".join(_fields(cls))


def _unknown_key(key: str, here: type[Entry]) -> str:
    if key in ("first", "last"):
        return f"{key!r} stands only directly inside an entry of a repeat block"
    if issubclass(here, LoopJointEntry) and key in PlacedEntry.model_fields:
        return f"{key!r} does not stand in a loop's joint; from and to place it: from: {{body: arm, {key}: ...}}"
    hint = "; did you mean 'normal'?" if here is PlanarLoop and key == "axis" else nearest(key, _fields(here))
    return f"unknown key {key!r}; keys here: {_keys(here)}{hint}"


def _tag(cls: type[Entry]) -> str:
    return str(get_args(cls.model_fields["type"].annotation)[0])


def _tags(classes: list[type[Entry]]) -> str:
    return ", ".join(_tag(c) for c in classes)


_KINDS: Final[dict[str, type[Entry]]] = {"joint": JointEntry, "loop joint": LoopJointEntry, "shape": ShapeEntry}


def _unknown_type(value: Any, classes: list[type[Entry]]) -> str:
    name = value.get("type") if isinstance(value, dict) else value
    kind = next((k for k, base in _KINDS.items() if issubclass(classes[0], base)), "force")
    if isinstance(name, str) and name in LATER_TYPES.get(kind, ()):
        what = ": forces and torques on bodies come later" if kind == "force" else ""
        return f"{kind} type {name!r} is not supported yet by this version{what}; available: {_tags(classes)}"
    if kind == "loop joint" and isinstance(name, str) and name == "free":
        return f"a free joint sets no condition, so it closes no loop; one of {_tags(classes)} is allowed"
    hint = nearest(name, [_tag(c) for c in classes]) if isinstance(name, str) else ""
    return f"unknown {kind} type {seen(name)}; one of {_tags(classes)} is allowed{hint}"


def _models(annotation: Any) -> list[type[Entry]]:
    if isinstance(annotation, type) and issubclass(annotation, Entry):
        return [annotation]
    return [m for a in get_args(annotation) for m in _models(a)]


def _steps(cls: Any, loc: Path_) -> list[tuple[Any, list[type[Entry]], bool]]:
    """For every part of a location: the part, the entry classes that its value may have, and whether it names one."""
    steps: list[tuple[Any, list[type[Entry]], bool]] = []
    classes = _models(cls)
    for part in loc:
        tagged = [c for c in classes if len(classes) > 1 and "type" in c.model_fields and _tag(c) == part]
        if tagged:
            classes = tagged
            steps.append((part, classes, True))
            continue
        if isinstance(part, str):
            found = [_fields(c)[part].annotation for c in classes if part in _fields(c)]
            if found or len(classes) != 1:
                classes = [m for a in found[:1] for m in _models(a)]
            elif part.startswith("function-") or "[" in part:
                steps.append((part, classes, True))
                continue
        steps.append((part, classes, False))
    return steps


def _alternatives(cls: Any, loc: Path_) -> list[type[Entry]]:
    return _steps(cls, loc)[-1][1] if loc else _models(cls)


def _entry_at(cls: Any, loc: Path_) -> type[Entry]:
    """The class of the mapping that holds (or is) the value at `loc`."""
    entry = _models(cls)[0]
    for _, classes, _alternative in _steps(cls, loc):
        if len(classes) == 1:
            entry = classes[0]
    return entry


def _without_alternatives(cls: Any, loc: Path_) -> Path_:
    return tuple(part for part, _, alternative in _steps(cls, loc) if not alternative)
