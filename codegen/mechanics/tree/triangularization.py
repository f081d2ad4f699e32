"""Triangularization, inward: articulated inertias and forces. Eqs. 42-47.

The joint's own row and column of the propagated inertia are structural zeros, and the joint's entry of the force is the
joint force itself (T_k annihilates P_k exactly). Neither is ever computed. The rotor of a joint changes the inertia and
the force, see `elimination`. A joint with several degrees of freedom is eliminated one unit column after the other: the
LDL^T factorisation of its M_k.
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.field import PLACES, ScalarField
from ...program.scalar import Matrix, Value, Vector
from .. import fields
from ..couplings import add_couplings, add_partner_force, add_partner_inertia, others
from ..elimination import OF_FREEDOMS, SymmetricSystem
from ..joints import Column, LinkJoint
from ..joints.inertia import shift_inertia
from ..propagation import accumulate, accumulate_force
from ..rotors import driven_rotor, rotor
from ..spatial import SIX, add, cross, dot, is_zero, transpose
from ..stores import CONSTANTS, HELD, ME, OWN, TAU, UP
from ..structure.elimination_order import CARRIER
from ..structure.kinds import LinkKind


def to_blocks(I: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Angular, coupling and linear blocks of a 6x6 matrix."""
    J = [[I[i][j] for j in range(3)] for i in range(3)]
    H = [[I[i][j] for j in range(3, 6)] for i in range(3)]
    M = [[I[i][j] for j in range(3, 6)] for i in range(3, 6)]
    return J, H, M


def constants_of_inertia() -> list[tuple[int, int, ScalarField, int]]:
    """Where a rigid body's constants are in its 6x6 inertia: row, column, field and sign (Eq. 23 about the joint)."""
    J, h = dict(zip(PLACES, fields.inertia.scalars(), strict=True)), fields.first_moment.scalars()
    places = [(i, j, J[i, j], 1) for i in range(3) for j in range(i, 3)]
    places += [(3 + i, 3 + i, fields.mass, 1) for i in range(3)]
    for i, j, k, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
        places += [(i, 3 + j, h[k], sign), (j, 3 + i, h[k], -sign)]
    return places


def articulated_parts(x: Scope) -> tuple[Matrix, Matrix, Matrix, Vector]:
    """Sum of the inertia and force that a link's children have propagated."""
    J, M, H = (x.load(ME, f) for f in (fields.articulated.J, fields.articulated.M, fields.articulated.H))
    return J, H, M, x.load(ME, fields.articulated_force)


def articulated_inertia(x: Scope) -> Matrix:
    """The body's inertia plus the contributions of its children. Eq. 44."""
    I: Matrix = [[0] * 6 for _ in range(6)]
    J, H, M, _ = articulated_parts(x)
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
    """Whether a link is the first, on the way inward, to contribute to its parent."""
    return bool(kind.first_unit if x.units else kind.first)


def force_to_parent(x: Scope, joint: LinkJoint, force: Vector, tag: str, r: Vector | None = None) -> Vector:
    """A moment and force about the parent's origin, along the parent's axes: ``S F``.

    `r` is the vector from the parent's origin to the link's, if known.
    """
    r = joint.offset() if r is None else r
    n = joint.to_parent(force[:3], "pn", tag)
    f = joint.to_parent(force[3:], "pf", tag)
    return x.let_vector("up_n", add(n, cross(r, f)), tag, lanes=joint.lanes) + f


def link_system(x: Scope, kind: LinkKind) -> SymmetricSystem:
    """Inertia and force over the link's six components and six of each partner."""
    needed, children = fields.needed, fields.articulated_force
    I = articulated_inertia(x)
    p = add(x.load(ME, needed.angular), x.load(ME, children.angular)) + add(
        x.load(ME, needed.linear), x.load(ME, children.linear)
    )
    partners = range(len(kind.partners.links))
    couplings = [x.load(OWN[m], fields.coupling) for m in partners]
    Q = [[*row, *(e for C in couplings for e in C[i])] for i, row in enumerate(I)]
    Q += [[*column, *([0] * 6 * len(partners))] for C in couplings for column in zip(*C, strict=True)]
    return SymmetricSystem(x, kind, Q, [*p, *([0] * 6 * len(partners))], OF_FREEDOMS, labels_of(kind))


def labels_of(kind: LinkKind) -> list[str]:
    """Labels of the unknowns of a link: numbers for its own components, letters for components of partners."""
    return [*map(str, SIX), *("p" for _ in kind.partners.links for _ in SIX)]


def unknowns_left(kind: LinkKind, j: int, count: int) -> range:
    """Unknowns needed after elimination of degree of freedom j. After the last one, a link on the ground needs no
    unknown of its own."""
    return range(0 if j > 0 or kind.has_parent else 6, count)


def inertia_scales(x: Scope, kind: LinkKind, I: Matrix, pivot: int) -> Vector:
    """Angular and linear sizes with which pivots are compared: traces of the articulated inertia (`zero pivot`).

    If no other statement needs an entry of a trace, the body's own inertia and the children's sizes replace this entry. The
    entry `pivot` is left out of the trace, since it is the pivot that is compared; -1 leaves out none.
    """
    turning, mass = (_total([I[i][i] for i in range(n, n + 3) if i != pivot]) for n in (0, 3))
    tag = "zero pivot"
    if not kind.of_links:
        return [x.let("scale", turning, tag), x.let("scale", mass, tag)]
    J = x.load(CONSTANTS, fields.inertia)
    children = _total([J[i][i] for i in range(3) if i != pivot]) + x.load(ME, fields.moment_scale)
    light = x.load(CONSTANTS, fields.mass) + x.load(ME, fields.mass_scale)
    return [x.either("scale", turning, children, tag), x.either("scale", mass, light, tag)]


def _total(entries: Vector) -> Value:
    return sum(entries[1:], entries[0])


def _pivot_entry(x: Scope, kind: LinkKind, joint: LinkJoint) -> int:
    """The entry of the articulated inertia that is a joint's only pivot; -1 if there is no such entry."""
    alone = joint.freedoms == 1 and not joint.columns[0].others and is_zero(rotor(x, kind, 0))
    return joint.columns[0].lead if alone else -1


def triangularize(x: Scope, kind: LinkKind) -> None:
    """Inward block of the forward dynamics: eliminates the joint of a link."""
    joint = kind.joint(x, kind)
    system = link_system(x, kind)
    I, p = system.Q, system.p
    scales = inertia_scales(x, kind, I, _pivot_entry(x, kind, joint))
    for j in reversed(range(joint.freedoms)):
        s = joint.columns[j]
        tau = x.entry(TAU, j) if kind.forced[j] else 0
        left = unknowns_left(kind, j, len(p))
        system.eliminate(j, s, tau, s.squares_along(scales), left, rotor(x, kind, j))
    if joint.driven:
        keep_driving(x, kind, joint.driven_column, I, p)
    places = [6 + 6 * m for m in range(len(kind.partners.links))]
    for m in others(kind):
        add_partner_inertia(x, kind, m, system.block(places[m], places[m]))
        add_partner_force(x, kind, m, p[places[m] : places[m] + 6])
    if not kind.has_parent:
        add_couplings(x, kind, lambda m, n: system.block(places[m], places[n]))
        return
    r = joint.offset()
    couplings = [coupling_to_parent(x, joint, r, system.block(0, place)) for place in places]
    force = force_to_parent(x, joint, p[:6], "Eq. 45", r)
    J, H, M = joint.inertia_to_parent(*to_blocks(I), "Eq. 44")
    J, H, M = shift_inertia(x, r, J, H, M, "Eq. 44")
    parent = kind.partners.base
    if parent >= 0:
        # the parent is a partner itself: the coupling becomes part of its inertia
        at = places[parent]
        more = to_blocks(_symmetrized(x, couplings[parent], system.block(at, at)))
        J, H, M = (_sum(x, block, by) for block, by in zip((J, H, M), more, strict=True))
        (force,) = _sum(x, [force], [p[at : at + 6]])

    def remaining(m: int, n: int) -> Matrix:
        if n == CARRIER:
            return transpose(remaining(CARRIER, m))
        if m != CARRIER:
            return system.block(places[m], places[n])
        if parent < 0:
            return couplings[n]
        return _sum(x, couplings[n], system.block(places[parent], places[n]))

    first = is_first(x, kind)
    accumulate_force(x, UP, fields.articulated_force, force, first, "Eq. 44")
    for field, block in ((fields.articulated.J, J), (fields.articulated.M, M), (fields.articulated.H, H)):
        accumulate(x, UP, field, block, first, "Eq. 44")
    turning, mass = scales
    accumulate(x, UP, fields.moment_scale, turning + dot(r, r) * mass, first, "zero pivot")
    accumulate(x, UP, fields.mass_scale, mass, first, "zero pivot")
    add_couplings(x, kind, remaining)


def keep_driving(x: Scope, kind: LinkKind, s: Column, I: Matrix, p: Vector) -> None:
    """Store the terms of the force along a prescribed coordinate: ``s . (I^ A + p^) - tau``, where A are the explicit
    accelerations.

    The rotor's force is known, since no degree of freedom accelerates the rotor.
    """
    for i, row in enumerate(I):
        x.store(ME, fields.driving_gain(i), x.let("dG", s.along(row), "Eq. 53"))
    rest = s.along(p) + driven_rotor(x, kind) - (x.entry(HELD, 0) if kind.held else 0)
    x.store(ME, fields.driving_rest, x.let("drive", rest, "Eq. 53"))


def coupling_to_parent(x: Scope, joint: LinkJoint, r: Vector, C: Matrix) -> Matrix:
    """A coupling whose rows are forces on the link, as forces on its parent."""
    return transpose([force_to_parent(x, joint, column, "Eq. 44", r) for column in transpose(C)])


def _sum(x: Scope, a: Matrix, b: Matrix) -> Matrix:
    return [[x.let("Ip", p + q, "Eq. 44") for p, q in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def _symmetrized(x: Scope, C: Matrix, Q: Matrix) -> Matrix:
    """The inertia Q plus a coupling and its transpose: ``Q + C + C^T``."""
    found: Matrix = [[0] * 6 for _ in SIX]
    for i in SIX:
        for k in range(i, 6):
            found[i][k] = found[k][i] = x.let("Ip", Q[i][k] + C[i][k] + C[k][i], "Eq. 44")
    return found
