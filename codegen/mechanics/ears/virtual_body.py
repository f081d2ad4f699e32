"""The inertia and force of an ear's links along the sources of their region: the virtual body of Eqs. 39-41.

With ``A_k = Z_k w + A_t,k`` for all links of a region, its equations of motion are ``Q w = -g``. Here ``Q = sum Z_k^T
I_k Z_k`` and ``g = sum Z_k^T (I_k A_t,k + bias) - joint forces``. A base that is a link carries the region as if by a
joint, with one degree of freedom for each source.
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.scalar import Matrix, Value, Vector
from .. import fields
from ..couplings import to_base
from ..joints.inertia import shift_inertia
from ..propagation import add_to_sum
from ..rotors import driven_rotor, rotor
from ..spatial import SIX, about, add, dot, inner, is_zero, matmul, matvec, six, skew, symmetric, transpose, turned
from ..stores import CONSTANTS, EAR, HELD, ME, OWN, REGION, TAU
from ..structure.kinds import EarKind
from ..tree.triangularization import articulated_parts
from .closures import own_sources
from .geometry import EarGeometry
from .kinematics import rotated_inertia


def ear_triangularize(x: Scope, kind: EarKind) -> None:
    """Inward block: contributions of the ear's links to the inertia and force of their region. Eqs. 39-41."""
    ear = EarGeometry(x, kind)
    tag = "Eq. 40"
    own = own_sources(kind)
    Q: dict[tuple[int, int], Value] = {}
    g: dict[int, Value] = {}
    K: dict[int, Vector] = {}
    for k in range(len(ear.members)):
        J, H, M, force = member_inertia(x, ear, k)
        Z = motions_with_sources(x, kind, k)
        for c, z in Z.items():
            N = apply_inertia(x, J, H, M, z, "N", tag)
            for d, y in Z.items():
                if d <= c:
                    Q[d, c] = x.let("Q", Q.get((d, c), 0) + inner(y, N), tag)
            g[c] = g.get(c, 0) + inner(z, force)
            if kind.carried and kind.rigid:
                K[c] = add(K.get(c, [0] * 6), about(ear.position(k), N))
        if kind.carried and kind.rigid:
            _to_base(x, ear.position(k), J, H, M, force)
    couplings_of_ear(x, ear, Q, K)
    for d, (k, freedom) in enumerate(ear.dependents()):
        a = rotor(ear.members[k].view, kind.links[k], freedom.index)
        if not is_zero(a):
            rates = {c: x.load(EAR, fields.dependent_rate(d, c)) for c in range(kind.total)}
            taken = {c: x.let("aY", a * y, tag) for c, y in rates.items()}
            for c in rates:
                for b in range(c + 1):
                    Q[b, c] = Q.get((b, c), 0) + rates[b] * taken[c]
                g[c] = g.get(c, 0) + taken[c] * x.load(EAR, fields.dependent_remainder(d))
        if kind.links[k].forced[freedom.index]:
            tau = x.entry(TAU[k], freedom.index)
            for c in range(kind.total):
                g[c] = g.get(c, 0) - x.load(EAR, fields.dependent_rate(d, c)) * tau
    for c, (k, j) in own.items():
        tau = own_force(x, kind, k, j)
        if not is_zero(tau):
            g[c] = g.get(c, 0) - tau
        view, link = ear.members[k].view, kind.links[k]
        if c in kind.locked:
            taken_by_rotor = driven_rotor(view, link)
            if not is_zero(taken_by_rotor):
                g[c] = g.get(c, 0) + taken_by_rotor
        elif not is_zero(a := rotor(view, link, j)):
            Q[c, c] = Q.get((c, c), 0) + a
    for (d, c), value in Q.items():
        x.store(REGION.sum, fields.source_inertia(d, c), x.let("Q", value, tag))
    for c, value in g.items():
        x.store(REGION.sum, fields.source_force(c), x.let("g", value, "Eq. 41"))
    for c, force in K.items():
        add_to_sum(x, REGION, fields.source_to_base(c), force, "K", "Eq. 39")


def own_force(x: Scope, kind: EarKind, k: int, j: int) -> Value:
    """The model's own force along a degree of freedom of a link, or along a prescribed coordinate."""
    link = kind.links[k]
    if link.joint.driven:
        return x.entry(HELD[k], 0) if link.held else 0
    return x.entry(TAU[k], j) if link.forced[j] else 0


def member_inertia(x: Scope, ear: EarGeometry, k: int) -> tuple[Matrix, Matrix, Matrix, Vector]:
    """The inertia of a link with everything that it carries, and the force that its motion requires, along region axes and
    about the link's origin."""
    member = ear.members[k]
    m, J = member.view.load(CONSTANTS, fields.mass), x.load(ME[k], fields.ear_inertia)
    H = skew(x.load(ME[k], fields.ear_first_moment))
    M: Matrix = [[m if i == j else 0 for j in range(3)] for i in range(3)]
    force = x.load(ME[k], fields.ear_needed)
    if ear.kind.links[k].carries:
        J_c, H_c, M_c, carried = articulated_parts(member.view)
        W = member.W
        half = [[x.let("WH", e, "Eq. 44") for e in row] for row in matmul(W, H_c)]
        H = [[x.let("H", H[i][j] + dot(half[i], W[j]), "Eq. 44") for j in range(3)] for i in range(3)]
        J_c, M_c = rotated_inertia(x, W, J_c, "Eq. 44"), rotated_inertia(x, W, M_c, "Eq. 44")
        J = symmetric([x.let("J", a + b, "Eq. 44") for a, b in zip(six(J), six(J_c), strict=True)])
        M = symmetric([x.let("M", a + b, "Eq. 44") for a, b in zip(six(M), six(M_c), strict=True)])
        force = [x.let("nf"[i // 3], e, "Eq. 45") for i, e in enumerate(add(force, turned(W, carried)))]
    return J, H, M, force


def apply_inertia(x: Scope, J: Matrix, H: Matrix, M: Matrix, A: Vector, name: str, tag: str) -> Vector:
    """Moment and force that a generalised inertia requires for an acceleration."""
    n = add(matvec(J, A[:3]), matvec(H, A[3:]))
    f = add(matvec(transpose(H), A[:3]), matvec(M, A[3:]))
    return [x.let(f"{name}n", e, tag) for e in n] + [x.let(f"{name}f", e, tag) for e in f]


def motions_with_sources(x: Scope, kind: EarKind, k: int) -> dict[int, Vector]:
    """Motions of a link of an ear per unit of each source, for the sources that move the link."""
    found = {
        c: x.load(ME[k], fields.per_source(c).angular) + x.load(ME[k], fields.per_source(c).linear)
        for c in range(kind.total)
    }
    return {c: z for c, z in found.items() if any(not is_zero(v) for v in z)}


def couplings_of_ear(x: Scope, ear: EarGeometry, Q: dict[tuple[int, int], Value], K: dict[int, Vector]) -> None:
    """Convert couplings of an ear's links to its region's sources: to inertia (Q, and K with the base) and couplings. Eq. 40."""
    kind, tag = ear.kind, "Eq. 40"
    found: dict[tuple[int, int, int], Value] = {}
    for n, (j, other) in enumerate(kind.partners.between):
        C: Matrix = [[0] * 6 for _ in SIX]
        for k, column in enumerate(zip(*x.load(OWN[n], fields.coupling), strict=True)):
            for i, value in enumerate(turned(ear.members[j].W, list(column))):
                C[i][k] = x.let("C", value, tag)
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
            row[:] = [x.let("C", e, tag) for e in turned(ear.members[other].W, row)]
        Z_other = motions_with_sources(x, kind, other)
        for one, Z_one, Z_two, block in ((j, Z, Z_other, C), (other, Z_other, Z, transpose(C))):
            for c, z in Z_two.items():
                N = [x.let("N", sum(block[i][k] * z[k] for k in SIX), tag) for i in SIX]
                for d, y in Z_one.items():
                    if d <= c:
                        Q[d, c] = Q.get((d, c), 0) + sum(y[i] * N[i] for i in SIX)
                if kind.carried and kind.rigid:
                    K[c] = add(K.get(c, [0] * 6), to_base(x, ear.position(one), N, tag))
        if kind.carried and kind.rigid:
            _coupling_to_base(x, ear.position(j), ear.position(other), C)
    for (m, c, k), value in found.items():
        x.store(REGION.sum, fields.source_to_partner(m, c, k), x.let("P", value, tag))


def _coupling_to_base(x: Scope, o: Vector, o_other: Vector, C: Matrix) -> None:
    """Adds, to the base's inertia, the coupling of two links that belong rigidly to the base."""
    half = transpose([to_base(x, o, list(column), "Eq. 39") for column in zip(*C, strict=True)])
    whole = [to_base(x, o_other, row, "Eq. 39") for row in half]
    carried = fields.region_inertia
    for field, a, b in ((carried.J, 0, 0), (carried.M, 3, 3), (carried.H, 0, 3)):
        both = [[whole[a + i][b + k] + whole[b + k][a + i] for k in range(3)] for i in range(3)]
        add_to_sum(x, REGION, field, both, "I", "Eq. 39")


def _to_base(x: Scope, o: Vector, J: Matrix, H: Matrix, M: Matrix, force: Vector) -> None:
    """Adds a link's inertia and force to those that the base carries, about the base's origin."""
    J, H, M = shift_inertia(x, o, J, H, M, "Eq. 39")
    carried = fields.region_inertia
    for field, block in ((carried.J, J), (carried.M, M), (carried.H, H)):
        add_to_sum(x, REGION, field, block, "I", "Eq. 39")
    add_to_sum(x, REGION, fields.region_force, about(o, force), "p", "Eq. 41")
