"""Back substitution, outward: generalised accelerations. Eqs. 53-56.

Only the explicit part of the accelerations is propagated: the terms in udot (the bar of Eq. 19) and, in long chains,
gravity (`System.fields_of_gravity`).
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.scalar import Vector
from ...program.store import Store
from .. import fields
from ..couplings import partner_acceleration
from ..elimination import OF_FREEDOMS, substitute
from ..joints import LinkJoint
from ..rotors import rotor
from ..spatial import add, cross, is_zero
from ..stores import DDRIVING, DRIVING, ME, UDOT, UP
from ..structure.kinds import LinkKind


def carry(joint: LinkJoint, A: Vector, tag: str, name: str = "b") -> Vector:
    """The acceleration that the link's origin would have if it were fixed to the parent, from the parent's acceleration A
    (angular, then linear): ``S^T A``, six components along the link's axes."""
    al, a = A[:3], A[3:]
    r = joint.offset()
    moved = add(a, cross(al, r))
    return joint.to_child(al, f"{name}al", tag) + joint.to_child(moved, f"{name}a", tag)


def back_substitute(x: Scope, kind: LinkKind) -> None:
    """Outward block of the forward dynamics: accelerations of the joint and of the link."""
    joint = kind.joint(x, kind)
    A = carry(joint, x.load(UP, fields.explicit_acceleration), "Eq. 54")
    joint_accelerations(x, kind, A, ME, UDOT, lanes=False)
    x.store(ME, fields.explicit_acceleration, A)


def joint_accelerations(x: Scope, kind: LinkKind, A: Vector, store: Store, result: Store, lanes: bool) -> None:
    """Accelerations of the joint's degrees of freedom, in reverse order of elimination; adds their contribution to A in
    place. Eq. 53."""
    partners = range(len(kind.partners.links)) if x.units else range(0)
    a = [*A, *(e for m in partners for e in partner_acceleration(x, kind, m, lanes))]
    if kind.joint.driven:
        force = x.load(store, fields.driving_rest)
        for i, e in enumerate(a):
            force = force + x.load(ME, fields.driving_gain(i)) * e
        x.set_entry(DDRIVING if lanes else DRIVING, 0, x.let("driving", force, "Eq. 53", lanes=lanes))
    for j, s in enumerate(kind.joint(x, kind).columns):
        geared = not is_zero(rotor(x, kind, j))
        x.set_entry(result, j, substitute(x, OF_FREEDOMS, store, j, s, a, "udot", lanes, geared))
    A[:] = a[:6]
