"""Inverse dynamics of the tree of a model with loops: the loops are cut, and their wrenches act on both faces.

Second derivatives differentiate these blocks (`mechanics.second_order`). They run over all links, in ears or not, along the
links' own axes.
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.scalar import Value, Vector
from .. import fields, propagation
from ..propagation import accumulate_force
from ..rotors import rotor
from ..spatial import SIX, is_zero
from ..stores import COORDINATE_FORCE, FORCE, GQ, ME, TAU, UDOT, UP
from ..structure.kinds import LinkKind
from .inverse_dynamics import joint_acceleration
from .kinematics import accelerate, acceleration_matrix, angular_velocity, body_force, less_external, own_inertia
from .triangularization import force_to_parent, is_first


def tree_motion(x: Scope, kind: LinkKind) -> None:
    """Outward block: total acceleration of a link at the udot of its joint, and the force that it requires. Eqs. 19, 24."""
    joint = kind.joint(x, kind)
    carried, w = angular_velocity(x, joint)
    al, a = joint_acceleration(x, joint, *accelerate(x, joint, carried, fields.total))
    B = acceleration_matrix(x, w, al)
    needed = body_force(x, w, al, a, B, own_inertia(x))
    x.store(ME, fields.angular_velocity, w)
    x.store(ME, fields.total.al, al)
    x.store(ME, fields.total.a, a)
    x.store(ME, fields.total.B, B)
    x.store(ME, fields.total_needed, less_external(x, kind, needed))


def clear_wrenches(x: Scope, kind: LinkKind) -> None:
    """Set the forces of loops and couplings on a link to zero."""
    propagation.clear(x, ME, fields.closing_force)
    for j in range(len(kind.joint(x, kind).all_columns)):
        propagation.clear(x, ME, fields.coupling_force(j))


def tree_forces(x: Scope, kind: LinkKind) -> None:
    """Inward block: joint forces that udot and the loops' wrenches require in addition to those of the model. Eqs. 9, 45."""
    joint = kind.joint(x, kind)
    phi: Vector = []
    for i in SIX:
        parts = (fields.total_needed, fields.closing_force, fields.tree_transmitted)
        total: Value = sum(x.load(ME, field.scalars()[i]) for field in parts)
        phi.append(x.let(f"phi_{'nf'[i // 3]}", total, "Eq. 45"))
    for j, s in enumerate(joint.columns):
        force, own = s.along(phi) + x.load(ME, fields.coupling_force(j)), rotor(x, kind, j)
        if not is_zero(own):
            force = force + own * x.entry(UDOT, j)
        x.set_entry(FORCE, j, force - x.entry(TAU, j) if kind.forced[j] else force)
    if kind.has_parent:
        force_here = force_to_parent(x, joint, phi, "Eq. 45")
        accumulate_force(x, UP, fields.tree_transmitted, force_here, is_first(x, kind), "Eq. 45")


def coordinate_forces(x: Scope, kind: LinkKind) -> None:
    """The gradient with respect to a link's coordinates, converted to its degrees of freedom."""
    joint = kind.joint(x, kind)
    for j in range(joint.freedoms):
        changes = joint.coordinate_changes({j: 1}, False)
        total: Value = sum(value * x.entry(GQ, i) for i, value in sorted(changes.items()))
        x.set_entry(COORDINATE_FORCE, j, x.let("along", total, "Eq. 30"))
