"""Conditions of loops in the ground frame, and their wrenches on the links of the tree, for second derivatives.

The conditions are those of the closure matrix, along the same directions, so their multipliers follow from the factored
matrix. Positions, velocities and accelerations of links come from sweeps over the tree. All conditions are met, so only
their derivatives are read. Differences of distant positions lose digits; they are needed only if a loop joint slides.
"""

from __future__ import annotations

from collections.abc import Iterator

from ...program.block import Scope
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..spatial import about, add, cross, dot, matvec, minus, rotate, transpose, turned
from ..stores import ACCELERATION_GAP, BASE, COORDINATES, GAP, GQ, ME, MULTIPLIER, RATE_GAP, UDOT
from ..structure.kinds import EarKind
from .closing_accelerations import closing_accelerations
from .conditions import Condition, components_along, kept_conditions, of_loop
from .couplings import coupling_residual
from .geometry import EarGeometry
from .members import Freedom, Member, MemberView
from .motions import Motion, Twist
from .roots import roots_of


class GroundGeometry(EarGeometry):
    """Geometry of an ear along the ground's axes, from positions and attitudes of links."""

    def __init__(self, x: Scope, kind: EarKind):
        self.shares = "held"
        self.x, self.kind, self.fixed = x, kind, []
        self.roots = roots_of(x, kind)
        self.members = []
        for k, link in enumerate(kind.links):
            view = MemberView(x, k)
            joint = link.joint(view, link)
            freedoms = [Freedom(None, None, j) for j in range(len(joint.all_columns))]
            self.members.append(Member(view, link, joint, [], [0, 0, 0], [0, 0, 0], freedoms, kind.parents[k]))

    def record(self, place: int) -> Store:
        """The record of link number `place` or, if `place` is negative, of root number -1 - `place`."""
        return ME[place] if place >= 0 else self.roots[-1 - place].record

    def attitude(self, place: int) -> Matrix:
        return self.x.load(self.record(place), fields.attitude)

    def position(self, place: int) -> Vector:
        return self.x.load(self.record(place), fields.position)

    def along_ground(self, place: int, v: Vector) -> Vector:
        """Components along the ground's axes of a vector along a link's axes."""
        return self.x.let_vector("ground", rotate(self.attitude(place), v), "Eq. 22")

    def walk(
        self, roots: list[Twist], coefficients: list[Vector], name: str, tag: str, lanes: bool = False
    ) -> list[Twist]:
        return []  # velocities of faces are those of sweeps over the tree

    def difference_at_cut(self, c: int, motions: list[Twist], roots: list[Twist]) -> Twist:
        start, end = (self.face_velocity(c, side) for side in (0, 1))
        slip = self.slip(c)
        return end.minus(start if slip is None else Twist(start.angular, start.at(slip)))

    def face_velocity(self, c: int, side: int) -> Twist:
        """Angular velocity and velocity of a face."""
        place = self.kind.closures[c].faces[side]
        own = Twist.load(self.x, self.record(place), fields.applied_twist)
        v = self.x.let_vector("face", own.at(self.face(c, side)[0]), "Eq. 18")
        return Twist(self.along_ground(place, own.angular), self.along_ground(place, v))

    def face_motion(self, c: int, side: int) -> tuple[Vector, Vector, Vector]:
        """Angular velocity, angular acceleration and acceleration of a face."""
        place = self.kind.closures[c].faces[side]
        m = Motion.load(self.x, self.record(place), fields.total)
        a = self.x.let_vector("face", m.at(self.face(c, side)[0]), "Eq. 21")
        w, al, a = (self.along_ground(place, v) for v in (m.w, m.al, a))
        return w, al, a

    def conditions(self) -> list[Condition]:
        """The conditions of the closure matrix, along the ground's axes."""
        rows = kept_conditions(self)
        for row in rows:
            if self._along_base(row):
                row.n = self.x.let_vector("n", matvec(self.x.load(BASE, fields.attitude), row.n), "Eq. 33")
        return rows

    def _along_base(self, row: Condition) -> bool:
        """Whether a condition's direction is an axis of the region's base; otherwise it is an axis of a face."""
        closure = self.kind.closures[row.loop]
        if closure.is_coupling or closure.surfaces or closure.gaps:
            return False
        return (closure.holds.angular if row.angular else closure.holds.linear) == 3


def numbered(rows: list[Condition]) -> Iterator[tuple[int, int]]:
    """For each of the conditions, its loop and its number among those of `rows` that belong to this loop."""
    counts: dict[int, int] = {}
    for row in rows:
        yield row.loop, counts.setdefault(row.loop, 0)
        counts[row.loop] += 1


def multipliers(x: Scope, rows: list[Condition], store: Store = MULTIPLIER) -> Vector:
    """Multipliers of the conditions, or other numbers with one entry per condition."""
    return [x.entry(store[c], i) for c, i in numbered(rows)]


def wrenches(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: the wrenches of its loops on links, and the forces of its couplings. Eq. 9."""
    ear = GroundGeometry(x, kind)
    rows = ear.conditions()
    found = multipliers(x, rows)
    for c, closure in enumerate(kind.closures if rows else ()):
        if closure.is_coupling:
            for row, value in zip(rows, found, strict=True):
                for t, (k, j) in enumerate(closure.terms if row.loop == c else ()):
                    x.store(ME[k].sum, fields.coupling_force(j), x.let("cc", ear.ratio(c, t) * value, "Eq. 9"))
            continue
        moment, force = of_loop(rows, c, found, [row.n for row in rows])
        wrench = [x.let("W", v, "Eq. 9") for v in (*moment, *force)]
        for side, sign in ((0, -1), (1, 1)):
            place = closure.faces[side]
            slip = ear.slip(c) if side == 0 else None
            at_face = wrench if slip is None else about(slip, wrench)
            own = [x.let("own", sign * v, "Eq. 9") for v in turned(transpose(ear.attitude(place)), at_face)]
            if place >= 0 or ear.roots[-1 - place].needs_force:
                x.store(ear.record(place).sum, fields.closing_force, about(ear.face(c, side)[0], own))


def gaps(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: residuals of the conditions in position. Eq. 32."""
    ear = GroundGeometry(x, kind)
    rows = ear.conditions()
    for (c, i), row in zip(numbered(rows), rows, strict=True):
        x.set_entry(GAP[c], i, x.let("gap", _gap(ear, row), "Eq. 32"))


def _gap(ear: GroundGeometry, row: Condition) -> Value:
    """The residual of one condition in position."""
    c = row.loop
    closure = ear.kind.closures[c]
    if closure.is_coupling:
        return coupling_residual(ear, c).angular[0]
    if row.surface is not None:
        return row.gap
    if not row.angular:
        return dot(row.n, minus(ear.position_of_face(c, 1), ear.position_of_face(c, 0)))
    if row.turning:
        return sum(weight * dot(one, other) for weight, one, other in row.turning)
    if closure.holds.angular == 1:
        first, second = ear.universal_axes(c)
        return -dot(first, second)
    if closure.holds.angular == 2:
        return dot(row.n, cross(ear.face_axes(c, 0)[closure.axis], ear.face_axes(c, 1)[closure.end_axis]))
    parts = [cross(p, q) for p, q in zip(ear.face_axes(c, 0), ear.face_axes(c, 1), strict=True)]
    return ear.x.half * dot(row.n, ear.x.let_vector("turned", add(*parts), "Eq. 32"))


def rate_gaps(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: residuals of the conditions in velocity. Eq. 30."""
    ear = GroundGeometry(x, kind)
    rows = ear.conditions()
    if not rows:
        return
    at_cuts = ear.face_difference([], [], [m.speeds for m in ear.members])
    for (c, i), value in zip(numbered(rows), components_along(ear, rows, at_cuts, "rate", "Eq. 30"), strict=True):
        x.set_entry(RATE_GAP[c], i, value)


def acceleration_gaps(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: residuals of the conditions in acceleration. Eq. 31."""
    ear = GroundGeometry(x, kind)
    rows = ear.conditions()
    if not rows:
        return
    joints = [m.given_accelerations or [m.view.entry(UDOT, f.index) for f in m.freedoms] for m in ear.members]
    found = closing_accelerations(x, ear, rows, ear.face_motion, joints, "ca", [])
    for (c, i), value in zip(numbered(rows), found, strict=True):
        x.set_entry(ACCELERATION_GAP[c], i, value)


def tangential_gradients(x: Scope, kind: EarKind) -> None:
    """Outward block of an ear: gradients with respect to quaternions, without the component along the quaternion.

    Only for joints of which loops determine some rotations but not all: completion of seeds keeps the length of their quaternion.
    """
    for k, link in enumerate(kind.links):
        if link.joint.quaternion is None or not 0 < len([j for j in kind.dependent[k] if j < 3]) < 3:
            continue
        places = range(link.joint.quaternion, link.joint.quaternion + 4)
        e, g = ([x.entry(store[k], i) for i in places] for store in (COORDINATES, GQ))
        along = x.let("along", sum(a * b for a, b in zip(e, g, strict=True)), "Eq. 30")
        share = x.let("share", along / x.let("ee", sum(a * a for a in e), "Eq. 30"), "Eq. 30")
        for i, a, b in zip(places, e, g, strict=True):
            x.set_entry(GQ[k], i, x.let("g", b - share * a, "Eq. 30"))
