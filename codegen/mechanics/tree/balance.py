"""The balance ``M dudot = d(K - M udot)``: inward and outward sweeps over directions.

There are three sweeps per direction (section 3 of the theory page). The first goes outward and computes the tangent of
the inverse dynamics at fixed udot (`inverse_dynamics.newton_euler_outward`). The second goes inward: the six numbers
that it propagates are the tangent of the transmitted force plus the bias force of the solution, by the factors of the
triangularization. The third goes outward again: back substitution.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ...program.block import Scope
from ...program.scalar import Value, Vector
from .. import fields
from ..couplings import add_partner_force, others
from ..elimination import OF_FREEDOMS, eliminate_force
from ..joints import Column, LinkJoint
from ..rotors import driven_rotor_change, rotor, rotor_force_change, transmitted_along
from ..spatial import is_zero
from ..stores import CONSTANTS, DFORCE, DHELD, DTAU, DUDOT, LME, LUP, ME, MY_LANE, RIGHT_SIDE
from ..structure.kinds import LinkKind
from .back_substitution import carry, joint_accelerations
from .inverse_dynamics import propagate_lanes, transfer
from .triangularization import constants_of_inertia, force_to_parent, labels_of, unknowns_left


def eliminate(x: Scope, kind: LinkKind, columns: Sequence[Column], P: Vector, forces: Vector) -> dict[int, Vector]:
    """Update the bias force P in place for the elimination of one joint, and return the contributions to partners
    (`elimination`). Eqs. 45, 53."""
    partners = range(len(kind.partners.links)) if x.units else range(0)
    whole = [*P, *([0] * 6 * len(partners))]
    for j in reversed(range(len(columns))):
        left = unknowns_left(kind, j, len(whole))
        own = rotor(x, kind, j)
        eliminate_force(x, OF_FREEDOMS, MY_LANE, j, columns[j], whole, forces[j], labels_of(kind), left, own)
    P[:] = whole[:6]
    return {m: whole[6 + 6 * m : 12 + 6 * m] for m in partners}


def balance_inward(x: Scope, kind: LinkKind) -> None:
    """Propagate the transmitted force, its tangent and the bias force of the solution to the parent."""
    joint = kind.joint(x, kind)
    columns = joint.columns
    P: Vector = []
    phi: Vector = []
    for i, children in enumerate(x.load(ME, fields.transmitted)):
        own, of_children = fields.needed.scalars()[i], fields.articulated_force.scalars()[i]
        P.append(x.let("P", x.load(MY_LANE, own) + x.load(LME, of_children), "d Eq. 45", lanes=True))
        phi.append(x.load(ME, fields.total_needed.scalars()[i]) + children)
    forces = [
        (x.entry(DTAU, j) if kind.forced[j] else 0) - s.change(x, phi) - rotor_force_change(x, kind, j)
        for j, s in enumerate(columns)
    ]
    if joint.driven:
        s = joint.driven_column
        rest = s.along(P) + s.change(x, phi) + driven_rotor_change(x, kind) - (x.entry(DHELD, 0) if kind.held else 0)
        x.store(MY_LANE, fields.driving_rest, x.let("ddrive", rest, "d Eq. 53", lanes=True))
    of_partners = eliminate(x, kind, columns, P, forces)
    for m in others(kind):
        add_partner_force(x, kind, m, of_partners[m], lanes=True)
        if kind.partners.first[m]:
            add_partner_force(x, kind, m, [0] * 6, fields.transmitted)
    if kind.has_parent:
        # in equilibrium a joint transmits its own force along its degrees of freedom, minus that of its rotor
        for j, s in enumerate(columns):
            phi[s.lead] = s.completed(phi, transmitted_along(x, kind, j))
        transfer(x, kind, joint, phi, P, of_partners.get(kind.partners.base))


def solve_inward(x: Scope, kind: LinkKind) -> None:
    """The recursion of the bias force for given right sides: ``M x = b``, for several b at once."""
    joint = kind.joint(x, kind, lanes=True)
    P = x.load(LME, fields.articulated_force)
    if joint.driven:
        x.store(MY_LANE, fields.driving_rest, x.let("ddrive", joint.driven_column.along(P), "Eq. 53", lanes=True))
    eliminate(x, kind, joint.columns, P, [x.entry(RIGHT_SIDE, j) for j in range(joint.freedoms)])
    if kind.has_parent:
        propagate_lanes(x, kind, force_to_parent(x, joint, P, "Eq. 45"))


def balance_outward(x: Scope, kind: LinkKind) -> None:
    """Back substitution over directions. Eqs. 53-55."""
    joint = kind.joint(x, kind, lanes=True)
    A = carry(joint, x.load(LUP, fields.explicit_acceleration), "d Eq. 54")
    joint_accelerations(x, kind, A, MY_LANE, DUDOT, lanes=True)
    x.store(LME, fields.explicit_acceleration, A)


def mass_outward(x: Scope, kind: LinkKind) -> None:
    """``M x`` over directions, outward: the accelerations of links if udot = x and all speeds are zero, and the forces that
    these accelerations require."""
    joint = kind.joint(x, kind, lanes=True)
    rates = (x.entry(RIGHT_SIDE, j) for j in range(joint.freedoms))
    A = moved_by(x, joint, x.load(LUP, fields.explicit_acceleration), rates, "Eq. 19")
    force: Vector = [0] * 6
    add_inertial_force(x, force, A)
    x.store(MY_LANE, fields.needed, [x.let("f", e, "Eq. 23", lanes=True) for e in force])


def moved_by(x: Scope, joint: LinkJoint, before: Vector, rates: Iterable[Value], tag: str) -> Vector:
    """Acceleration of a link over directions, from its parent's acceleration and the accelerations `rates` of its
    joint; stored for its children. Eq. 19."""
    A = carry(joint, before, tag)
    for s, rate in zip(joint.columns, rates, strict=True):
        for i, value in s.added(A, rate).items():
            A[i] = x.let("A", value, tag, lanes=True)
    x.store(LME, fields.explicit_acceleration, A)
    return A


def add_inertial_force(x: Scope, force: Vector, A: Vector) -> None:
    """Add the force that a link's own inertia requires for the acceleration A. Eq. 23."""
    for i, j, field, sign in constants_of_inertia():
        value = sign * x.load(CONSTANTS, field)
        force[i] = force[i] + value * A[j]
        if i != j:
            force[j] = force[j] + value * A[i]


def mass_inward(x: Scope, kind: LinkKind) -> None:
    """``M x`` over directions, inward: the components of the summed forces along the degrees of freedom."""
    P = [
        x.let("P", x.load(MY_LANE, own) + x.load(LME, children), "Eq. 45", lanes=True)
        for own, children in zip(fields.needed.scalars(), fields.articulated_force.scalars(), strict=True)
    ]
    joint = kind.joint(x, kind, lanes=True)
    for j, s in enumerate(joint.columns):
        own = rotor(x, kind, j)
        x.set_entry(DFORCE, j, s.along(P) if is_zero(own) else s.along(P) + own * x.entry(RIGHT_SIDE, j))
    if kind.has_parent:
        propagate_lanes(x, kind, force_to_parent(x, joint, P, "Eq. 45"))
