"""The types of outputs: a new one is a class here, a value in `reference.outputs`, statements in `mechanics.outputs`."""

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
    seen,
    written,
)
from .entry_reader import EntryReader
from .expressions import Expression
from .places import GROUND, Point

IN_GROUND: Final = {"axis": "x, y, z or a vector in the ground frame"}
"""The hint of measures along an axis of the ground."""


@dataclass(frozen=True, slots=True, eq=False)
class Output:
    """A named scalar of interest.

    Attributes
    ----------
    measure : str
        What of: a name of `outputs.MEASURES`.
    points, axis, expression, bodies
        Those that it has; the axis is not normalised, bodies are indices of `Model.bodies` or `GROUND`.
    choice : tuple of str
        What its measure lets one choose by words, such as the entry of a matrix.
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
        """The bodies that it is about: those of its points, then its own; each once."""
        return tuple(dict.fromkeys((*(p.body for p in self.points), *self.bodies)))


class Speaker(Protocol):
    """Says what an output is made of; see `codegen.listing`."""

    def name(self, body: int) -> str:
        """Of a body, or ``ground``."""

    def point(self, point: Point) -> str:
        """A point."""

    def axis(self, axis: Vector) -> str:
        """A direction."""

    def long(self, expression: Expression) -> str:
        """An expression."""


class Measure:
    """A type of output.

    Attributes
    ----------
    name : str
        The key that it has, or what stands in the place of a mapping.
    keys : dict of str to type
        What a mapping holds; the first key is its name. Without keys it is written as its name alone.
    hints : dict of str to str
        For keys that have to stand beside the first: what to add.
    unit : str
        Empty for what has none, or none that is known.
    """

    name: ClassVar[str]
    keys: ClassVar[dict[str, Any]] = {}
    hints: ClassVar[dict[str, str]] = {}
    unit: ClassVar[str] = ""

    @classmethod
    def unit_of(cls, output: Output) -> str:
        """The unit of an output; `unit`, where all have the same."""
        return cls.unit

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        """The output of an entry (None for one without keys), or None after a problem."""
        return Output(x.name, cls.name)

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        """What it is, for people."""
        found = cls.name.replace("_", " ")
        if output.points:
            found += f" of {' and '.join(map(say.point, output.points))}"
        return found + along(output, say)


def along(output: Output, say: Speaker) -> str:
    """`` along x`` of an output that has an axis."""
    return "" if output.axis is None else f" along {say.axis(output.axis)}"


OptionalPoint = Annotated[PointOrName | None, WrapValidator(written)]
OptionalAxis = Annotated[Axis | None, WrapValidator(written)]
OptionalBody = Annotated[Reference | None, WrapValidator(written)]


def _two(value: Any, handler: Callable[[Any], Any]) -> Any:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise complaint(f"{seen(value)}; a list of two points is needed, such as [tip, ground]")
    return handler(value)


TwoPoints = Annotated[tuple[PointOrName, PointOrName] | None, WrapValidator(_two)]


def word(*allowed: str) -> Any:
    """One of some words, or left out."""
    return Annotated[str | None, one_of(*allowed)]


class OfPoints(Measure):
    """What is measured of one point, or of two, most of it along an axis of the ground frame."""

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
    """Of a point in the ground frame, along an axis, m."""

    name = "position"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"position": OptionalPoint, "axis": OptionalAxis}


class Velocity(OfPoints):
    """Its derivative in time, m/s."""

    name = "velocity"
    unit = "m/s"
    keys: ClassVar[dict[str, Any]] = {"velocity": OptionalPoint, "axis": OptionalAxis}


class Acceleration(OfPoints):
    """Of a point against the ground, along an axis of it, m/s^2."""

    name = "acceleration"
    unit = "m/s^2"
    keys: ClassVar[dict[str, Any]] = {"acceleration": OptionalPoint, "axis": OptionalAxis}


class RelativePosition(OfPoints):
    """From the first point to the second, along an axis of the ground frame, m."""

    name = "relative_position"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"relative_position": TwoPoints, "axis": OptionalAxis}

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        first, second = map(say.point, output.points)
        return f"{cls.name.replace('_', ' ')} from {first} to {second}{along(output, say)}"


class RelativeVelocity(RelativePosition):
    """Its derivative in time, m/s."""

    name = "relative_velocity"
    unit = "m/s"
    keys: ClassVar[dict[str, Any]] = {"relative_velocity": TwoPoints, "axis": OptionalAxis}


class Distance(OfPoints):
    """Of two points of different bodies, m. Where they coincide it has no derivative."""

    name = "distance"
    unit = "m"
    keys: ClassVar[dict[str, Any]] = {"distance": TwoPoints}
    hints: ClassVar[dict[str, str]] = {}

    @classmethod
    def read(cls, entry: Any, x: EntryReader) -> Output | None:
        found = super().read(entry, x)
        if found is not None and found.points[0].body == found.points[1].body:
            x.report(
                (cls.name,), "two points of one body, whose distance does not change; points of two bodies are needed"
            )
            return None
        return found


QUATERNION: Final = ("qw", "qx", "qy", "qz")
MATRIX: Final = tuple(a + b for a in "xyz" for b in "xyz")


class Rotation(Measure):
    """Of a body against the ground or another body: an entry of its quaternion, or of its matrix by row and column."""

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
            x.report(at, "rotation of a body relative to itself, which is none; two different ones are needed")
            return None
        return Output(x.name, cls.name, bodies=(body, other), choice=(entry.entry,))

    @classmethod
    def words(cls, output: Output, say: Speaker) -> str:
        body, other = map(say.name, output.bodies)
        return f"rotation of {body} relative to {other}, {output.choice[0]}"


FRAMES: Final = ("ground", "body")


class AngularVelocity(Measure):
    """Of a body against the ground, along an axis of the ground frame or of the body, rad/s."""

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
MASSLESS = "nothing has mass at the default parameters, so there is no centre of mass; give a body some"


def _bodies(value: Any, handler: Callable[[Any], Any]) -> Any:
    if value == SYSTEM:
        return SYSTEM
    if not isinstance(value, (list, tuple)) or not value:
        raise complaint(f"{seen(value)}; system or a list of bodies, such as [hull, arm], is allowed")
    return handler(value)


SystemOrBodies = Annotated[tuple[Reference, ...] | None, WrapValidator(_bodies)]


class CenterOfMass(Measure):
    """In the ground frame, along an axis, m. The system is all bodies, those that are fixed to the ground too."""

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
                what = "the ground, which has no mass" if body == GROUND else "a body that is in the list already"
                x.report((cls.name, i), f"{what}; every body of the list counts once")
                return None
            bodies.append(body)
        if x.mass(bodies) == 0:
            x.report(
                (cls.name,), "bodies without mass at the default parameters have no centre of mass; add one with mass"
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
    """Of all bodies, along an axis of the ground frame: kg m/s, or kg m^2/s about the ground's origin or the centre of mass."""

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
                "about beside linear momentum, which is about no point; leave it out, or take momentum: angular",
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
    """Of a prescribed coordinate: the generalised force, N m or N, that acts on it beside the model's own forces."""

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
    """Of p, inputs, t, q.x and u.x."""

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
    """Of all bodies."""

    name = "kinetic_energy"
    unit = "J"


class PotentialEnergy(Measure):
    """Of gravity, zero at the ground's origin, and of force elements."""

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
"""By name, in the order in which messages list them."""
