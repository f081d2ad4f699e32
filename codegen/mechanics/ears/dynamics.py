"""Forward dynamics of ears and regions. Eqs. 31, 39-47, 53-56 in the sources of a region.

With ``A_k = Z_k w + A_t,k`` for all links of a region, its equations of motion are ``Q w = -g`` with ``Q = sum Z_k^T I_k
Z_k`` and ``g = sum Z_k^T (I_k A_t,k + bias) - joint forces``: the virtual body of Eqs. 39-41. A base that is a link carries
the region like one joint of as many freedoms.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ...model.model import CLOSURE_ROWS
from ...program.block import Scope
from ...program.field import PLACES, AnyField
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..couplings import (
    from_far,
    hand_force,
    hand_inertia,
    hand_on,
    others,
    partner_acceleration,
    to_base,
)
from ..handing_on import accumulate, accumulate_force, add_to_sum, clear
from ..joints.inertia import shift_inertia
from ..spatial import (
    SIX,
    add,
    cross,
    dot,
    is_zero,
    matmul,
    matvec,
    scale,
    six,
    skew,
    symmetric,
    transpose,
)
from ..stores import BASE, CONSTANTS, EAR, GROUND, LBASE, LME, LREGION, ME, OWN, PIVOT, REGION, ROOTS, SPEEDS, TAU, UDOT
from ..structure.elimination_order import CARRIER
from ..structure.kinds import EarKind, RegionKind
from ..tree.kinematics import acceleration_matrix, body_force
from ..tree.triangularization import SMALL, articulated_parts, pivot
from .closures import own_sources, source_speed, source_twist, stored_factor
from .far_links import far_motions
from .geometry import ZERO, Condition, Ear, Member, Twist, joint_motion, rotate

Motion = tuple[Vector, Vector, Vector, Matrix]
"""Angular velocity, angular and linear acceleration, and B = alpha x + omega x omega x of a link, in region axes."""

FaceMotion = Callable[[int, int], tuple[Vector, Vector, Vector]]
"""Angular velocity, angular and linear acceleration of a face by loop and side, in region axes."""


def root_motions(x: Scope, kind: EarKind, total: bool = False) -> list[Motion]:
    """Motions of the roots; `total`: with all of the accelerations, not only the remainders."""
    of_base, of_far, of_link = (
        (fields.total, fields.far_total, fields.ear_total)
        if total
        else (fields.remainder, fields.far_remainder, fields.ear_remainder)
    )
    found: list[Motion] = []
    for t, role in enumerate(kind.roots):
        if role == "frame":
            store, motion = BASE, of_base
        elif role == "far":
            store, motion = REGION, of_far(kind.far[t])
        elif role == "ground":
            W = transpose(x.load(BASE, fields.closing_attitude))
            moved = rotate(W, x.load(GROUND, of_base.a))
            a = [0 if is_zero(e) else x.name("ga", e, "Eq. 22") for e in moved]
            found.append((list(ZERO), list(ZERO), a, [[0] * 3 for _ in range(3)]))
            continue
        else:
            store, motion = ROOTS[t], of_link
        w, al, a = (x.load(store, field) for field in (motion.w, motion.al, motion.a))
        found.append((w, al, a, x.load(store, motion.B)))
    return found


def link_constants(x: Scope, ear: Ear, k: int) -> tuple[Value, Vector, Matrix]:
    """Mass, first moment and inertia about the origin of a link, in region axes."""
    member = ear.members[k]
    m = member.view.load(CONSTANTS, fields.mass)
    h = ear.fixed_vector("h", k, member.view.load(CONSTANTS, fields.first_moment), "Eq. 23")
    return m, h, rotated_inertia(x, member.W, member.view.load(CONSTANTS, fields.inertia), "Eq. 23")


def rotated_inertia(x: Scope, W: Matrix, J: Matrix, tag: str) -> Matrix:
    """``W J W^T``."""
    axis = None if x.structural else _axis_of_symmetry(J)
    if axis is not None:
        # J = a (U - e e^T) + c e e^T, the first bracket by sums of squares: nothing cancels in its entries
        e = [W[i][axis] for i in range(3)]
        c, a = J[axis][axis], J[axis - 1][axis - 1]
        squares = [x.let("ee", v * v, tag) for v in e]
        across = [a * x.let("es", squares[i - 2] + squares[i - 1], tag) + c * squares[i] for i in range(3)]
        more = x.let("ca", c - a, tag)
        mixed = [more * x.let("ee", e[i] * e[j], tag) for i, j in ((0, 1), (0, 2), (1, 2))]
        return symmetric([x.let("J", v, tag) for v in (*across, *mixed)])
    half = [[x.let("WJ", e, tag) for e in row] for row in matmul(W, J)]
    entries = [dot(half[i], W[j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return symmetric([x.let("J", e, tag) for e in entries])


def _axis_of_symmetry(J: Matrix) -> int | None:
    """The axis of a diagonal inertia whose other two moments are the same constant."""
    if not all(is_zero(J[i][j]) for i, j in ((0, 1), (0, 2), (1, 2))):
        return None
    for axis in range(3):
        a, b = J[axis - 1][axis - 1], J[axis - 2][axis - 2]
        if a == b and not is_zero(a):
            return axis
    return None


def joint_bias(x: Scope, member: Member, w_before: Vector, speeds: Vector) -> tuple[Vector, Vector]:
    """Angular and linear acceleration that a joint adds with udot = 0. Eq. 21."""
    turning, sliding = ([x.let("rel", e, "Eq. 21") for e in v or ZERO] for v in joint_motion(member.freedoms, speeds))
    own = turning if member.joint.swings else ZERO
    twice = [2 * w_before[i] + own[i] for i in range(3)] if any(not is_zero(v) for v in sliding) else list(ZERO)
    twice = [x.let("sweep", e, "Eq. 21") for e in twice]
    return cross(w_before, turning), cross(twice, sliding)


def speeds_of(member: Member) -> Vector:
    return [member.view.entry(SPEEDS, f.index) for f in member.freedoms]


def member_motion(x: Scope, member: Member, before: Motion, extra: Vector | None = None) -> Motion:
    """Motion of a link from its parent's; `extra` are the joint's udot, none if left out."""
    w0, al0, a0, B0 = before
    speeds = speeds_of(member)
    turning, _ = joint_motion(member.freedoms, speeds)
    w = x.let_vector("w", add(w0, turning or ZERO), "Eq. 18")
    al_bias, a_bias = joint_bias(x, member, w0, speeds)
    al = add(al0, al_bias)
    a = add(a0, matvec(B0, member.rho), a_bias)
    if extra is not None:
        turning, sliding = joint_motion(member.freedoms, extra)
        al, a = add(al, turning or ZERO), add(a, sliding or ZERO)
    al = x.let_vector("al", al, "Eq. 21")
    a = x.let_vector("a", a, "Eq. 21")
    return w, al, a, acceleration_matrix(x, w, al)


def root_velocities(x: Scope, kind: EarKind) -> list[Twist]:
    """Velocities of the roots, relative to a base that carries the region rigidly. Eq. 30."""
    found = []
    for t in range(len(kind.roots)):
        angular: Vector = [0, 0, 0]
        linear: Vector = [0, 0, 0]
        for c in range(kind.total):
            twist = source_twist(x, kind, t, c)
            if all(is_zero(v) for v in (*twist.angular, *twist.linear)):
                continue
            speed = source_speed(x, kind, c, own_sources(kind).get(c))
            angular, linear = add(angular, scale(speed, twist.angular)), add(linear, scale(speed, twist.linear))
        # symbols of their own, even for copies: their tangents are known
        named = [[0 if is_zero(e) else x.name("V", e, "Eq. 30") for e in v] for v in (angular, linear)]
        found.append(Twist(*named))
    return found


def face_motion(
    ear: Ear, motions: list[Motion], roots: list[Motion], c: int, side: int
) -> tuple[Vector, Vector, Vector]:
    """Angular velocity, angular acceleration and acceleration of a loop's face."""
    place = ear.kind.closures[c].faces[side]
    w, al, a, B = motions[place] if place >= 0 else roots[-1 - place]
    return w, al, add(a, matvec(B, ear.arm(c, side)))


def slip_velocities(x: Scope, ear: Ear, roots: list[Twist]) -> list[Twist]:
    """Relative velocities at the cuts, for joints that slide."""
    velocities = ear.walk(roots, [speeds_of(m) for m in ear.members], "s", "Eq. 30")
    return ear.face_difference(velocities, roots)


def closing_accelerations(
    x: Scope,
    ear: Ear,
    rows: list[Condition],
    face: FaceMotion,
    name: str,
    root_speeds: list[Twist] | None = None,
) -> Vector:
    """What the conditions see of the faces' accelerations, with what their turning adds. Eq. 31."""
    at_cuts, relative = cut_accelerations(x, ear, face, root_speeds)
    result: Vector = []
    for row, value in zip(rows, ear.conditions(rows, at_cuts, name, "Eq. 31"), strict=True):
        w = relative[row.loop]
        for weight, c, d in row.turning:  # c turns with the end: ((w x c) x d) . w
            turned = [x.let("nd", v, "Eq. 31") for v in cross([x.let("nc", v, "Eq. 31") for v in cross(w, c)], d)]
            value = value + weight * x.let("nrate", dot(turned, w), "Eq. 31")
        result.append(x.let(name, value, "Eq. 31") if row.turning else value)
    return result


def cut_accelerations(
    x: Scope, ear: Ear, face: FaceMotion, root_speeds: list[Twist] | None = None
) -> tuple[list[Twist], list[Vector]]:
    """What the faces' accelerations differ by at every cut, and their angular velocities. Eq. 31.

    The joint's own remainder is taken off, for conditions that turn with the start face.
    """
    found = []
    turning: list[Vector] = []
    slips = []
    if any(c.slides for c in ear.kind.closures):
        slips = slip_velocities(x, ear, root_speeds or root_velocities(x, ear.kind))
    for c, closure in enumerate(ear.kind.closures):
        if closure.roots == (-1, -1) and not any(closure.paths):
            found.append(Twist(list(ZERO), list(ZERO)))
            turning.append(list(ZERO))
            continue
        sides = []
        for side in (0, 1):
            w, al, a = face(c, side)
            slip = ear.slip(c) if side == 0 else None
            if slip is not None:
                a = add(a, matvec(acceleration_matrix(x, w, al), slip))
            sides.append((w, al, a))
        (w_a, al_a, a_a), (w_b, al_b, a_b) = sides
        relative = [x.let("wrel", w_b[i] - w_a[i], "Eq. 31") for i in range(3)]
        angular = [al_b[i] - al_a[i] for i in range(3)]
        if CLOSURE_ROWS[closure.type][1]:
            turn = cross(w_a, relative)
            angular = [angular[i] - turn[i] for i in range(3)]
        if closure.type == "universal" and not closure.gaps:
            angular = universal_bias(x, ear, c, angular, w_a, w_b, relative)
        linear = [a_b[i] - a_a[i] for i in range(3)]
        if closure.slides:
            coriolis = cross(w_a, slips[c].linear)
            linear = [linear[i] - 2 * coriolis[i] for i in range(3)]
        found.append(Twist([x.let("ca", e, "Eq. 31") for e in angular], [x.let("cl", e, "Eq. 31") for e in linear]))
        turning.append(relative)
    return found, turning


def universal_bias(x: Scope, ear: Ear, c: int, angular: Vector, w_a: Vector, w_b: Vector, relative: Vector) -> Vector:
    """For a universal joint with axes a and b: ``d/dt (n . w_rel)``, n = a x b, as an angular vector along n.

    `angular` comes with ``- w_a x w_rel`` in it, which is right for directions fixed in the start face; n turns with both.
    """
    a, b = ear.universal_axes(c)
    # d n/dt = (w_a x a) x b + a x (w_b x b) = w_a x n + a x (w_rel x b)
    turning = cross(a, cross(relative, b))
    rate = x.let("nrate", dot([x.let("nd", e, "Eq. 31") for e in turning], relative), "Eq. 31")
    n = [x.let("n", e, "Eq. 33") for e in cross(a, b)]
    return [angular[i] + rate * n[i] for i in range(3)]


def ear_kinematics(x: Scope, kind: EarKind) -> None:
    """Outward block: motion with the sources at rest, dependent joints accelerating as closure asks, and the force it needs."""
    ear = Ear(x, kind)
    rows = ear.kept_rows()
    roots = root_motions(x, kind)
    motions: list[Motion] = []
    for member in ear.members:
        before = motions[member.parent] if member.parent >= 0 else roots[-1 - member.parent]
        motions.append(member_motion(x, member, before))
    if rows:
        b = closing_accelerations(x, ear, rows, partial(face_motion, ear, motions, roots), "b")
        rates = stored_factor(x, kind).solve([-v for v in b], "y", "Eq. 38")
        still = [Twist(list(ZERO), list(ZERO)) for _ in kind.roots]
        added = ear.walk(still, ear.coefficients(rates), "e", "Eq. 38")
        for d, y in enumerate(rates):
            x.store(EAR, fields.dependent_remainder(d), y)
        for k, (w, al, a, _) in enumerate(motions):
            al = x.let_vector("al", add(al, added[k].angular), "Eq. 31")
            a = x.let_vector("a", add(a, added[k].linear), "Eq. 31")
            motions[k] = (w, al, a, acceleration_matrix(x, w, al))
    for k, (w, al, a, B) in enumerate(motions):
        me = ME[k]
        constants = link_constants(x, ear, k)
        moment, force = body_force(x, w, al, a, B, constants)
        x.store(me, fields.ear_first_moment, constants[1])
        x.store(me, fields.ear_inertia, constants[2])
        motion = fields.ear_remainder
        for field, v in ((motion.w, w), (motion.al, al), (motion.a, a)):
            x.store(me, field, v)
        x.store(me, motion.B, B)
        moment, force = less_external_of(x, ear, k, (moment, force))
        x.store(me, fields.ear_needed, [*moment, *force])
        if kind.links[k].carries:
            hand_outward(x, me, ear.members[k].W, w, al, a)


def less_external_of(x: Scope, ear: Ear, k: int, needed: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
    """What is left of the force that a link needs when force elements have acted on it, in region axes."""
    if not ear.kind.links[k].pulled:
        return needed
    external = fields.external
    acting = [rotate(ear.members[k].W, x.load(ME[k], field)) for field in (external.angular, external.linear)]
    n, f = (
        [x.let("less", e - by, "Eq. 24") for e, by in zip(v, w, strict=True)]
        for v, w in zip(needed, acting, strict=True)
    )
    return n, f


def hand_outward(x: Scope, store: Store, W: Matrix, w: Vector, al: Vector, a: Vector, total: bool = False) -> None:
    """Motion in the link's own axes, for the links that it carries."""
    back = transpose(W)
    w, al, a = ([x.let("own", e, "Eq. 22") for e in matvec(back, v)] for v in (w, al, a))
    motion = fields.total if total else fields.remainder
    if not total:
        x.store(store, motion.w, w)
    x.store(store, motion.al, al)
    x.store(store, motion.a, a)
    x.store(store, motion.B, acceleration_matrix(x, w, al))


def region_start(x: Scope, kind: RegionKind) -> None:
    """Outward block of a region: nothing is summed yet; how its far links move."""
    for field in sum_fields(kind):
        clear(x, REGION, field)
    far_motions(x, kind)


def sum_fields(kind: RegionKind) -> list[AnyField]:
    """What the ears of a region sum up."""
    sources = range(kind.total)
    found: list[AnyField] = [fields.source_inertia(c, d) for c in sources for d in range(c, kind.total)]
    found += [fields.source_force(c) for c in sources]
    if kind.carried and kind.rigid:
        carried = fields.region_inertia
        found += [carried.J, carried.M, carried.H, fields.region_force, *(fields.source_to_base(c) for c in sources)]
    partners, rows = range(len(kind.partners.links)), range(system_size(kind))
    return found + [fields.source_to_partner(m, c, k) for m in partners for c in rows for k in SIX]


def place_of_base(kind: RegionKind) -> int:
    """Where the base's six components begin among the unknowns of a region."""
    return int(kind.total if kind.rigid else kind.sources)


def system_size(kind: RegionKind) -> int:
    """Unknowns of a region: its sources, and the six components of a base that carries it rigidly."""
    return int(kind.total + (6 if kind.carried and kind.rigid else 0))


def places_of_partners(kind: RegionKind) -> list[int]:
    """Where the six components of each partner begin among the unknowns: after the region's own; the base has its place."""
    found, at = [], system_size(kind)
    for m in range(len(kind.partners.links)):
        found.append(place_of_base(kind) if m == kind.partners.base else at)
        at += 0 if m == kind.partners.base else 6
    return found


def apply_inertia(
    x: Scope, J: Matrix, H: Matrix, M: Matrix, angular: Vector, linear: Vector, name: str, tag: str
) -> tuple[Vector, Vector]:
    """Moment and force of a generalised inertia at an acceleration."""
    n = add(matvec(J, angular), matvec(H, linear))
    f = add(matvec(transpose(H), angular), matvec(M, linear))
    return [x.let(f"{name}n", e, tag) for e in n], [x.let(f"{name}f", e, tag) for e in f]


def member_inertia(x: Scope, ear: Ear, k: int) -> tuple[Matrix, Matrix, Matrix, Vector, Vector]:
    """Inertia of a link with all that it carries, and the force that its motion needs, in region axes about its origin."""
    member = ear.members[k]
    m, J = member.view.load(CONSTANTS, fields.mass), x.load(ME[k], fields.ear_inertia)
    H = skew(x.load(ME[k], fields.ear_first_moment))
    M: Matrix = [[m if i == j else 0 for j in range(3)] for i in range(3)]
    n, f = x.load(ME[k], fields.ear_needed.angular), x.load(ME[k], fields.ear_needed.linear)
    if ear.kind.links[k].carries:
        J_c, H_c, M_c, n_c, f_c = articulated_parts(member.view)
        W = member.W
        half = [[x.let("WH", e, "Eq. 44") for e in row] for row in matmul(W, H_c)]
        H = [[x.let("H", H[i][j] + dot(half[i], W[j]), "Eq. 44") for j in range(3)] for i in range(3)]
        J_c, M_c = rotated_inertia(x, W, J_c, "Eq. 44"), rotated_inertia(x, W, M_c, "Eq. 44")
        J = symmetric([x.let("J", a + b, "Eq. 44") for a, b in zip(six(J), six(J_c), strict=True)])
        M = symmetric([x.let("M", a + b, "Eq. 44") for a, b in zip(six(M), six(M_c), strict=True)])
        n = [x.let("n", a + b, "Eq. 45") for a, b in zip(n, rotate(W, n_c), strict=True)]
        f = [x.let("f", a + b, "Eq. 45") for a, b in zip(f, rotate(W, f_c), strict=True)]
    return J, H, M, n, f


def ear_triangularize(x: Scope, kind: EarKind) -> None:
    """Inward block: what the ear's links add to the inertia and force of their region. Eqs. 39-41."""
    ear = Ear(x, kind)
    tag = "Eq. 40"
    own = own_sources(kind)
    Q: dict[tuple[int, int], Value] = {}
    g: dict[int, Value] = {}
    K: dict[int, tuple[Vector, Vector]] = {}
    for k in range(len(ear.members)):
        J, H, M, n, f = member_inertia(x, ear, k)
        Z = {c: (z[:3], z[3:]) for c, z in motions_with_sources(x, kind, k).items()}
        for c, (zw, zv) in Z.items():
            N = apply_inertia(x, J, H, M, zw, zv, "N", tag)
            for d, (yw, yv) in Z.items():
                if d <= c:
                    Q[d, c] = Q.get((d, c), 0) + dot(yw, N[0]) + dot(yv, N[1])
            g[c] = g.get(c, 0) + dot(zw, n) + dot(zv, f)
            if kind.carried and kind.rigid:
                o = ear.position(k)
                shifted = add(N[0], cross(o, N[1])), N[1]
                K[c] = (add(K[c][0], shifted[0]), add(K[c][1], shifted[1])) if c in K else shifted
        if kind.carried and kind.rigid:
            _to_base(x, ear.position(k), J, H, M, n, f)
    couplings_of_ear(x, ear, Q, K)
    for d, (k, freedom) in enumerate(ear.dependents()):
        if kind.links[k].forced[freedom.index]:
            tau = x.entry(TAU[k], freedom.index)
            for c in range(kind.total):
                g[c] = g.get(c, 0) - x.load(EAR, fields.dependent_rate(d, c)) * tau
    for c, (k, j) in own.items():
        if kind.links[k].forced[j]:
            g[c] = g.get(c, 0) - x.entry(TAU[k], j)
    for (d, c), value in Q.items():
        x.store(REGION.sum, fields.source_inertia(d, c), x.let("Q", value, tag))
    for c, value in g.items():
        x.store(REGION.sum, fields.source_force(c), x.let("g", value, "Eq. 41"))
    for c, (n, f) in K.items():
        add_to_sum(x, REGION, fields.source_to_base(c), [*n, *f], "K", "Eq. 39")


def motions_with_sources(x: Scope, kind: EarKind, k: int) -> dict[int, Vector]:
    """How a link of an ear moves with each source, those that do not move it left out."""
    found = {
        c: x.load(ME[k], fields.per_source(c).angular) + x.load(ME[k], fields.per_source(c).linear)
        for c in range(kind.total)
    }
    return {c: z for c, z in found.items() if any(not is_zero(v) for v in z)}


def couplings_of_ear(x: Scope, ear: Ear, Q: dict[tuple[int, int], Value], K: dict[int, tuple[Vector, Vector]]) -> None:
    """What the couplings of an ear's links are in the sources of its region: inertia, or couplings of the region. Eq. 40."""
    kind, tag = ear.kind, "Eq. 40"
    found: dict[tuple[int, int, int], Value] = {}
    for n, (j, other) in enumerate(kind.partners.between):
        C: Matrix = [[0] * 6 for _ in SIX]
        for k, column in enumerate(zip(*x.load(OWN[n], fields.coupling), strict=True)):
            turned = [e for part in (column[:3], column[3:]) for e in rotate(ear.members[j].W, list(part))]
            for i in SIX:
                C[i][k] = x.let("C", turned[i], tag)
        Z = motions_with_sources(x, kind, j)
        if other < 0:
            m = -1 - other
            for c, z in Z.items():
                for k in SIX:
                    found[m, c, k] = found.get((m, c, k), 0) + sum(z[i] * C[i][k] for i in SIX)
            if kind.carried and kind.rigid:
                for k, column in enumerate(zip(*C, strict=True)):
                    for i, value in enumerate(to_base(x, ear.position(j), list(column), tag)):
                        found[m, kind.total + i, k] = found.get((m, kind.total + i, k), 0) + value
            continue
        for row in C:
            row[:] = [x.let("C", e, tag) for part in (row[:3], row[3:]) for e in rotate(ear.members[other].W, part)]
        Z_other = motions_with_sources(x, kind, other)
        for one, Z_one, Z_two, block in ((j, Z, Z_other, C), (other, Z_other, Z, transpose(C))):
            for c, z in Z_two.items():
                N = [x.let("N", sum(block[i][k] * z[k] for k in SIX), tag) for i in SIX]
                for d, y in Z_one.items():
                    if d <= c:
                        Q[d, c] = Q.get((d, c), 0) + sum(y[i] * N[i] for i in SIX)
                if kind.carried and kind.rigid:
                    moved = to_base(x, ear.position(one), N, tag)
                    before = K.get(c, (list(ZERO), list(ZERO)))
                    K[c] = add(before[0], moved[:3]), add(before[1], moved[3:])
        if kind.carried and kind.rigid:
            _coupling_to_base(x, ear.position(j), ear.position(other), C)
    for (m, c, k), value in found.items():
        x.store(REGION.sum, fields.source_to_partner(m, c, k), x.let("P", value, tag))


def _coupling_to_base(x: Scope, o: Vector, o_other: Vector, C: Matrix) -> None:
    """Add a coupling of two links that the base carries to what it carries."""
    half = transpose([to_base(x, o, list(column), "Eq. 39") for column in zip(*C, strict=True)])
    whole = [to_base(x, o_other, row, "Eq. 39") for row in half]
    carried = fields.region_inertia
    for field, a, b in ((carried.J, 0, 0), (carried.M, 3, 3), (carried.H, 0, 3)):
        both = [[whole[a + i][b + k] + whole[b + k][a + i] for k in range(3)] for i in range(3)]
        add_to_sum(x, REGION, field, both, "I", "Eq. 39")


def _to_base(x: Scope, o: Vector, J: Matrix, H: Matrix, M: Matrix, n: Vector, f: Vector) -> None:
    """Add a link's inertia and force, about the base's origin, to what the base carries."""
    J, H, M = shift_inertia(x, o, J, H, M, "Eq. 39")
    n = add(n, cross(o, f))
    carried = fields.region_inertia
    for field, block in ((carried.J, J), (carried.M, M), (carried.H, H)):
        add_to_sum(x, REGION, field, block, "I", "Eq. 39")
    add_to_sum(x, REGION, fields.region_force, [*n, *f], "p", "Eq. 41")


def region_system(x: Scope, kind: RegionKind) -> tuple[Matrix, Vector]:
    """Inertia and force of a region over its sources, a base that is a link, and partners."""
    at, where = place_of_base(kind), places_of_partners(kind)
    size = system_size(kind) + 6 * len(others(kind))
    Q: Matrix = [[0] * size for _ in range(size)]
    g: Vector = [0] * size
    for c in range(kind.total):
        g[c] = x.load(REGION, fields.source_force(c))
        for d in range(c, kind.total):
            Q[c][d] = Q[d][c] = x.load(REGION, fields.source_inertia(c, d))
    if kind.carried and kind.rigid:
        J, M = x.load(REGION, fields.region_inertia.J), x.load(REGION, fields.region_inertia.M)
        H = x.load(REGION, fields.region_inertia.H)
        for i in range(3):
            for j in range(3):
                Q[at + i][at + j], Q[at + 3 + i][at + 3 + j] = J[i][j], M[i][j]
                Q[at + i][at + 3 + j] = Q[at + 3 + j][at + i] = H[i][j]
            force = fields.region_force.scalars()
            g[at + i], g[at + 3 + i] = x.load(REGION, force[i]), x.load(REGION, force[3 + i])
        for c in range(kind.total):
            for i in range(6):
                Q[c][at + i] = Q[at + i][c] = x.load(REGION, fields.source_to_base(c).scalars()[i])
    for m, first in enumerate(where):
        P = [[x.load(REGION, fields.source_to_partner(m, c, k)) for k in SIX] for c in range(system_size(kind))]
        for c, row in enumerate(P):
            for k, value in enumerate(row):
                if m != kind.partners.base:
                    Q[c][first + k] = Q[first + k][c] = value
                elif not at <= c < at + 6:
                    Q[c][at + k] = Q[at + k][c] = x.let("Q", Q[c][at + k] + value, "Eq. 40")
                elif c - at <= k:  # it stands on both sides of the base's own block
                    both = value + P[at + k][c - at]
                    Q[c][at + k] = Q[at + k][c] = x.let("Q", Q[c][at + k] + both, "Eq. 40")
    return Q, g


def region_triangularize(x: Scope, kind: RegionKind) -> None:
    """Inward block of a region: its sources are eliminated, the last one first; what is left goes to the link that carries it.

    Eqs. 44-47.
    """
    let = x.let
    Q, g = region_system(x, kind)
    size = len(Q)
    for j in reversed(range(kind.sources)):
        D = pivot(x, kind, Q[j][j])
        inverse = let("Dinv", 1 / D, "Eq. 47")
        # what is left is measured against what the source's own inertia was before others were eliminated
        whole = x.load(REGION, fields.source_inertia(j, j))
        x.set_entry(PIVOT, j, let("margin", D - x.number(SMALL) * whole, "zero pivot"))
        x.store(REGION, fields.source_inverse_pivot(j), inverse)
        x.store(REGION, fields.source_right_side(j), let("rD", -g[j] * inverse, "Eq. 53"))
        remaining = [i for i in range(size) if i < j or i >= kind.sources]
        G = {i: let("G", Q[i][j] * inverse, "Eq. 46") for i in remaining}
        for i in remaining:
            x.store(REGION, fields.gain(j, i), G[i])
        U = {i: Q[i][j] for i in remaining}
        for i in remaining:
            for k in remaining:
                if k >= i:
                    Q[i][k] = Q[k][i] = let("Q", Q[i][k] - G[i] * U[k], "Eq. 44")
            g[i] = let("g", g[i] - G[i] * g[j], "Eq. 45")
    at = place_of_base(kind)
    if kind.far:
        absolute_motions(x, kind, Q, g)
    where = places_of_partners(kind)
    for m in others(kind):
        first = where[m]
        hand_inertia(x, kind, m, [row[first : first + 6] for row in Q[first : first + 6]])
        hand_force(x, kind, m, g[first : first + 6])

    def remaining_block(m: int, n: int) -> Matrix:
        rows, columns = (at if end == CARRIER else where[end] for end in (m, n))
        return [row[columns : columns + 6] for row in Q[rows : rows + 6]]

    hand_on(x, kind, remaining_block)
    if not kind.carried:
        return
    accumulate_force(x, BASE, fields.articulated_force, g[at : at + 6], kind.first, "Eq. 44")
    handed = fields.articulated
    for J, M, (i, j) in zip(handed.J.scalars(), handed.M.scalars(), PLACES, strict=True):
        accumulate(x, BASE, J, Q[at + i][at + j], kind.first, "Eq. 44")
        accumulate(x, BASE, M, Q[at + 3 + i][at + 3 + j], kind.first, "Eq. 44")
    H = [row[at + 3 : at + 6] for row in Q[at : at + 3]]
    accumulate(x, BASE, handed.H, H, kind.first, "Eq. 44")


def absolute_motions(x: Scope, kind: RegionKind, Q: Matrix, g: Vector) -> None:
    """From relative motions of far links to their accelerations and the base's: ``s = A_far - X A_base``, a congruence. Eq. 39.

    Changes Q and g; the far links' columns are in their own axes then.
    """
    tag = "Eq. 39"
    base, where = place_of_base(kind), places_of_partners(kind)
    for f, m in enumerate(kind.far):
        s = kind.sources + 6 * f
        W, o = x.load(REGION, fields.far_attitude(f)), x.load(REGION, fields.far_position(f))

        def add_to(target: Vector, v: Vector, m: int = m, W: Matrix = W, o: Vector = o) -> None:
            """Add what six components along s are along the base and the far link."""
            for i, value in enumerate(to_base(x, o, v, tag)):
                target[base + i] = x.let("Q", target[base + i] - value, tag)
            if m >= 0:
                for i, value in enumerate(from_far(x, W, v, tag)):
                    target[where[m] + i] = x.let("Q", target[where[m] + i] + value, tag)

        add_to(g, g[s : s + 6])
        for row in Q[kind.sources :]:
            add_to(row, row[s : s + 6])
        changed = [base + i for i in SIX] + ([where[m] + i for i in SIX] if m >= 0 else [])
        for c in changed:
            column = [row[c] for row in Q]
            add_to(column, column[s : s + 6])
            for r in changed:
                Q[r][c] = column[r]
        for r, row in enumerate(Q):
            if r not in changed:
                for c in changed:
                    Q[c][r] = row[c]


def base_acceleration(x: Scope, kind: RegionKind, lanes: bool) -> Vector:
    """The base's acceleration, as far as it is explicit in udot; nothing for the ground."""
    if not kind.carried:
        return []
    return list(x.load(LBASE if lanes else BASE, fields.explicit_acceleration))


def outer_accelerations(x: Scope, kind: RegionKind, lanes: bool) -> dict[int, Value]:
    """What is known of a region's unknowns before its own are: motions of far links, base and partners, by place."""
    base = base_acceleration(x, kind, lanes)
    of_partners = [partner_acceleration(x, kind, m, lanes) for m in range(len(kind.partners.links))]
    found = {place_of_base(kind) + i: value for i, value in enumerate(base)}
    for m in others(kind):
        found |= {places_of_partners(kind)[m] + i: value for i, value in enumerate(of_partners[m])}
    for f, m in enumerate(kind.far):
        W, o = x.load(REGION, fields.far_attitude(f)), x.load(REGION, fields.far_position(f))
        angular, linear = [-v for v in base[:3]], [-v for v in add(base[3:], cross(base[:3], o))]
        if m >= 0:
            angular = add(rotate(W, of_partners[m][:3]), angular)
            linear = add(rotate(W, of_partners[m][3:]), linear)
        for i, value in enumerate((*angular, *linear)):
            found[kind.sources + 6 * f + i] = x.let("rel", value, "Eq. 54", lanes=lanes)
    return found


def region_back_substitute(x: Scope, kind: RegionKind) -> None:
    """Outward block of a region: the accelerations of its sources. Eq. 53."""
    store_sources(x, kind, [x.load(REGION, fields.source_right_side(j)) for j in range(kind.sources)], False)


def store_sources(x: Scope, kind: RegionKind, right: Vector, lanes: bool) -> None:
    """Back substitution among the sources, and the relative accelerations of far links."""
    store = LREGION if lanes else REGION
    outer = outer_accelerations(x, kind, lanes)
    found: Vector = []
    for j in range(kind.sources):
        value = right[j]
        for i, known in [*enumerate(found), *sorted(outer.items())]:
            value = value - x.load(REGION, fields.gain(j, i)) * known
        found.append(x.let("a", value, "Eq. 53", lanes=lanes))
    for c, value in enumerate(found):
        x.store(store, fields.source_acceleration(c), value)
    if kind.far:
        for c in range(kind.sources, kind.total):
            x.store(store, fields.source_acceleration(c), outer[c])


def source_accelerations(x: Scope, kind: EarKind, lanes: bool) -> Vector:
    """Accelerations of all sources as an ear sees them."""
    store, own = LREGION if lanes else REGION, kind.total if kind.rigid else kind.sources
    found = [x.load(store, fields.source_acceleration(c)) for c in range(own)]
    if kind.total > len(found):
        found += x.load(LBASE if lanes else BASE, fields.explicit_acceleration)
    return found


def ear_back_substitute(x: Scope, kind: EarKind) -> None:
    """Outward block: accelerations of the ear's joints. Eqs. 53, 54."""
    a = source_accelerations(x, kind, False)
    own = own_sources(kind)
    for c, (k, j) in own.items():
        x.set_entry(UDOT[k], j, a[c])
    dependents = [(k, j) for k in range(len(kind.links)) for j in kind.dependent[k]]
    for d, (k, j) in enumerate(dependents):
        value = x.load(EAR, fields.dependent_remainder(d))
        for c in range(kind.total):
            value = value + x.load(EAR, fields.dependent_rate(d, c)) * a[c]
        x.set_entry(UDOT[k], j, x.let("udot", value, "Eq. 53"))
    if any(link.carries for link in kind.links):
        carried_accelerations(x, kind, a, False)


def carried_accelerations(x: Scope, kind: EarKind, a: Vector, lanes: bool) -> None:
    """The explicit part of the accelerations of links that carry others, in their own axes. Eq. 54."""
    ear = Ear(x, kind)
    store, base = (LME, LBASE) if lanes else (ME, BASE)
    rigid = x.load(base, fields.explicit_acceleration) if kind.carried and kind.rigid else None
    for k, member in enumerate(ear.members):
        if not kind.links[k].carries:
            continue
        angular: Vector = [0, 0, 0]
        linear: Vector = [0, 0, 0]
        if rigid is not None:
            angular, linear = rigid[:3], add(rigid[3:], cross(rigid[:3], ear.position(k)))
        for c in range(kind.total):
            angular = add(angular, scale(a[c], x.load(ME[k], fields.per_source(c).angular)))
            linear = add(linear, scale(a[c], x.load(ME[k], fields.per_source(c).linear)))
        angular = [x.let("A", e, "Eq. 54", lanes=lanes) for e in angular]
        linear = [x.let("A", e, "Eq. 54", lanes=lanes) for e in linear]
        back = transpose(member.W)
        own = [x.let("bal", e, "Eq. 54", lanes=lanes) for e in matvec(back, angular)]
        own += [x.let("ba", e, "Eq. 54", lanes=lanes) for e in matvec(back, linear)]
        x.store(store[k], fields.explicit_acceleration, own)
