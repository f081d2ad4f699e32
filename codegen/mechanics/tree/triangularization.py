"""Triangularization, inward: articulated inertias and forces. Eqs. 42-47.

The joint's own row and column of the inertia that is handed on are structural zeros and the joint's entry of the force
is the joint force itself (T_k annihilates P_k exactly): neither is ever computed. A joint of several freedoms is
eliminated one unit column after the other, which is the LDL^T factorisation of its M_k.
"""

from __future__ import annotations

from ...program.block import ANY, Scope
from ...program.field import PLACES, ScalarField
from ...program.scalar import Matrix, Value, Vector
from .. import fields
from ..couplings import hand_force, hand_inertia, hand_on, others
from ..handing_on import accumulate, accumulate_force
from ..joints import LinkJoint
from ..joints.inertia import shift_inertia
from ..spatial import SIX, add, cross, is_zero, transpose
from ..stores import CONSTANTS, ME, OWN, PIVOT, TAU, UP
from ..structure.elimination_order import CARRIER
from ..structure.kinds import LinkKind, RegionKind


class ZeroPivotError(ValueError):
    """Nothing outboard of a joint can have inertia about it."""

    def __init__(self, kind: LinkKind | RegionKind):
        super().__init__("nothing outboard of the joint has inertia about it")
        self.kind = kind


SMALL = 2e-15
"""A pivot below this fraction of the articulated inertia: nothing outboard has inertia about the joint."""


def pivot(x: Scope, kind: LinkKind | RegionKind, D: Value) -> Value:
    """The inertia along a freedom or a source, by which is divided.

    Raises
    ------
    ZeroPivotError
        It is zero in every state.
    """
    if not is_zero(D):
        return D
    if not x.structural:
        raise ZeroPivotError(kind)
    return ANY  # the children's patterns are not known yet


def to_blocks(I: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Angular, coupling and linear blocks of a 6x6 matrix."""
    J = [[I[i][j] for j in range(3)] for i in range(3)]
    H = [[I[i][j] for j in range(3, 6)] for i in range(3)]
    M = [[I[i][j] for j in range(3, 6)] for i in range(3, 6)]
    return J, H, M


def constants_of_inertia() -> list[tuple[int, int, ScalarField, int]]:
    """Where the constants of a rigid body stand in its 6x6 inertia: row, column, field, sign (Eq. 23 about the joint)."""
    J, h = dict(zip(PLACES, fields.inertia.scalars(), strict=True)), fields.first_moment.scalars()
    places = [(i, j, J[i, j], 1) for i in range(3) for j in range(i, 3)]
    places += [(3 + i, 3 + i, fields.mass, 1) for i in range(3)]
    for i, j, k, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
        places += [(i, 3 + j, h[k], sign), (j, 3 + i, h[k], -sign)]
    return places


def articulated_parts(x: Scope) -> tuple[Matrix, Matrix, Matrix, Vector, Vector]:
    """Inertia and force that a link's children have handed on."""
    J, M, H = (x.load(ME, f) for f in (fields.articulated.J, fields.articulated.M, fields.articulated.H))
    force = x.load(ME, fields.articulated_force)
    return J, H, M, force[:3], force[3:]


def articulated_inertia(x: Scope) -> Matrix:
    """The body's inertia plus what its children handed on. Eq. 44."""
    I: Matrix = [[0] * 6 for _ in range(6)]
    J, H, M, _, _ = articulated_parts(x)
    for i in range(3):
        for j in range(i, 3):
            I[i][j], I[3 + i][3 + j] = J[i][j], M[i][j]
        for j in range(3):
            I[i][3 + j] = H[i][j]
    for i, j, field, sign in constants_of_inertia():
        I[i][j] = I[i][j] + sign * x.load(CONSTANTS, field)
    for i in range(6):
        for j in range(i, 6):
            I[i][j] = I[j][i] = x.let(f"I{i}{j}", I[i][j], "Eq. 44")
    return I


def is_first(x: Scope, kind: LinkKind) -> bool:
    """Whether a link is the first, on the way inward, to hand something to its parent."""
    return bool(kind.first_unit if x.units else kind.first)


def force_to_parent(x: Scope, joint: LinkJoint, r: Vector, n: Vector, f: Vector, tag: str) -> tuple[Vector, Vector]:
    """A moment and force about the link's origin, in the parent's axes about its origin: ``S F``."""
    n = joint.to_parent(n, "pn", tag)
    f = joint.to_parent(f, "pf", tag)
    n = add(n, cross(r, f))
    return x.let_vector("up_n", n, tag, lanes=joint.lanes), f


def triangularize(x: Scope, kind: LinkKind) -> None:
    """Inward block of the forward dynamics."""
    let = x.let
    I = articulated_inertia(x)
    needed, handed = fields.needed, fields.articulated_force
    p = add(x.load(ME, needed.angular), x.load(ME, handed.angular)) + add(
        x.load(ME, needed.linear), x.load(ME, handed.linear)
    )
    partners = range(len(kind.partners.links))
    C = {m: x.load(OWN[m], fields.coupling) for m in partners}
    between: dict[tuple[int, int], Matrix] = {(m, n): [[0] * 6 for _ in SIX] for m in partners for n in partners}
    force: dict[int, Vector] = {m: [0] * 6 for m in partners}
    joint = kind.joint(x, kind)
    columns = joint.columns
    scales = [let("scale", I[n][n] + I[n + 1][n + 1] + I[n + 2][n + 2], "zero pivot") for n in (0, 3)]
    for j in reversed(range(len(columns))):
        s = columns[j]
        a = s.lead
        U = [let("U", s.along(row), "Eq. 46") for row in I]
        tau = x.entry(TAU, j) if kind.forced[j] else 0
        D = pivot(x, kind, let("D", s.along(U), "Eq. 46"))
        inverse = let("Dinv", 1 / D, "Eq. 47")
        r = let("r", tau - s.along(p), "Eq. 53")
        x.set_entry(PIVOT, j, let("margin", D - x.number(SMALL) * s.squares_along(scales), "zero pivot"))
        x.store(ME, fields.inverse_pivot(j), inverse)
        x.store(ME, fields.right_side(j), let("rD", r * inverse, "Eq. 53"))
        G = [0 if i == a else let(f"G{i}", U[i] * inverse, "Eq. 46") for i in range(6)]
        for i in range(6):
            x.store(ME, fields.gain(j, i), G[i])
        h = {m: [s.along(list(column)) for column in zip(*C[m], strict=True)] for m in partners}
        G_of = {m: [let("Gp", e * inverse, "Eq. 46") for e in h[m]] for m in partners}
        for m in partners:
            for k in SIX:
                x.store(ME, fields.gain(j, 6 + 6 * m + k), G_of[m][k])
                force[m][k] = let("gp", force[m][k] + G_of[m][k] * r, "Eq. 45")
            for n in partners:
                between[m, n] = [
                    [let("Qp", between[m, n][i][k] - G_of[m][i] * h[n][k], "Eq. 44") for k in SIX] for i in SIX
                ]
        last = j == 0 and not kind.carried_on
        if last:
            break
        # what is left gives no force along s: the leading row follows from the others, and is zero if s has no others
        for i in range(6):
            for k in range(i, 6):
                if a not in (i, k):
                    I[i][k] = I[k][i] = let(f"A{i}{k}", I[i][k] - G[i] * U[k], "Eq. 44")
        for k in (*(k for k in SIX if k != a), a):
            I[a][k] = I[k][a] = s.completed(I[k])
        p = [tau if i == a else let(f"p{i}", p[i] + G[i] * r, "Eq. 45") for i in range(6)]
        p[a] = s.completed(p, tau)
        for m in partners:
            C[m] = [[let("C", C[m][i][k] - G[i] * h[m][k], "Eq. 44") for k in SIX] for i in SIX]
            C[m][a] = [s.completed(list(column)) for column in zip(*C[m], strict=True)]
    for m in others(kind):
        hand_inertia(x, kind, m, between[m, m])
        hand_force(x, kind, m, force[m])
    if not kind.carried_on:
        hand_on(x, kind, lambda m, n: between[m, n])
        return
    r_offset = joint.offset()
    for m in partners:
        # columns are forces on the link that an acceleration of the partner asks for
        turned: Matrix = []
        for k in SIX:
            column = [row[k] for row in C[m]]
            moment, push = force_to_parent(x, joint, r_offset, column[:3], column[3:], "Eq. 44")
            turned.append([*moment, *push])
        C[m] = transpose(turned)
    moment, push = force_to_parent(x, joint, r_offset, p[:3], p[3:], "Eq. 45")
    J, H, M = joint.inertia_to_parent(*to_blocks(I), "Eq. 44")
    J, H, M = shift_inertia(x, r_offset, J, H, M, "Eq. 44")
    parent = kind.partners.base
    if parent >= 0:
        # the parent is a partner itself: what the coupling was is inertia now
        more = to_blocks(_symmetrized(x, C[parent], between[parent, parent]))
        J, H, M = (_sum(x, block, by) for block, by in zip((J, H, M), more, strict=True))
        moment, push = _sum(x, [moment, push], [force[parent][:3], force[parent][3:]])

    def remaining(m: int, n: int) -> Matrix:
        if n == CARRIER:
            return transpose(remaining(CARRIER, m))
        if m != CARRIER:
            return between[m, n]
        if parent < 0:
            return C[n]
        return _sum(x, C[n], between[parent, n])

    first = is_first(x, kind)
    accumulate_force(x, UP, fields.articulated_force, [*moment, *push], first, "Eq. 44")
    for field, block in ((fields.articulated.J, J), (fields.articulated.M, M), (fields.articulated.H, H)):
        accumulate(x, UP, field, block, first, "Eq. 44")
    hand_on(x, kind, remaining)


def _sum(x: Scope, a: Matrix, b: Matrix) -> Matrix:
    return [[x.let("Ip", p + q, "Eq. 44") for p, q in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def _symmetrized(x: Scope, C: Matrix, Q: Matrix) -> Matrix:
    """``Q + C + C^T``."""
    found: Matrix = [[0] * 6 for _ in SIX]
    for i in SIX:
        for k in range(i, 6):
            found[i][k] = found[k][i] = x.let("Ip", Q[i][k] + C[i][k] + C[k][i], "Eq. 44")
    return found
