"""Ears in the axes of their region: attitudes, levers, the motion of joints, closing conditions.

All vectors of a region's links are in the axes of its base (but for the balance, `ears.balance`). So nothing is turned from
link to link: a joint of a link contributes its axis e, the column ``(e, e x lever)`` to a loop (section 4.1 of the theory
page), and a velocity, an acceleration or a displacement goes from link to link by ``a + alpha x rho``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from sympy.core.numbers import Number

from ...model.model import CLOSURE_ROWS
from ...program.block import Scope, V, V_co
from ...program.field import Field, Readable, SixField, VectorField
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..joints import LinkJoint
from ..spatial import add, cross, dot, is_zero, matvec, minus, scale, transpose
from ..stores import BASE, LOOP_CONSTANTS, ME, MY_LANE, REGION, ROOTS
from ..structure.kinds import EarKind, LinkKind
from .orthogonal import product

ZERO: Vector = [0, 0, 0]
UNIT: Matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


class MemberView(Scope):
    """The expansion of an ear as one of its links sees it: constants, coordinates and records are the link's own."""

    def __init__(self, x: Scope, place: int):
        self.x = x
        self.place = place
        self.structural = x.structural
        self.tangents = x.tangents
        self.units = x.units
        self.title = x.title
        self.asked = x.asked
        self.told = x.told

    def load(self, store: Store, field: Readable[V_co]) -> V_co:
        return self.x.load(store[self.place], field)

    def component(self, store: Store, name: str) -> Value:
        return self.x.component(store[self.place], name)

    def set_component(self, store: Store, name: str, value: Value) -> None:
        self.x.set_component(store[self.place], name, value)

    def recall(self, store: Store, field: Field[V], value: V) -> None:
        self.x.recall(store[self.place], field, value)

    def let(self, name: str, value: Value, tag: str = "", lanes: bool = False) -> Value:
        return self.x.let(name, value, tag, lanes=lanes)

    def number(self, value: float | Number) -> Value:
        return self.x.number(value)

    def sqrt(self, value: Value) -> Value:
        return self.x.sqrt(value)

    def call(self, function: str, *arguments: Value) -> Value:
        return self.x.call(function, *arguments)

    def name(self, name: str, value: Value, tag: str = "") -> Value:
        return self.x.name(name, value, tag)


@dataclass(slots=True)
class Freedom:
    """How a link moves with one freedom of its joint, in region axes.

    Attributes
    ----------
    angular, linear : Vector or None
        None where it does not turn, or slide.
    index : int
        Among the joint's freedoms.
    """

    angular: Vector | None
    linear: Vector | None
    index: int

    def along(self, angular: Vector, linear: Vector) -> Value:
        """What a moment and a force, or the like, are along it."""
        total: Value = 0
        for own, v in ((self.angular, angular), (self.linear, linear)):
            if own is not None:
                total = total + dot(own, v)
        return total


def joint_motion(freedoms: Sequence[Freedom], values: Sequence[Value]) -> tuple[Vector | None, Vector | None]:
    """Angular and linear part of a joint's motion with given rates of its freedoms; None where there is none."""
    angular: Vector | None = None
    linear: Vector | None = None
    for f, value in zip(freedoms, values, strict=True):
        if is_zero(value):
            continue
        if f.angular is not None:
            part = scale(value, f.angular)
            angular = part if angular is None else add(angular, part)
        if f.linear is not None:
            part = scale(value, f.linear)
            linear = part if linear is None else add(linear, part)
    return angular, linear


@dataclass(slots=True)
class Twist:
    """Angular and linear part of a motion, the latter of a link's origin."""

    angular: Vector
    linear: Vector

    @staticmethod
    def load(x: Scope, store: Store, field: SixField) -> Twist:
        """From a field of six components."""
        six = x.load(store, field)
        return Twist(six[:3], six[3:])

    def at(self, lever: Vector) -> Vector:
        """Linear part at a point of the link."""
        return add(self.linear, cross(self.angular, lever))


@dataclass(slots=True)
class Member:
    """A link of an ear: what its coordinates give.

    Attributes
    ----------
    W : Matrix
        Region components from link components.
    rho : Vector
        From the parent's origin to the link's.
    r : Vector
        The same in the parent link's components.
    freedoms : list of Freedom
    """

    view: MemberView
    kind: LinkKind
    joint: LinkJoint
    W: Matrix
    rho: Vector
    r: Vector
    freedoms: list[Freedom]
    parent: int


@dataclass(slots=True)
class FixedVector:
    """A vector that is fixed in a link (or, its place negative, in a root).

    Attributes
    ----------
    found, local : Vector
        In region and in link components.
    kept : (Store, VectorField) or None
        Where its tangent is kept once the seeds are complete.
    """

    place: int
    found: Vector
    local: Vector
    kept: tuple[Store, VectorField] | None


@dataclass(slots=True)
class Condition:
    """A condition of a loop.

    Attributes
    ----------
    loop : int
        Among the ear's.
    angular : bool
    n : Vector
        What it sees of a motion at the cut, in region axes: the component along n, scaled.
    turning : list of (weight, Vector, Vector)
        Where the loop may be open in others: an angular condition is that a sum of weight c . d is zero, c fixed in the end, d
        in the start, and n the sum of weight c x d.
    axis : Vector or None
        A direction of the start face in the place of n where what is open is told.
    """

    loop: int
    angular: bool
    n: Vector
    turning: list[tuple[Value, Vector, Vector]] = field(default_factory=list)
    axis: Vector | None = None


class Ear:
    """Geometry of an ear, and the steps from link to link.

    Parameters
    ----------
    x : Expansion or StructuralExpansion
    kind : EarKind
    fresh : bool
        Attitudes are computed; otherwise they are loaded.
    positions : VectorField
        Of the roots.
    """

    def __init__(self, x: Scope, kind: EarKind, fresh: bool = False, positions: VectorField = fields.ear_position):
        self.x = x
        self.kind = kind
        self.positions = positions
        self.members: list[Member] = []
        self.fixed: list[FixedVector] = []
        for k, link_kind in enumerate(kind.links):
            self.members.append(self._member(k, link_kind, fresh))

    # -- geometry --------------------------------------------------------------------------------------------------

    def attitude(self, place: int) -> Matrix:
        """Region components from link components, of a link or (negative) a root."""
        if place >= 0:
            return self.members[place].W
        t = -1 - place
        role = self.kind.roots[t]
        if role == "frame":
            return UNIT
        if role == "ground":
            return transpose(self.x.load(BASE, fields.closing_attitude))
        if role == "far":
            return self.x.load(REGION, fields.far_attitude(self.kind.far[t]))
        return self.x.load(ROOTS[t], fields.ear_attitude)

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
            Freedom(self._in_region(W, s.angular), self._in_region(W, s.linear), j) for j, s in enumerate(joint.columns)
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
        """Region components of a vector given in a link's; remembered for differentiation."""
        found = self.x.let_vector(name, rotate(self.attitude(place), v), tag)
        self.fixed.append(FixedVector(place, found, v, kept))
        return found

    def face(self, c: int, side: int) -> tuple[Vector, Matrix]:
        """Origin and axes of a loop joint's face in the components of its link: the joint's axis is a coordinate axis."""
        name = "AB"[side]
        r = self.x.load(LOOP_CONSTANTS[c], fields.face_place(name))
        return r, self.x.load(LOOP_CONSTANTS[c], fields.face_axes(name))

    def arm(self, c: int, side: int) -> Vector:
        """From the origin of a face's link to the face."""
        r, _ = self.face(c, side)
        place = self.kind.closures[c].faces[side]
        kept = (MY_LANE[place], fields.arm_tangent(c, "AB"[side])) if place >= 0 else None
        return self.fixed_vector("arm", place, r, kept=kept)

    @cached_property
    def levers(self) -> list[tuple[dict[int, Vector], dict[int, Vector]]]:
        """For each loop, from the origins of the links on both sides to the cut."""
        return [self._levers(c) for c in range(len(self.kind.closures))]

    def _levers(self, c: int) -> tuple[dict[int, Vector], dict[int, Vector]]:
        """From the origins of the links on both sides of a loop to the cut. The root's has the key -1."""
        result: tuple[dict[int, Vector], dict[int, Vector]] = ({}, {})
        slip = self.slip(c)
        for side in (0, 1):
            closure = self.kind.closures[c]
            path = closure.paths[side]
            lever = self.arm(c, side)
            if side == 0 and slip is not None:
                lever = self.x.let_vector("lever", add(lever, slip), "Eq. 32")
            for k in reversed(path):
                result[side][k] = lever
                lever = self.x.let_vector("lever", add(lever, self.members[k].rho), "Eq. 32")
            result[side][-1] = lever
        return result

    def slip(self, c: int) -> Vector | None:
        """From the origin of the start face to that of the end face; None where they coincide."""
        if not self.kind.closures[c].slides:
            return None
        a, b = (self.position_of_face(c, side) for side in (0, 1))
        return self.x.let_vector("slip", minus(b, a), "Eq. 32")

    def position_of_face(self, c: int, side: int) -> Vector:
        """In region axes, from the region's base."""
        place = self.kind.closures[c].faces[side]
        return self.x.let_vector("face", add(self.position(place), self.arm(c, side)), "Eq. 22")

    def position(self, place: int) -> Vector:
        """Of a link's origin, or a root's, in region axes, from the region's base."""
        if place >= 0:
            m = self.members[place]
            return self.x.let_vector("o", add(self.position(m.parent), m.rho), "Eq. 22")
        t = -1 - place
        role = self.kind.roots[t]
        if role == "frame":
            return ZERO
        if role == "ground":
            o = self.x.load(BASE, fields.closing_position)
            W = self.attitude(place)
            return self.x.let_vector("o", [-e for e in rotate(W, o)], "Eq. 22")
        if role == "far":
            return self.x.load(REGION, fields.far_position(self.kind.far[t]))
        return self.x.load(ROOTS[t], self.positions)

    # -- steps from link to link -----------------------------------------------------------------------------------

    def step(
        self, before: Twist, member: Member, coefficients: Vector, name: str, tag: str, lanes: bool = False
    ) -> Twist:
        """The motion of a link from its parent's, the joint's freedoms moving with the given coefficients."""
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
        """Motions of all links of the ear, from those of its roots and the rates of its freedoms."""
        found: list[Twist] = []
        for member, values in zip(self.members, coefficients, strict=True):
            before = found[member.parent] if member.parent >= 0 else roots[-1 - member.parent]
            found.append(self.step(before, member, values, name, tag, lanes))
        return found

    # -- closing conditions ----------------------------------------------------------------------------------------

    def face_axes(self, c: int, side: int) -> list[Vector]:
        """The three axes of a face in region components."""
        _, F = self.face(c, side)
        place = self.kind.closures[c].faces[side]
        return [self.fixed_vector("n", place, [F[i][j] for i in range(3)], "Eq. 33") for j in range(3)]

    def universal_axes(self, c: int) -> tuple[Vector, Vector]:
        """The two axes of a universal loop joint: the first fixed in the start, the second in the end."""
        closure = self.kind.closures[c]
        return self.face_axes(c, 0)[closure.axis], self.face_axes(c, 1)[closure.end_axis]

    def rows(self) -> list[Condition]:
        """The conditions of all loops that count. Linear ones are divided by the characteristic length."""
        found: list[Condition] = []
        for c, closure in enumerate(self.kind.closures):
            s = self.x.number(self.kind.scale)
            if closure.gaps:
                every = self._open_conditions(c, s)
                found += [row for i, row in enumerate(every) if i not in closure.dropped]
                continue
            type_ = closure.type
            linear: list[Vector] = [list(e) for e in UNIT]
            angular: list[Vector] = [list(e) for e in UNIT] if type_ in ("fixed", "prismatic") else []
            if type_ == "universal":
                a, b = self.universal_axes(c)
                angular = [self.x.let_vector("n", cross(a, b), "Eq. 33")]
            elif type_ not in ("fixed", "spherical"):
                columns = self.face_axes(c, 0)
                axis = closure.axis
                across = [columns[(axis + 1) % 3], columns[(axis + 2) % 3]]
                if type_ in ("prismatic", "cylindrical", "inline"):
                    linear = across
                elif type_ == "planar":
                    linear = [columns[axis]]
                if type_ not in ("prismatic", "inline"):
                    angular = across
            found += [Condition(c, False, n if s == 1 else scale(s, n)) for n in linear]
            found += [Condition(c, True, n) for n in angular]
        return found

    def kept_rows(self) -> list[Condition]:
        """Those of `rows` that can matter, as the block of the closures has found."""
        kept = self.kind.form.rows
        rows = self.rows() if kept else []
        return [rows[i] for i in kept]

    def joint_conditions(self, c: int) -> list[Condition]:
        """All conditions of a loop joint: linear ones, scaled, then angular ones."""
        closure = self.kind.closures[c]
        share = self.x.number(self.kind.per_length)
        if closure.gaps:
            return self._open_conditions(c, share)
        linear, columns = self._linear_directions(c)
        across = [columns[(closure.axis + 1) % 3], columns[(closure.axis + 2) % 3]]
        angular = {"fixed": columns, "prismatic": columns, "spherical": [], "inline": []}.get(closure.type, across)
        if closure.type == "universal":
            first, second = self.universal_axes(c)
            angular = [self.x.let_vector("n", cross(first, second), "Eq. 33")]
        return [Condition(c, False, scale(share, n)) for n in linear] + [Condition(c, True, n) for n in angular]

    def _linear_directions(self, c: int) -> tuple[list[Vector], list[Vector]]:
        """Directions of a loop joint's linear conditions, and the axes of its start face."""
        closure = self.kind.closures[c]
        columns = self.face_axes(c, 0)
        axis = closure.axis
        across = [columns[(axis + 1) % 3], columns[(axis + 2) % 3]]
        linear = {"prismatic": across, "cylindrical": across, "inline": across, "planar": [columns[axis]]}
        return linear.get(closure.type, columns), columns

    def _open_conditions(self, c: int, share: Value) -> list[Condition]:
        """All conditions of a loop joint whose faces may be apart: they hold, and so do their rates, where others do not."""
        closure = self.kind.closures[c]
        linear, s = self._linear_directions(c)
        found = [Condition(c, False, scale(share, n)) for n in linear]
        count = CLOSURE_ROWS[closure.type][1]
        if not count:
            return found
        e = self.face_axes(c, 1)
        i, j, k = closure.axis, (closure.axis + 1) % 3, (closure.axis + 2) % 3
        half = self.x.half
        if closure.type == "universal":
            turning: list[tuple[list[tuple[Value, Vector, Vector]], Vector | None]] = [
                ([(-1, e[closure.end_axis], s[i])], None)
            ]
        elif count == 2:
            turning = [([(-1, e[i], s[k])], s[j]), ([(1, e[i], s[j])], s[k])]
        else:
            turning = [([(half, e[n - 2], s[n - 1]), (-half, e[n - 1], s[n - 2])], s[n]) for n in range(3)]
        for terms, axis in turning:
            total: Vector = [0, 0, 0]
            for weight, a, b in terms:
                total = add(total, scale(weight, cross(a, b)))
            found.append(Condition(c, True, self.x.let_vector("n", total, "Eq. 33"), terms, axis))
        return found

    def difference(self, c: int, twists: tuple[Twist | None, Twist | None]) -> Twist:
        """Motion at the cut: the end's minus the start's, both given there."""
        angular: Vector = [0, 0, 0]
        linear: Vector = [0, 0, 0]
        for side, sign in ((1, 1), (0, -1)):
            t = twists[side]
            if t is not None:
                angular = [angular[i] + sign * t.angular[i] for i in range(3)]
                linear = [linear[i] + sign * t.linear[i] for i in range(3)]
        return Twist(angular, linear)

    def face_difference(self, motions: list[Twist], roots: list[Twist]) -> list[Twist]:
        """Motion of the end face against the start face at every cut, from motions of links and roots."""
        found = []
        for c, closure in enumerate(self.kind.closures):
            sides = []
            for side in (0, 1):
                place = closure.faces[side]
                t = motions[place] if place >= 0 else roots[-1 - place]
                lever = self.arm(c, side)
                slip = self.slip(c) if side == 0 else None
                if slip is not None:
                    lever = self.x.let_vector("lever", add(lever, slip), "Eq. 32")
                sides.append(Twist(t.angular, t.at(lever)))
            found.append(self.difference(c, (sides[0], sides[1])))
        return found

    def column(self, member: int, freedom: Freedom) -> list[Twist]:
        """What a freedom contributes to the difference at every cut."""
        found = []
        for c, closure in enumerate(self.kind.closures):
            total = Twist([0, 0, 0], [0, 0, 0])
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

    def conditions(
        self, rows: list[Condition], at_cuts: list[Twist], name: str, tag: str, lanes: bool = False
    ) -> Vector:
        """Components of motions at the cuts along the conditions."""
        result: Vector = []
        for row in rows:
            v = at_cuts[row.loop].angular if row.angular else at_cuts[row.loop].linear
            result.append(self.x.let(name, _along(row.n, v), tag, lanes=lanes))
        return result

    def root_difference(self, roots: list[Twist]) -> list[Twist]:
        """What the motion of the roots, all joints of the ear held, contributes at every cut."""
        found = []
        for c, closure in enumerate(self.kind.closures):
            sides: list[Twist | None] = [None, None]
            for side in (0, 1):
                t = closure.roots[side]
                if t >= 0:
                    sides[side] = Twist(roots[t].angular, roots[t].at(self.levers[c][side][-1]))
            found.append(self.difference(c, (sides[0], sides[1])))
        return found

    def dependents(self) -> list[tuple[int, Freedom]]:
        """The dependent freedoms, in the order of the closure matrix's columns."""
        return [(k, m.freedoms[j]) for k, m in enumerate(self.members) for j in self.kind.dependent[k]]

    def coefficients(self, dependent: Vector, independent: Callable[[int, int], Value] | None = None) -> list[Vector]:
        """For each link, values of its freedoms: the dependent ones as listed, the others by a function of link and freedom."""
        found = [
            [0 if independent is None else independent(k, f.index) for f in m.freedoms]
            for k, m in enumerate(self.members)
        ]
        for (k, f), value in zip(self.dependents(), dependent, strict=True):
            found[k][f.index] = value
        return found


def rotate(W: Matrix, v: Vector) -> Vector:
    """``W v``; the unit matrix costs nothing."""
    return list(v) if W is UNIT else matvec(W, v)


def _along(n: Vector, v: Vector) -> Value:
    total: Value = 0
    for a, b in zip(n, v, strict=True):
        total = total + product(a, b)
    return total
