"""Motions of points and bodies from the records of their links; the statements of outputs are written with them.

A point r of a link has the position ``pos + W r`` and the velocity ``W (v + omega x r)`` in the ground frame. The block of an
output on one link reads the record `ME`; with several links the records are `ME[0]`, `ME[1]` and so on.
"""

from __future__ import annotations

from collections.abc import Mapping

from ...model.axes import Vector as ExpressionVector
from ...model.expressions import Expression
from ...model.grammar import Tree
from ...model.model import GROUND
from ...model.outputs import Output
from ...model.places import Point
from ...program import algebra
from ...program.algebra import Expr
from ...program.block import Expansion, V_co
from ...program.field import Readable
from ...program.functions import SYMBOLIC
from ...program.limits import limits
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from ...records import dataclass
from .. import fields
from ..formulas import leaf_of
from ..spatial import add, cross, matmul, matvec, transpose
from ..stores import MASSES, ME, MOMENTA, PIVOT
from ..structure.constants import Statements
from ..structure.links import (
    BODY_FRAME,
    Frame,
    Placement,
    expressions_of_steps,
    form_of_steps,
    frame_matrix,
    identity,
    place,
    unit,
)
from ..structure.system import System

SHORTEST = 1e-100
"""Shortest distance, m, that has a derivative; below it, the square of a quotient by the distance can overflow."""


@dataclass(slots=True)
class Records:
    """Access of an output's block to the records of its links.

    Parameters
    ----------
    x : Expansion
    system : System
    links : tuple of int
        The links whose records the block reads.
    canonical : mapping of Expression to Tree
        The expressions that the block may evaluate, with numbered slots for numbers and names.
    tangents : bool
        The block will be differentiated.
    """

    x: Expansion
    system: System
    links: tuple[int, ...]
    canonical: Mapping[Expression, Tree]
    tangents: bool

    # -- expressions -------------------------------------------------------------------------------------------------

    def evaluate(self, e: Expression) -> Expr:
        """The value of an expression of parameters, inputs or time."""
        return Statements(self.x, leaf_of(self.x)).write(self.canonical[e])

    def vector(self, v: ExpressionVector) -> Vector:
        return [self.evaluate(e) for e in v]

    def direction(self, axis: ExpressionVector | None) -> Vector:
        """Unit vector along an axis of the model."""
        assert axis is not None
        v = self.vector(axis)
        known = [a for a in map(algebra.expression, v) if isinstance(a, algebra.Number)]
        if len(known) < len(v) or sum(map(abs, known), algebra.ZERO) != 1:
            v = unit(v, SYMBOLIC["sqrt"], self.x.let)
        return v

    def differs(self, square: Value) -> None:
        """Reports an error if a derivative is required where the square of a distance is zero."""
        if self.tangents:
            self.x.set_entry(PIVOT, 0, square - self.x.number(limits().tiny(SHORTEST, 3) ** 2))

    # -- links -------------------------------------------------------------------------------------------------------

    def _record(self, link: int) -> Store:
        return ME if len(self.links) == 1 else ME[self.links.index(link)]

    def carried(self, body: int) -> tuple[int, tuple[Placement, ...], Frame]:
        """The link of a body, the placements from the link's own body to this body, and the frame of the link."""
        return carrier(self.system, body)

    def in_link(self, body: int, r: Vector) -> Vector:
        """A point of a body, relative to the link's origin and along the link's axes."""
        _, steps, frame = self.carried(body)
        if steps:
            origin, R = place(steps, self.evaluate, SYMBOLIC, self.x.let)
            r = [self.x.let("r", e) for e in add(origin, matvec(R, r))]
        if frame.vector is not None:
            Q = frame_matrix(frame, self.evaluate, SYMBOLIC, self.x.let)
            r = [self.x.let("r", e) for e in matvec(transpose(Q), r)]
        return r

    def body_axes(self, body: int) -> Matrix:
        """Rotation matrix of a body in its link: link from body components."""
        _, steps, frame = self.carried(body)
        R = identity()
        if steps:
            R = place(steps, self.evaluate, SYMBOLIC, self.x.let)[1]
        if frame.vector is not None:
            Q = frame_matrix(frame, self.evaluate, SYMBOLIC, self.x.let)
            R = [[self.x.let("R", e) for e in row] for row in matmul(transpose(Q), R)]
        return R

    def to_ground(self, body: int, v: Vector) -> Vector:
        """Ground components of a vector given along the axes of a body's link."""
        W = self.link_attitude(body)
        return v if W is None else [self.x.let("x", e) for e in matvec(W, v)]

    def link_attitude(self, body: int) -> Matrix | None:
        """Rotation matrix of a body's link: ground from link components; None for the ground."""
        link, _, _ = self.carried(body)
        return None if link == GROUND else self.x.load(self._record(link), fields.attitude)

    def link_field(self, body: int, field: Readable[V_co]) -> V_co:
        """A field of the record of a body's link."""
        return self.x.load(self._record(self.carried(body)[0]), field)

    # -- motions -----------------------------------------------------------------------------------------------------

    def position(self, point: Point) -> Vector:
        """Position of a point, along the ground's axes, m."""
        link, _, _ = self.carried(point.body)
        moved = self.to_ground(point.body, self.in_link(point.body, self.vector(point.at)))
        origin: Vector = self.x.load(self._record(link), fields.position) if link != GROUND else [0, 0, 0]
        return add(origin, moved)

    def velocity(self, point: Point) -> Vector:
        """Velocity of a point, along the ground's axes, m/s."""
        if self.carried(point.body)[0] == GROUND:
            return [0, 0, 0]
        r = self.in_link(point.body, self.vector(point.at))
        self.link_attitude(point.body)  # keeps the loads in the order of the record
        v, w = (self.link_field(point.body, field) for field in (fields.velocity, fields.angular_velocity))
        return self.to_ground(point.body, [self.x.let("v", e) for e in add(v, cross(w, r))])

    def acceleration(self, point: Point) -> Vector:
        """Acceleration of a point relative to the ground, along the ground's axes, m/s^2."""
        if self.carried(point.body)[0] == GROUND:
            return [0, 0, 0]
        r = self.in_link(point.body, self.vector(point.at))
        a, B = self.link_field(point.body, fields.moving.a), self.link_field(point.body, fields.moving.B)
        return self.to_ground(point.body, [self.x.let("a", e) for e in add(a, matvec(B, r))])

    def attitude(self, body: int) -> Matrix:
        """Rotation matrix of a body: ground from body components."""
        link, _, _ = self.carried(body)
        R = self.body_axes(body)
        if link == GROUND:
            return R
        W = self.x.load(self._record(link), fields.attitude)
        return [[self.x.let("W", e) for e in row] for row in matmul(W, R)]

    def angular_velocity(self, body: int) -> Vector:
        """Angular velocity of a body, along the axes of its link, rad/s."""
        link, _, _ = self.carried(body)
        return [0, 0, 0] if link == GROUND else self.x.load(self._record(link), fields.angular_velocity)

    # -- sums over all links -----------------------------------------------------------------------------------------

    def masses(self) -> Vector:
        """Mass and first moment about the ground's origin of all links; bodies fixed to the ground are left out."""
        return [self.x.entry(MASSES, i) for i in range(4)]

    def momenta(self) -> tuple[Vector, Vector]:
        """Linear momentum of all links, and angular momentum about the ground's origin."""
        six: Vector = [self.x.entry(MOMENTA, i) for i in range(6)]
        return six[:3], six[3:]


def grounded(system: System) -> tuple[int, ...]:
    """Indices of the bodies that are fixed to the ground."""
    return tuple(k for k, (link, _) in enumerate(system.carriers) if link == GROUND)


def carrier(system: System, body: int) -> tuple[int, tuple[Placement, ...], Frame]:
    """See `Records.carried`; for the ground, the placement of the model's axes in the axes that the computation
    uses."""
    link, steps = (GROUND, system.way_of_ground) if body == GROUND else system.carriers[body]
    return link, steps, BODY_FRAME if link == GROUND else system.links[link].frame


def links_of(system: System, output: Output) -> tuple[int, ...]:
    """The links that an output reads, each once; the ground alone if there are none."""
    found = dict.fromkeys(carrier(system, body)[0] for body in output.on)
    return tuple(link for link in found if link != GROUND) or (GROUND,)


def expressions_of(system: System, bodies: tuple[int, ...]) -> list[Expression]:
    """The expressions that place bodies in their links, in a fixed order."""
    found: list[Expression] = []
    for body in bodies:
        _, steps, frame = carrier(system, body)
        found += frame.vector or ()
        found += expressions_of_steps(steps)
    return found


def structure_of(system: System, bodies: tuple[int, ...], links: tuple[int, ...]) -> tuple[object, ...]:
    """A key of the body's placement; bodies in links of one kind whose placements differ only in numbers have equal
    keys."""

    def of(body: int) -> tuple[object, ...]:
        link, steps, frame = carrier(system, body)
        at = () if link == GROUND else (links.index(link), system.kind_of[link].index)
        return (*at, "steps", *form_of_steps(steps), frame.index, frame.flipped, frame.start)

    return tuple(map(of, bodies))
