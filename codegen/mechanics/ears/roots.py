"""Roots of an ear: the links that carry the ear's links and faces, with their positions, motions and forces.

A root is one of four: the *frame* of the region (its base, whose axes all vectors use); the *ground*, if the
base is a link; a *link of the region*, which belongs to an earlier ear; or a *far link* (see `far_links`). An ear
reads the same quantities of every root: attitude, position, motion per unit of a source, velocity, accelerations,
displacements and Newton's step. It also adds forces to the roots. Vectors are along the region's axes, relative to its
base, unless a method says otherwise.

While seeds are completed, displacements along directions are in slots; `kept` displacements are those stored in lanes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from ...program.block import Scope
from ...program.field import SixField, VectorField
from ...program.scalar import Matrix, Vector
from ...program.store import Store
from ...records import dataclass
from .. import fields
from ..propagation import accumulate, add_to_sum
from ..spatial import SIX, UNIT, ZERO, add, cross, is_zero, minus, rotate, transpose
from ..stores import BASE, GROUND, LANE_BASE, LANE_ROOTS, LBASE, LGROUND, LREGION, LROOTS, REGION, ROOTS
from ..structure.kinds import EarKind
from .motions import Motion, Twist


@dataclass(frozen=True, slots=True)
class Root(ABC):
    """A root of an ear.

    Attributes
    ----------
    x : Scope
        The block that reads the root.
    kind : EarKind
    place : int
        Index among the ear's roots.
    positions : VectorField
        Positions of links of the region.
    """

    x: Scope
    kind: EarKind
    place: int
    positions: VectorField

    @property
    @abstractmethod
    def record(self) -> Store:
        """The store for the record of the root."""

    @property
    def needs_force(self) -> bool:
        """Whether forces on the root are needed; forces on the ground are not."""
        return True

    @abstractmethod
    def attitude(self) -> Matrix:
        """Rotation matrix of the root: region components from the root's own."""

    @abstractmethod
    def position(self) -> Vector:
        """Position of the root's origin."""

    @abstractmethod
    def motion(self, total: bool) -> Motion:
        """Motion relative to the ground: the motion with udot = 0, or the `total` motion."""

    @abstractmethod
    def own_motion(self) -> tuple[Motion, Motion]:
        """The total motion relative to the ground, and its tangent, along the root's own axes."""

    # -- relative to the base; by default a root is at rest ----------------------------------------------------------

    def twist(self, source: int) -> Twist:
        """Twist of the root for a unit value of a source."""
        return Twist.zero()

    def measured_velocity(self) -> Twist:
        """The root's velocity at the given speeds, for velocity residuals of loops."""
        return Twist.zero()

    def velocity_tangent(self, kept: bool) -> Vector:
        """Tangent of the velocity due to the sources, six components."""
        return Twist.zero().six

    def rotation(self, kept: bool) -> Vector:
        """Rotation vector of the root along a direction."""
        return list(ZERO)

    def displacement(self, kept: bool) -> Vector:
        """Displacement of the root along a direction."""
        return list(ZERO)

    def step(self) -> Twist:
        """Rotation vector and displacement of the root in Newton's step."""
        return Twist.zero()

    # -- forces ------------------------------------------------------------------------------------------------------

    @property
    def sums(self) -> tuple[SixField, SixField]:
        """Fields in which the region sums the forces on the root, and their tangents."""
        raise TypeError(f"{type(self).__name__} has no sum of forces in a region")

    def receive(self, force: Vector) -> None:
        """Add a moment and a force on the root, about its origin, to the region's sum."""
        if self.needs_force:
            add_to_sum(self.x, REGION, self.sums[0], force, "to_root", "Eq. 45")

    def receive_own(self, force: Vector, tangent: Vector) -> None:
        """Add a moment and a force on the root, along the root's own axes, and their tangent, to the region's sums."""
        for i in SIX if self.needs_force else ():
            self.x.store(REGION.sum, self.sums[0].scalars()[i], force[i])
            self.x.store(LREGION.sum, self.sums[1].scalars()[i], tangent[i])

    def receive_along(self, tangent: Vector) -> None:
        """Add a moment and a force over directions, along the root's own axes, to the region's sum."""
        for i in SIX if self.needs_force else ():
            self.x.store(LREGION.sum, self.sums[1].scalars()[i], tangent[i])


class Frame(Root):
    """The region's base. Unless the region is rigidly attached to its base, the six components of the base's motion are
    sources."""

    @property
    def record(self) -> Store:
        return BASE

    @property
    def needs_force(self) -> bool:
        return self.kind.carried

    @property
    def moves(self) -> bool:
        """Whether the base's motion is among the sources; if so, the region moves relative to the base."""
        return not self.kind.rigid

    def attitude(self) -> Matrix:
        return UNIT

    def position(self) -> Vector:
        return ZERO

    def twist(self, source: int) -> Twist:
        return _unit(source - self.kind.sources) if self.moves else Twist.zero()

    def measured_velocity(self) -> Twist:
        return Twist.load(self.x, BASE, fields.closing_twist) if self.moves else Twist.zero()

    def velocity_tangent(self, kept: bool) -> Vector:
        if not self.moves:
            return Twist.zero().six
        return self.x.load(LANE_BASE if kept else LBASE, fields.closing_twist)

    def motion(self, total: bool) -> Motion:
        return Motion.load(self.x, BASE, fields.total if total else fields.remainder)

    def own_motion(self) -> tuple[Motion, Motion]:
        return Motion.load(self.x, BASE, fields.total), Motion.load(self.x, LBASE, fields.remainder)

    @property
    def sums(self) -> tuple[SixField, SixField]:
        return fields.region_transmitted, fields.region_balance


class Ground(Root):
    """The ground, relative to a moving base: the ground then rotates."""

    @property
    def record(self) -> Store:
        return GROUND

    @property
    def needs_force(self) -> bool:
        return False

    def attitude(self) -> Matrix:
        return transpose(self.x.load(BASE, fields.closing_attitude))

    def position(self) -> Vector:
        o = self.x.load(BASE, fields.closing_position)
        return self.x.let_vector("o", [-e for e in rotate(self.attitude(), o)], "Eq. 22")

    def rotation(self, kept: bool) -> Vector:
        # the completion of seeds reads the displacement too, so load all six
        load = self.x.load
        theta = load(LANE_BASE, fields.closing_shift.angular) if kept else load(LBASE, fields.closing_shift)[:3]
        return [-v for v in theta]

    def displacement(self, kept: bool) -> Vector:
        turned = cross(self.rotation(kept), self.position())
        moved = minus(turned, self.x.load(LANE_BASE if kept else LBASE, fields.closing_shift.linear))
        return self.x.let_vector("d", moved, "d Eq. 22", lanes=True)

    def step(self) -> Twist:
        theta, d = ([-e for e in self.x.load(BASE, f)] for f in (fields.step.angular, fields.step.linear))
        return Twist(theta, self.x.let_vector("s", add(d, cross(theta, self.position())), "Eq. 35"))

    def motion(self, total: bool) -> Motion:
        acceleration = (fields.total if total else fields.remainder).a
        moved = rotate(self.attitude(), self.x.load(GROUND, acceleration))
        a = [0 if is_zero(e) else self.x.name("ga", e, "Eq. 22") for e in moved]
        return Motion.falling(a)

    def own_motion(self) -> tuple[Motion, Motion]:
        load = self.x.load
        return Motion.falling(load(GROUND, fields.total.a)), Motion.falling(load(LGROUND, fields.remainder.a))


class EarLink(Root):
    """A link of the region, which belongs to an earlier ear."""

    @property
    def record(self) -> Store:
        return ROOTS[self.place]

    def _along(self, kept: bool) -> Store:
        return (LANE_ROOTS if kept else LROOTS)[self.place]

    def attitude(self) -> Matrix:
        return self.x.load(self.record, fields.ear_attitude)

    def position(self) -> Vector:
        return self.x.load(self.record, self.positions)

    def twist(self, source: int) -> Twist:
        moved = fields.per_source(source)
        return Twist(self.x.load(self.record, moved.angular), self.x.load(self.record, moved.linear))

    def measured_velocity(self) -> Twist:
        return Twist.load(self.x, self.record, fields.measured_velocity)

    def velocity_tangent(self, kept: bool) -> Vector:
        return self.x.load(self._along(kept), fields.measured_velocity)

    def rotation(self, kept: bool) -> Vector:
        return self.x.load(self._along(kept), fields.shift.angular)

    def displacement(self, kept: bool) -> Vector:
        return self.x.load(self._along(kept), fields.shift.linear)

    def step(self) -> Twist:
        return Twist.load(self.x, self.record, fields.ear_step)

    def motion(self, total: bool) -> Motion:
        return Motion.load(self.x, self.record, fields.ear_total if total else fields.ear_remainder)

    def own_motion(self) -> tuple[Motion, Motion]:
        own = Motion.load(self.x, self.record, fields.ear_own)
        return own, Motion.load(self.x, LROOTS[self.place], fields.remainder)

    def receive(self, force: Vector) -> None:
        force = [self.x.let("to_root", value, "Eq. 45") for value in force]
        accumulate(self.x, self.record, fields.ear_transmitted, force, self.kind.first_at[self.place], "Eq. 45")

    def receive_own(self, force: Vector, tangent: Vector) -> None:
        first = self.kind.first_at[self.place]
        for i, part in enumerate(fields.root_transmitted.scalars()):
            accumulate(self.x, self.record, part, force[i], first, "Eq. 45")
            accumulate(self.x, LROOTS[self.place], part, tangent[i], first, "Eq. 45", lanes=True)

    def receive_along(self, tangent: Vector) -> None:
        first = self.kind.first_at[self.place]
        accumulate(self.x, LROOTS[self.place], fields.root_transmitted, tangent, first, "Eq. 45", lanes=True)


class FarLink(Root):
    """A link outside the region, or the ground; the six components of its motion relative to the base are sources."""

    @property
    def number(self) -> int:
        """Index of this root among the far links of the region."""
        return self.kind.far[self.place]

    @property
    def record(self) -> Store:
        return ROOTS[self.place]

    def attitude(self) -> Matrix:
        return self.x.load(REGION, fields.far_attitude(self.number))

    def position(self) -> Vector:
        return self.x.load(REGION, fields.far_position(self.number))

    def twist(self, source: int) -> Twist:
        return _unit(source - self.kind.sources - 6 * self.number)

    def measured_velocity(self) -> Twist:
        return Twist.load(self.x, REGION, fields.far_velocity(self.number))

    def velocity_tangent(self, kept: bool) -> Vector:
        return self.x.load(LREGION, fields.far_velocity(self.number))

    def rotation(self, kept: bool) -> Vector:
        return self.x.load(LREGION, fields.far_shift(self.number).angular)

    def displacement(self, kept: bool) -> Vector:
        return self.x.load(LREGION, fields.far_shift(self.number).linear)

    def step(self) -> Twist:
        return Twist.load(self.x, REGION, fields.far_step(self.number))

    def motion(self, total: bool) -> Motion:
        motion = fields.far_total if total else fields.far_remainder
        return Motion.load(self.x, REGION, motion(self.number))

    def own_motion(self) -> tuple[Motion, Motion]:
        own = fields.far_own(self.number)
        return Motion.load(self.x, REGION, own), Motion.load(self.x, LREGION, own)

    @property
    def sums(self) -> tuple[SixField, SixField]:
        return fields.far_transmitted(self.number), fields.far_balance(self.number)


BY_ROLE: dict[str, type[Root]] = {"frame": Frame, "ground": Ground, "link": EarLink, "far": FarLink}
"""Class of roots by role; see `structure.kinds.EarKind.roots`."""


def roots_of(x: Scope, kind: EarKind, positions: VectorField = fields.ear_position) -> list[Root]:
    """The roots of an ear, in their order."""
    return [BY_ROLE[role](x, kind, t, positions) for t, role in enumerate(kind.roots)]


def _unit(component: int) -> Twist:
    """A twist with a one at the given component; zero if the twist has no such component."""
    return Twist.of([int(i == component) for i in SIX])
