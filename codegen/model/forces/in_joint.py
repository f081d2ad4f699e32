"""Forces along the degrees of freedom of a joint: motors, loads that depend on points, and laws such as friction and limits."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import WrapValidator

from ..axes import Vector, signed_base
from ..entries import ZERO, Expr, OptionalExpr, Reference, list_or_one
from ..entry_reader import EntryReader
from ..errors import count_of_values
from ..expressions import Expression, made
from ..motions import Ball, Displacement, Slide, Turn
from ..places import Face, Point
from .force_element import ForceElement, ForceEntry


@dataclass(frozen=True, slots=True, eq=False)
class JointLoad(ForceElement):
    """A force through the origin of a body, and a torque on it, equivalent to generalised forces on the body's joint.

    Attributes
    ----------
    body, joint : Face
        The body, and its joint's frame in the parent, on which the opposite acts at the same position.
    values : tuple of twelve Expression
        Torque and force along axes of the joint's frame, then both along axes of the body.
    """

    type: ClassVar[str] = "force in joint"
    keys: ClassVar[tuple[str, ...]] = tuple(
        f"{key}[{i}]" for key in ("torque", "force", "own_torque", "own_force") for i in range(3)
    )

    body: Face
    joint: Face
    values: tuple[Expression, ...]

    @property
    def ends(self) -> tuple[Point | Face, ...]:
        return self.body, self.joint

    @property
    def coefficients(self) -> tuple[Expression, ...]:
        return self.values


def along_freedoms(
    motion: tuple[object, ...], axes: tuple[Vector, ...], values: tuple[Expression, ...]
) -> tuple[Expression, ...]:
    """The twelve components of a `JointLoad` from generalised forces on the speeds of a joint.

    Axes up to the first rotation of the chain are fixed in the joint's frame, all later axes in the body.
    """
    found = [ZERO] * 12
    turned = False

    def add(first: int, direction: Vector, value: Expression) -> None:
        for i, c in enumerate(direction):
            found[first + i] += value * c

    turning = {m.index for m in motion if isinstance(m, Turn)}
    for m in motion:
        if isinstance(m, Turn | Slide):
            if isinstance(m, Slide) and m.index in turning:
                continue  # in a screw joint, the torque alone does the work of the generalised force
            is_turn = isinstance(m, Turn)
            add(6 * turned + 3 * (not is_turn), _unit(axes[m.axis]), values[m.index])
            turned = turned or is_turn
            continue
        assert isinstance(m, Ball | Displacement)
        for i in range(3):
            add(9 if isinstance(m, Displacement) else 6, signed_base(i), values[m.speed + i])
        turned = turned or isinstance(m, Ball)
    return tuple(found)


def _unit(axis: Vector) -> Vector:
    x, y, z = axis
    length = made("sqrt", x * x + y * y + z * z)
    return x / length, y / length, z / length


@dataclass(frozen=True, slots=True, eq=False)
class JointForce(ForceElement):
    """Generalised forces on the speeds of a joint, positive if they increase u. Expressions of p, inputs, t, q.x, u.x."""

    type: ClassVar[str] = "joint"

    body: int
    values: tuple[Expression, ...]

    @property
    def coefficients(self) -> tuple[Expression, ...]:
        return self.values


class JointForceEntry(ForceEntry):
    type: Literal["joint"]
    joint: Reference
    value: Annotated[tuple[Expr, ...], WrapValidator(list_or_one)]

    def read(self, x: EntryReader) -> JointForce | JointLoad | None:
        values = tuple(x.bound(e, "value", i, scope="measured") for i, e in enumerate(self.value))
        joint = x.joint(self.joint, "joint", self)
        if joint is None:
            return None
        if len(values) != len(joint.speeds):
            needed = f"{len(joint.speeds)} are needed, for {', '.join('u.' + n for n in joint.speeds)}"
            needed = needed if joint.speeds else f"a {joint.type} joint takes no force"
            message = f"{count_of_values(len(values))} for the {joint.type} joint {joint.name!r}; {needed}"
            x.report(("value",), message)
            return None
        points = x.measured(*values)
        if not points:
            return JointForce(x.name, joint.body, values)
        body, frame, motion, axes = x.placed(joint)
        return JointLoad(x.name, body, frame, along_freedoms(motion, axes, values), measured=points)


class InJointEntry(ForceEntry):
    """Entry of a force by a law; a subclass has its numbers as fields and defines the law.

    Attributes
    ----------
    units_in_joint : mapping of str to (str, str)
        Units of its numbers in a revolute joint, and in a prismatic one.
    divides : tuple of str
        Keys of the numbers by which the law divides.
    """

    placeholders: ClassVar[dict[str, Any]] = {"joint": "ground"}
    units_in_joint: ClassVar[Mapping[str, tuple[str, str]]] = {}
    divides: ClassVar[tuple[str, ...]] = ()

    type: str
    joint: Reference

    @abstractmethod
    def law(self, x: EntryReader, numbers: Mapping[str, Expression], q: Expression, u: Expression) -> Expression | None:
        """The force in a joint with coordinate q and speed u; None after an error."""

    def read(self, x: EntryReader) -> JointForce | None:
        given = {key: e for key in type(self).units_in_joint if (e := getattr(self, key)) is not None}
        numbers = {key: x.bound(e, key, scope="inputs") for key, e in given.items()}
        for key in self.divides:
            if numbers.get(key) is ZERO:
                if given[key] == ZERO:  # a number with an error is not ZERO
                    x.report((key,), f"{key} is 0, but the law divides by it; give a small number instead")
                return None
        joint = x.joint(self.joint, "joint", self)
        if joint is None or not x.is_whole(self):
            return None
        if len(joint.speeds) != 1:
            has = f"{len(joint.speeds)}: {', '.join(joint.speeds)}" if joint.speeds else "none"
            message = (
                f"{self.type} needs a joint with one degree of freedom, and the {joint.type} joint {joint.name!r} has {has}; "
                f"write its force as an expression, {{type: joint, joint: {joint.name}, value: [...]}}"
            )
            x.report(("joint",), message)
            return None
        q, u = (Expression(("name", f"{of}.{joint.name}")) for of in "qu")
        value = self.law(x, numbers, q, u)
        return None if value is None else JointForce(x.name, joint.body, (value,))


class FrictionEntry(InJointEntry):
    """Dry and viscous friction: ``-coulomb tanh(u / velocity) - viscous u``, smooth where the motion reverses."""

    units_in_joint: ClassVar[Mapping[str, tuple[str, str]]] = {
        "coulomb": ("N*m", "N"), "viscous": ("N*m*s/rad", "N*s/m"), "velocity": ("rad/s", "m/s"),
    }  # fmt: skip
    misspelt: ClassVar[dict[str, str]] = {"damping": "viscous", "dry": "coulomb", "speed": "velocity"}

    divides: ClassVar[tuple[str, ...]] = ("velocity",)

    type: Literal["friction"]
    coulomb: Expr = ZERO
    viscous: Expr = ZERO
    velocity: OptionalExpr = None

    def law(self, x: EntryReader, numbers: Mapping[str, Expression], q: Expression, u: Expression) -> Expression | None:
        dry = numbers["coulomb"]
        value = -(numbers["viscous"] * u)
        if dry is ZERO:
            return value
        if "velocity" not in numbers:
            x.report(
                ("coulomb",),
                "coulomb is given without velocity; add velocity: the speed at which dry friction reaches 3/4 of its limit",
            )
            return None
        return value - dry * made("tanh", u / numbers["velocity"])


class LimitEntry(InJointEntry):
    """Stops at one or both ends of a joint's range: springs with dampers whose stiffness grows smoothly over a width."""

    placeholders: ClassVar[dict[str, Any]] = {"joint": "ground", "stiffness": "1", "width": "1"}
    units_in_joint: ClassVar[Mapping[str, tuple[str, str]]] = {
        "lower": ("rad", "m"), "upper": ("rad", "m"), "width": ("rad", "m"), "stiffness": ("N*m/rad", "N/m"),
        "damping": ("N*m*s/rad", "N*s/m"),
    }  # fmt: skip
    misspelt: ClassVar[dict[str, str]] = {"min": "lower", "max": "upper"}

    divides: ClassVar[tuple[str, ...]] = ("width",)

    type: Literal["limit"]
    lower: OptionalExpr = None
    upper: OptionalExpr = None
    stiffness: Expr
    damping: Expr = ZERO
    width: Expr

    def law(self, x: EntryReader, numbers: Mapping[str, Expression], q: Expression, u: Expression) -> Expression | None:
        ways = []
        if "lower" in numbers:
            ways.append((1, numbers["lower"] - q))
        if "upper" in numbers:
            ways.append((-1, q - numbers["upper"]))
        if not ways:
            x.report((), "a limit has neither lower nor upper; give one of them")
            return None
        k, c, width = numbers["stiffness"], numbers["damping"], numbers["width"]
        value = ZERO
        for sign, way in ways:
            # the stiffness grows linearly up to the width: the force is s^2 / (2 width) there, then linear
            beyond = made("max", 0, way)
            s = made("min", beyond, width)
            push = k * (s**2 / (2 * width) + (beyond - s))
            value = value + push if sign > 0 else value - push
            if c is not ZERO:
                value -= c * (s / width) * u
        return value
