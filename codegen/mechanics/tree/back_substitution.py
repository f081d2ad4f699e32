"""Back substitution, outward: generalised accelerations. Eqs. 53-56.

Only the part of the accelerations that is explicit in udot is carried (the bar of Eq. 19).
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.scalar import Vector
from ...program.store import Store
from .. import fields
from ..couplings import partner_acceleration
from ..joints import LinkJoint
from ..spatial import SIX, add, cross
from ..stores import ME, UDOT, UP
from ..structure.kinds import LinkKind


def carry(joint: LinkJoint, A: Vector, tag: str) -> Vector:
    """``S^T A`` of the parent, in the link's frame: six components."""
    al, a = A[:3], A[3:]
    r = joint.offset()
    moved = add(a, cross(al, r))
    return joint.to_child(al, "bal", tag) + joint.to_child(moved, "ba", tag)


def back_substitute(x: Scope, kind: LinkKind) -> None:
    """Outward block of the forward dynamics."""
    joint = kind.joint(x, kind)
    A = carry(joint, x.load(UP, fields.explicit_acceleration), "Eq. 54")
    substitute(x, kind, A, ME, UDOT, lanes=False)
    x.store(ME, fields.explicit_acceleration, A)


def substitute(x: Scope, kind: LinkKind, A: Vector, store: Store, result: Store, lanes: bool) -> None:
    """Solve for the joint's own freedoms, the one eliminated last first. Eq. 53. Changes A."""
    partners = range(len(kind.partners.links)) if x.units else range(0)
    of_partners = [partner_acceleration(x, kind, m, lanes) for m in partners]
    for j, s in enumerate(kind.joint(x, kind).columns):
        # s . G = 1, so A along s counts once, and the other components what is left of them
        G = [1 if i == s.lead else x.load(ME, fields.gain(j, i)) for i in range(6)]
        value = x.load(store, fields.right_side(j))
        for i in range(6):
            value = value - G[i] * s.remaining(x, i, A, lanes)
        for m in partners:
            for k in SIX:
                value = value - x.load(ME, fields.gain(j, 6 + 6 * m + k)) * of_partners[m][k]
        udot = x.let("udot", value, "Eq. 53", lanes=lanes)
        x.set_entry(result, j, udot)
        for i, moved in s.added(A, udot).items():
            A[i] = x.let("A", moved, "Eq. 54", lanes=lanes)
