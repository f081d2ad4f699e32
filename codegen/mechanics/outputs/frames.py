"""Frames of all bodies: pose, velocity and acceleration in the ground frame, without outputs in the model.

The position of a body in its link is data of the generated code, as for outputs, so bodies on links of one kind share a block.
The velocity of the link comes from the sweep for force elements, which computes no kinetic energy.
"""

from __future__ import annotations

from functools import partial

from ...model.model import GROUND, Model
from ...model.places import Point
from ...program.formula import Formula
from ...program.scalar import Value, Vector
from ...records import dataclass
from .. import fields
from ..formulas import formula_kinds
from ..spatial import add, cross, matvec, transpose
from ..structure.links import ORIGIN
from ..structure.system import System
from .outputs import RecordFormulas
from .records import Records, carrier, expressions_of, structure_of

FRAMES, ACCELERATIONS, PLACES = "frames", "frame_accelerations", "point_places"
"""Arrays of results: frames of bodies, their accelerations, and places of points."""

SIZES = {FRAMES: 18, ACCELERATIONS: 6}
"""Entries for each body: rotation matrix by rows, position, angular velocity, velocity; then angular acceleration and
acceleration. Linear quantities are those of the origin; all are along the ground's axes."""


@dataclass(slots=True)
class Body:
    """Motion of one body in the blocks of frames.

    Parameters
    ----------
    records : Records
    body : int
    turned : bool
        The computation uses other axes of the ground than the model (`structure.world`).
    """

    records: Records
    body: int
    turned: bool

    def in_ground(self, v: Vector) -> Vector:
        """A vector along the link's axes, rotated into the axes of the model's ground."""
        found = self.records.to_ground(self.body, v)
        return self._along_ground([found])[0]

    def _along_ground(self, vectors: list[Vector]) -> list[Vector]:
        if not self.turned:
            return vectors
        back = transpose(self.records.attitude(GROUND))
        return [[self.records.x.let("x", e) for e in matvec(back, v)] for v in vectors]

    def motion(self) -> list[Value]:
        """The entries of a body in the array `FRAMES`."""
        x, body = self.records.x, self.body
        link, _, _ = self.records.carried(body)
        columns = transpose(self.records.attitude(body))
        position = self.records.position(Point("", body, ORIGIN))
        *columns, position = self._along_ground([*columns, position])
        found = [e for row in transpose(columns) for e in row] + position
        if link == GROUND:
            return [*found, *[0] * 6]
        twist = fields.applied_twist
        w, v = (self.records.link_field(body, f) for f in (twist.angular, twist.linear))
        moved: Vector = [x.let("v", e) for e in add(v, cross(w, self.origin()))]
        return [*found, *self.in_ground(w), *self.in_ground(moved)]

    def acceleration(self) -> list[Value]:
        """The entries of a body in the array `ACCELERATIONS`."""
        x, body = self.records.x, self.body
        link, _, _ = self.records.carried(body)
        if link == GROUND:
            return [0] * 6
        moving = fields.moving
        al, a = (self.records.link_field(body, f) for f in (moving.al, moving.a))
        B = self.records.link_field(body, moving.B)
        moved: Vector = [x.let("a", e) for e in add(a, matvec(B, self.origin()))]
        return [*self.in_ground(al), *self.in_ground(moved)]

    def origin(self) -> Vector:
        """Origin of the body's frame relative to the link's origin, along the link's axes."""
        return self.records.in_link(self.body, self.records.vector(ORIGIN))


def frame_formulas(system: System, target: str) -> list[Formula]:
    """The blocks of an array of frames, one for each form."""
    found = RecordFormulas(system, target, "the frame of a body")
    turned = bool(system.way_of_ground)
    for body, spec in enumerate(system.model.bodies):
        on = (body, GROUND) if turned else (body,)
        links = (carrier(system, body)[0],)
        key = (links[0] == GROUND, structure_of(system, on, links))
        write = partial(_write_frame, target, body, turned)
        found.add(
            SIZES[target] * body, f"bodies.{spec.name}", links, [*ORIGIN, *expressions_of(system, on)], key, write
        )
    return found.formulas


def _write_frame(target: str, body: int, turned: bool, records: Records) -> list[Value]:
    of = Body(records, body, turned)
    return of.motion() if target == FRAMES else of.acceleration()


def place_formulas(model: Model) -> list[Formula]:
    """Positions of the model's points in their bodies; none if no parameter moves them."""
    if not model.points_depend_on_parameters:
        return []
    trees = [(3 * k + i, e.tree) for k, point in enumerate(model.points) for i, e in enumerate(point.at)]
    return formula_kinds(model, PLACES, trees, {i: f"points.{model.points[i // 3].name}.at" for i, _ in trees})
