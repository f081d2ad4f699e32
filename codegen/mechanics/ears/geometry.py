"""Ears along the axes of their region: attitudes, levers, and motions from its roots to the cuts of its loops.

All vectors of a region's links have components along the axes of its base (except in `ears.balance`). Nothing is rotated from
link to link. A joint with axis e contributes the column ``(e, e x lever)`` to a loop (section 4.1 of the theory page).
Velocities, accelerations and displacements are propagated by ``a + alpha x rho``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

from ...program.block import Scope
from ...program.field import VectorField
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from ...records import dataclass
from .. import fields
from ..spatial import add, cross, is_zero, matvec, minus, rotate, scale
from ..stores import LOOP_CONSTANTS, ME, MY_LANE
from ..structure.kinds import EarKind, LinkKind
from .members import Freedom, Member, MemberView, joint_motion
from .motions import Twist
from .roots import roots_of


@dataclass(slots=True)
class FixedVector:
    """A vector that is fixed in a link (or, with a negative position, in a root).

    Attributes
    ----------
    found, local : Vector
        In region and in link components.
    kept : (Store, VectorField) or None
        Where the tangent of the vector along complete seeds is stored.
    """

    place: int
    found: Vector
    local: Vector
    kept: tuple[Store, VectorField] | None


class EarGeometry:
    """Geometry of an ear, and the steps from link to link.

    Parameters
    ----------
    x : Expansion or StructuralExpansion
    kind : EarKind
    fresh : bool
        The block computes the attitudes of links; otherwise it loads them.
    positions : VectorField
        Positions of the roots.

    Attributes
    ----------
    shares : {"found", "held", "moving"}
        The factors of conditions on points, one over the length of their gradients: computed and stored, loaded and held along
        directions, or computed and differentiated.
    """

    def __init__(self, x: Scope, kind: EarKind, fresh: bool = False, positions: VectorField = fields.ear_position):
        self.shares = "found" if fresh else "held"
        self.x = x
        self.kind = kind
        self.roots = roots_of(x, kind, positions)
        self.members: list[Member] = []
        self.fixed: list[FixedVector] = []
        for k, link_kind in enumerate(kind.links):
            self.members.append(self._member(k, link_kind, fresh))

    # -- geometry --------------------------------------------------------------------------------------------------

    def attitude(self, place: int) -> Matrix:
        """Rotation matrix of a link, or of a root at a negative position: region from link components."""
        if place >= 0:
            return self.members[place].W
        return self.roots[-1 - place].attitude()

    def _member(self, k: int, kind: LinkKind, fresh: bool) -> Member:
        view = MemberView(self.x, k)
        joint = kind.joint(view, kind)
        parent = self.kind.parents[k]
        W_parent = self.attitude(parent)
        r = joint.offset()
        rho = self.fixed_vector("rho", parent, r, kept=(MY_LANE[k], fields.lever_tangent))
        if fresh:
            W = joint.attitude(W_parent)
            view.store(ME, fields.ear_attitude, W)
        else:
            W = view.load(ME, fields.ear_attitude)
        freedoms = [
            Freedom(self._in_region(W, s.angular), self._in_region(W, s.linear), j)
            for j, s in enumerate(joint.all_columns)
        ]
        return Member(view, kind, joint, W, rho, r, freedoms, parent)

    def _in_region(self, W: Matrix, v: Vector) -> Vector | None:
        """Region components of a part of a column; None if it is zero."""
        if all(is_zero(e) for e in v):
            return None
        return [self.x.let("e", e, "Eq. 34") for e in matvec(W, v)]

    def fixed_vector(
        self,
        name: str,
        place: int,
        v: Vector,
        tag: str = "Eq. 22",
        kept: tuple[Store, VectorField] | None = None,
    ) -> Vector:
        """Region components of a vector given along a link's axes; recorded for differentiation."""
        found = self.x.let_vector(name, rotate(self.attitude(place), v), tag)
        self.fixed.append(FixedVector(place, found, v, kept))
        return found

    def face(self, c: int, side: int) -> tuple[Vector, Matrix]:
        """Origin and axes of a loop joint's face along the axes of its link: the joint's axis is a coordinate axis."""
        name = "AB"[side]
        r = self.x.load(LOOP_CONSTANTS[c], fields.face_place(name))
        return r, self.x.load(LOOP_CONSTANTS[c], fields.face_axes(name))

    def arm(self, c: int, side: int) -> Vector:
        """Vector from the origin of a face's link to the face."""
        r, _ = self.face(c, side)
        place = self.kind.closures[c].faces[side]
        kept = (MY_LANE[place], fields.arm_tangent(c, "AB"[side])) if place >= 0 else None
        return self.fixed_vector("arm", place, r, kept=kept)

    @property
    def slides(self) -> bool:
        """Whether the displacement between the faces of any loop is needed."""
        return any(c.slides for c in self.kind.closures)

    @cached_property
    def levers(self) -> list[tuple[dict[int, Vector], dict[int, Vector]]]:
        """For each loop, the vectors from the origins of the links on both sides to the cut."""
        return [self._levers(c) for c in range(len(self.kind.closures))]

    def _levers(self, c: int) -> tuple[dict[int, Vector], dict[int, Vector]]:
        """Vectors to a loop's cut from the origins of the links on both sides; the root's vector has the key -1."""
        result: tuple[dict[int, Vector], dict[int, Vector]] = ({}, {})
        if self.kind.closures[c].is_coupling:
            return result
        slip = self.slip(c)
        for side, path in enumerate(self.kind.closures[c].paths):
            lever = self.arm(c, side)
            if side == 0 and slip is not None:
                lever = self.x.let_vector("lever", add(lever, slip), "Eq. 32")
            for k in reversed(path):
                result[side][k] = lever
                lever = self.x.let_vector("lever", add(lever, self.members[k].rho), "Eq. 32")
            result[side][-1] = lever
        return result

    def slip(self, c: int) -> Vector | None:
        """Vector from the origin of the start face to that of the end face; None if the origins always coincide."""
        if not self.kind.closures[c].slides:
            return None
        a, b = (self.position_of_face(c, side) for side in (0, 1))
        return self.x.let_vector("slip", minus(b, a), "Eq. 32")

    def position_of_face(self, c: int, side: int) -> Vector:
        """Position of a face along region axes, from the region's base."""
        place = self.kind.closures[c].faces[side]
        return self.x.let_vector("face", add(self.position(place), self.arm(c, side)), "Eq. 22")

    def position(self, place: int) -> Vector:
        """Position of the origin of a link or root along region axes, from the region's base."""
        if place >= 0:
            m = self.members[place]
            return self.x.let_vector("o", add(self.position(m.parent), m.rho), "Eq. 22")
        return self.roots[-1 - place].position()

    # -- steps from link to link -----------------------------------------------------------------------------------

    def step(
        self, before: Twist, member: Member, coefficients: Vector, name: str, tag: str, lanes: bool = False
    ) -> Twist:
        """The motion of a link from that of its parent, with the given rates of the joint's degrees of freedom."""
        angular, linear = before.angular, before.at(member.rho)
        turning, sliding = joint_motion(member.freedoms, coefficients)
        angular = angular if turning is None else add(angular, turning)
        linear = linear if sliding is None else add(linear, sliding)
        return Twist(
            self.x.let_vector(f"{name}w", angular, tag, lanes=lanes),
            self.x.let_vector(f"{name}v", linear, tag, lanes=lanes),
        )

    def walk(
        self, roots: list[Twist], coefficients: list[Vector], name: str, tag: str, lanes: bool = False
    ) -> list[Twist]:
        """Motions of all links of the ear, from motions of its roots and rates of its degrees of freedom."""
        found: list[Twist] = []
        for member, values in zip(self.members, coefficients, strict=True):
            before = found[member.parent] if member.parent >= 0 else roots[-1 - member.parent]
            found.append(self.step(before, member, values, name, tag, lanes))
        return found

    def still(self) -> list[Twist]:
        """Zero twists, for roots that are at rest."""
        return [Twist.zero() for _ in self.roots]

    # -- motion at the cuts ----------------------------------------------------------------------------------------

    def face_axes(self, c: int, side: int) -> list[Vector]:
        """The three axes of a face along region axes."""
        _, F = self.face(c, side)
        place = self.kind.closures[c].faces[side]
        return [self.fixed_vector("n", place, [F[i][j] for i in range(3)], "Eq. 33") for j in range(3)]

    def universal_axes(self, c: int) -> tuple[Vector, Vector]:
        """The two axes of a universal loop joint: the first fixed in the start, the second in the end."""
        closure = self.kind.closures[c]
        return self.face_axes(c, 0)[closure.axis], self.face_axes(c, 1)[closure.end_axis]

    def ratio(self, c: int, t: int) -> Value:
        """Factor of a coordinate in a coupling."""
        return self.x.load(LOOP_CONSTANTS[c], fields.coupling_factor(t))

    def coupled(self, c: int, values: Sequence[Vector], name: str, tag: str) -> Twist:
        """The sum of a coupling's factors times `values`, the speeds or accelerations of joints by link and degree of
        freedom; see `ears.couplings`."""
        total: Value = 0
        for t, (k, j) in enumerate(self.kind.closures[c].terms):
            total = total + self.ratio(c, t) * values[k][j]
        return Twist([self.x.let(name, total, tag), 0, 0], [0, 0, 0])

    def face_difference(self, motions: list[Twist], roots: list[Twist], speeds: Sequence[Vector]) -> list[Twist]:
        """Motion of the end face relative to the start face at every cut, from motions of links, roots and joints."""
        return [
            self.coupled(c, speeds, "coupled", "Eq. 30")
            if closure.is_coupling
            else self.difference_at_cut(c, motions, roots)
            for c, closure in enumerate(self.kind.closures)
        ]

    def difference_at_cut(self, c: int, motions: list[Twist], roots: list[Twist]) -> Twist:
        """Motion of the end face relative to the start face at a cut, from motions of links and roots."""
        sides = []
        for side in (0, 1):
            place = self.kind.closures[c].faces[side]
            t = motions[place] if place >= 0 else roots[-1 - place]
            lever, slip = self.arm(c, side), self.slip(c) if side == 0 else None
            if slip is not None:
                lever = self.x.let_vector("lever", add(lever, slip), "Eq. 32")
            sides.append(Twist(t.angular, t.at(lever)))
        return sides[1].minus(sides[0])

    def column(self, member: int, freedom: Freedom) -> list[Twist]:
        """Contribution of a degree of freedom to the relative motion of the faces at every cut."""
        found = []
        for c, closure in enumerate(self.kind.closures):
            total = Twist([0, 0, 0], [0, 0, 0])
            for t, term in enumerate(closure.terms):
                if term == (member, freedom.index):
                    total = Twist([self.ratio(c, t), 0, 0], [0, 0, 0])
            for side, sign in ((0, -1), (1, 1)):
                if member in closure.paths[side]:
                    e, linear = (None if v is None else scale(sign, v) for v in (freedom.angular, freedom.linear))
                    if e is not None:
                        d = cross(e, self.levers[c][side][member])
                        d = self.x.let_vector("d", d if linear is None else add(d, linear), "Eq. 34")
                        total = Twist(e, d)
                    elif linear is not None:
                        total = Twist([0, 0, 0], linear)
            found.append(total)
        return found

    def root_difference(self, roots: list[Twist]) -> list[Twist]:
        """Contribution of the motion of the roots to the relative motion at every cut, with all joints of the ear
        locked."""
        found = []
        for c, closure in enumerate(self.kind.closures):
            start, end = (
                Twist(roots[t].angular, roots[t].at(self.levers[c][side][-1])) if t >= 0 else Twist.zero()
                for side, t in enumerate(closure.roots)
            )
            found.append(end.minus(start))
        return found

    def dependents(self) -> list[tuple[int, Freedom]]:
        """The dependent degrees of freedom, in the order of the closure matrix's columns."""
        return [(k, m.freedoms[j]) for k, m in enumerate(self.members) for j in self.kind.dependent[k]]

    def coefficients(self, dependent: Vector, independent: Callable[[int, int], Value] | None = None) -> list[Vector]:
        """For each link, the rates of its degrees of freedom: listed values for dependent ones, values of a function
        for the others."""
        found = [
            [0 if independent is None else independent(k, f.index) for f in m.freedoms]
            for k, m in enumerate(self.members)
        ]
        for (k, f), value in zip(self.dependents(), dependent, strict=True):
            found[k][f.index] = value
        return found
