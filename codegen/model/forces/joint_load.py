"""Forces on the freedoms of a joint that depend on what points do: a wrench on its body, and the opposite one on the parent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..axes import Vector, signed_base
from ..entries import ZERO
from ..expressions import Expression, made
from ..motions import Ball, Displacement, Slide, Turn
from ..places import Face, Point
from .force_element import ForceElement


@dataclass(frozen=True, slots=True, eq=False)
class JointLoad(ForceElement):
    """What does the same power as generalised forces on a joint: a force through the origin of its body, and a torque.

    Attributes
    ----------
    body, joint : Face
        The body, and the frame of its joint in the parent, on which the opposite acts at the same place.
    values : tuple of twelve Expression
        Torque and force in axes of the joint's frame, then both in axes of the body.
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
    """The twelve components of a `JointLoad`, from generalised forces on the speeds of a joint.

    Axes ahead of the first rotation of the chain, that of it included, are fixed in the joint's frame, all others in the body.
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
                continue  # of a screw: the torque alone does the power
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
