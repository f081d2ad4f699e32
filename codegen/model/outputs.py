"""The types of outputs. A new one is a class here, a value in `reference.outputs`, and statements in `mechanics.outputs`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final, Protocol

from pydantic import WrapValidator

from .axes import Vector
from .entries import (
    Axis,
    OptionalCoordinate,
    OptionalExpr,
    PointOrName,
    Reference,
    complaint,
    one_of,
    shown,
    written,
)
from .entry_reader import EntryReader
from .expressions import Expression
from .places import GROUND, Point

IN_GROUND: Final = {"axis": "x, y, z or a vector in the ground frame"}
"""The hint for measures along an axis of the ground."""


@dataclass(frozen=True, slots=True, eq=False)
class Output:
    """A named scalar output.

    Attributes
    ----------
    measure : str
        The measured quantity: a name of `outputs.MEASURES`.
    points, axis, expression, bodies
        Present if the measure has them; the axis is not normalised, bodies are indices of `Model.bodies` or `GROUND`.
    choice : tuple of str
        Options of the measure given by words, such as the entry of a matrix.
    """

    name: str
    measure: str
    points: tuple[Point, ...] = ()
    axis: Vector | None = None
    expression: Expression | None = None
    bodies: tuple[int, ...] = ()
    choice: tuple[str, ...] = ()

    def expressions(self) -> Iterator[Expression]:
        for point in self.points:
            yield from point.at
        if self.axis:
            yield from self.axis
        if self.expression:
            yield self.expression

    @property
    def on(self) -> tuple[int, ...]:
        """The bodies on which the output depends, each once: the bodies of its points, then its own bodies."""
        return tuple(dict.fromkeys((*(p.body for p in self.points), *self.bodies)))


class Speaker(Protocol):
    """Describes the parts of an output in words; see `codegen.listing`."""

    def name(self, body: int) -> str:
        """The name of a body in words, or ``ground``."""

    def point(self, point: Point) -> str:
        """Description of a point in words."""

    def axis(self, axis: Vector) -> str:
        """Description of a direction in words."""

    def long(self, expression: Expression) -> str:
        """Text of an expression, or its value if the text is long."""


class Measure:
    """A type of output.

    Attributes
    ----------
    name : str
        Its first key, or the word that replaces a mapping.
    keys : dict of str to type
        Keys of its mapping; the first is its name. Without keys an entry is its name alone.
    hints : dict of str to str
        For each key that is required besides the first: the value to add, for messages.
    unit : str
        Empty if it has none, or if the unit is not known.
    """

    name: ClassVar[str]
    keys: ClassVar[dict[str, Any]] = {}
    hints: ClassVar[dict[str, str]] = {}
    unit: ClassVar[str] = ""

    @classmethod
    def unit_of(cls, output: Output) -> str:
        """The unit of an output; by default `unit`, which all outputs of the type have."""
        return cls.unit

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        """The output that an entry describes; None after an error. `entry` is None for a type without keys."""
        return Output(x.name, cls.name)

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        """Description of an output for users."""
        found = cls.name.replace("_", " ")
        if output.points:
            found += f" of {' and '.join(map(say.point, output.points))}"
        return found + along(output, say)


def along(output: Output, say: Speaker) -> str:
    """The words `` along x`` if the output has an axis."""
    return "" if output.axis is None else f" along {say.axis(output.axis)}"


OptionalPoint = Annotated[PointOrName | None, WrapValidator(written)]
OptionalAxis = Annotated[Axis | None, WrapValidator(written)]
OptionalBody = Annotated[Reference | None, WrapValidator(written)]


def _two(value: Any, handler: Callable[[Any], Any]) -> Any:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise complaint(f"{shown(value)}; a list of two points is needed, such as [tip, ground]")
    return handler(value)


TwoPoints = Annotated[tuple[PointOrName, PointOrName] | None, WrapValidator(_two)]


def word(*allowed: str) -> Any:
    """The type of an entry that may be one of the given words, or absent."""
    return Annotated[str | None, one_of(*allowed)]


class OfPoints(Measure):
    """A quantity of one point, or of two, usually along an axis of the ground frame."""

    hints: ClassVar[dict[str, str]] = IN_GROUND

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        axis = x.direction(entry.axis, "axis") if "axis" in cls.keys else None
        given = getattr(entry, cls.name)
        if isinstance(given, tuple):
            points = [x.point(p, (cls.name, i), x.name) for i, p in enumerate(given)]
        else:
            points = [x.point(given, cls.name, x.name)]
        known = tuple(p for p in points if p is not None)
        return Output(x.name, cls.name, known, axis) if len(known) == len(points) else None


class Position(OfPoints):
    """Position of a point in the ground frame, along an axis, m."""

    name = "position"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"position": OptionalPoint, "axis": OptionalAxis}


class Velocity(OfPoints):
    """Velocity of a point in the ground frame, along an axis, m/s."""

    name = "velocity"
    unit = "m/s"
    keys: ClassVar[dict[str, Any]] = {"velocity": OptionalPoint, "axis": OptionalAxis}


class Acceleration(OfPoints):
    """Acceleration of a point in the ground frame, along an axis, m/s^2."""

    name = "acceleration"
    unit = "m/s^2"
    keys: ClassVar[dict[str, Any]] = {"acceleration": OptionalPoint, "axis": OptionalAxis}


class RelativePosition(OfPoints):
    """Vector from the first point to the second, along an axis of the ground frame, m."""

    name = "relative_position"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"relative_position": TwoPoints, "axis": OptionalAxis}

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        first, second = map(say.point, output.points)
        return f"{cls.name.replace('_', ' ')} from {first} to {second}{along(output, say)}"


class RelativeVelocity(RelativePosition):
    """Time derivative of a relative position, m/s."""

    name = "relative_velocity"
    unit = "m/s"
    keys: ClassVar[dict[str, Any]] = {"relative_velocity": TwoPoints, "axis": OptionalAxis}


class Distance(OfPoints):
    """Distance of two points on different bodies, m. The distance has no derivative where the points coincide."""

    name = "distance"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"distance": TwoPoints}
    hints: ClassVar[dict[str, str]] = {}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        found = super().read(entry, x)
        if found is not None and found.points[0].body == found.points[1].body:
            x.report((cls.name,), "two points of one body have a constant distance; points of two bodies are needed")
            return None
        return found


QUATERNION: Final = ("qw", "qx", "qy", "qz")
MATRIX: Final = tuple(a + b for a in "xyz" for b in "xyz")


class Rotation(Measure):
    """Rotation of a body relative to the ground or another body: an entry of its quaternion, or of its rotation matrix."""

    name = "rotation"
    keys: ClassVar[dict[str, Any]] = {
        "rotation": OptionalBody,
        "entry": word(*QUATERNION, *MATRIX),
        "relative_to": OptionalBody,
    }
    hints: ClassVar[dict[str, str]] = {"entry": "qw, qx, qy, qz of the quaternion, or xx, xy, ... zz of the matrix"}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        body = x.body(entry.rotation, "rotation")
        other = GROUND if entry.relative_to is None else x.body(entry.relative_to, "relative_to")
        if body is None or other is None:
            return None
        if body == other:
            at = ("rotation",) if entry.relative_to is None else ("relative_to",)
            x.report(at, "the rotation of a body relative to itself is constant; two different bodies are needed")
            return None
        return Output(x.name, cls.name, bodies=(body, other), choice=(entry.entry,))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        body, other = map(say.name, output.bodies)
        return f"rotation of {body} relative to {other}, {output.choice[0]}"


FRAMES: Final = ("ground", "body")


class AngularVelocity(Measure):
    """Angular velocity of a body relative to the ground, along an axis of the ground frame or of the body, rad/s."""

    name = "angular_velocity"
    unit = "rad/s"
    keys: ClassVar[dict[str, Any]] = {
        "angular_velocity": OptionalBody,
        "axis": OptionalAxis,
        "frame": word(*FRAMES),
    }
    hints: ClassVar[dict[str, str]] = {"axis": "x, y, z or a vector, in the ground frame or in that of the body"}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        axis = x.direction(entry.axis, "axis")
        body = x.body(entry.angular_velocity, "angular_velocity")
        if body is None:
            return None
        return Output(x.name, cls.name, axis=axis, bodies=(body,), choice=(entry.frame or FRAMES[0],))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        (body,) = map(say.name, output.bodies)
        return f"angular velocity of {body}{along(output, say)} of the {output.choice[0]}"


SYSTEM = "system"
MASSLESS = "no body has mass at the default parameters, so there is no centre of mass; give a body mass"


def _bodies(value: Any, handler: Callable[[Any], Any]) -> Any:
    if value == SYSTEM:
        return SYSTEM
    if not isinstance(value, (list, tuple)) or not value:
        raise complaint(f"{shown(value)}; system or a list of bodies, such as [hull, arm], is allowed")
    return handler(value)


SystemOrBodies = Annotated[tuple[Reference, ...] | None, WrapValidator(_bodies)]


class CenterOfMass(Measure):
    """Centre of mass in the ground frame, along an axis, m. The system is all bodies, including those fixed to the ground."""

    name = "center_of_mass"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"center_of_mass": SystemOrBodies, "axis": OptionalAxis}
    hints: ClassVar[dict[str, str]] = IN_GROUND

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        axis = x.direction(entry.axis, "axis")
        if entry.center_of_mass == SYSTEM:
            if x.mass() == 0:
                x.report((cls.name,), MASSLESS)
                return None
            return Output(x.name, cls.name, axis=axis)
        bodies: list[int] = []
        for i, reference in enumerate(entry.center_of_mass):
            body = x.body(reference, cls.name, i)
            if body is None:
                return None
            if body == GROUND or body in bodies:
                what = "the ground, which has no mass" if body == GROUND else "a body that is already in the list"
                x.report((cls.name, i), f"{what}; list each body once")
                return None
            bodies.append(body)
        if x.mass(bodies) == 0:
            x.report(
                (cls.name,),
                "these bodies have no mass at the default parameters, so no centre of mass; add one with mass",
            )
            return None
        return Output(x.name, cls.name, axis=axis, bodies=tuple(bodies))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        of = ", ".join(map(say.name, output.bodies)) or "the system"
        return f"centre of mass of {of}{along(output, say)}"


KINDS: Final = ("linear", "angular")
CENTERS: Final = ("ground", "center_of_mass")


class Momentum(Measure):
    """Linear momentum of all bodies along an axis of the ground, kg m/s; or angular momentum about the ground's origin or the
    centre of mass, kg m^2/s."""

    name = "momentum"
    keys: ClassVar[dict[str, Any]] = {"momentum": word(*KINDS), "axis": OptionalAxis, "about": word(*CENTERS)}
    hints: ClassVar[dict[str, str]] = IN_GROUND

    @classmethod
    def unit_of(cls, output: Output) -> str:
        return "kg m/s" if output.choice[0] == "linear" else "kg m^2/s"

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        axis = x.direction(entry.axis, "axis")
        if entry.momentum == "linear" and entry.about is not None:
            x.report(
                ("about",),
                "linear momentum does not refer to a point, so about is not allowed; leave it out, or use momentum: angular",
            )
            return None
        about = CENTERS[0] if entry.about is None else entry.about
        if about == "center_of_mass" and x.mass() == 0:
            x.report(("about",), MASSLESS)
            return None
        return Output(x.name, cls.name, axis=axis, choice=(entry.momentum, about))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        kind, about = output.choice
        center = {"ground": "the ground's origin", "center_of_mass": "the centre of mass"}[about]
        found = f"{kind} momentum{along(output, say)}"
        return found if kind == "linear" else f"{found} about {center}"


class DrivingForce(Measure):
    """Generalised force of a prescribed coordinate, N m or N, in addition to the model's own forces."""

    name = "driving_force"
    keys: ClassVar[dict[str, Any]] = {"driving_force": OptionalCoordinate}

    @classmethod
    def unit_of(cls, output: Output) -> str:
        return output.choice[1]

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        found = x.prescribed(entry.driving_force, cls.name)
        return None if found is None else Output(x.name, cls.name, choice=found)

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        return f"driving force of {output.choice[0]}"


class Value(Measure):
    """Value of an expression of p, inputs, t, q.x and u.x."""

    name = "value"
    keys: ClassVar[dict[str, Any]] = {"value": OptionalExpr}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output:
        return Output(x.name, cls.name, expression=x.bound(entry.value, "value", scope="motion"))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        assert output.expression is not None
        return say.long(output.expression)


class KineticEnergy(Measure):
    """Kinetic energy of all bodies."""

    name = "kinetic_energy"
    unit = "J"


class PotentialEnergy(Measure):
    """Potential energy of gravity, zero at the ground's origin, and of force elements."""

    name = "potential_energy"
    unit = "J"


MEASURES: Final[dict[str, type[Measure]]] = {
    kind.name: kind
    for kind in (
        Position,
        Velocity,
        Rotation,
        AngularVelocity,
        Acceleration,
        CenterOfMass,
        Momentum,
        Distance,
        RelativePosition,
        RelativeVelocity,
        DrivingForce,
        Value,
        KineticEnergy,
        PotentialEnergy,
    )
}
"""Types of outputs by name, in the order in which messages list the types."""
