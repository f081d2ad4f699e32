"""Back substitution, outward: generalised accelerations. Eqs. 53-56.

Only the part of the accelerations that is explicit in udot is carried (the bar of Eq. 19).
"""

from __future__ import annotations

from typing import Any

from .couplings import SIX, partner_acceleration
from .joints import JointTransform, freedom_axes
from .kinematics import load_vector, store_vector
from .spatial import Vec, add, cross


def carry(joint: JointTransform, al: Vec, a: Vec, tag: str) -> Vec:
    """``S^T A`` of the parent, in the link's frame: six components."""
    r = joint.offset()
    moved = add(a, cross(al, r))
    return joint.to_child(al, "bal", tag) + joint.to_child(moved, "ba", tag)


def back_substitute(x: Any, kind: Any) -> None:
    """Outward block of the forward dynamics."""
    joint = JointTransform(x, kind)
    A = carry(joint, load_vector(x, "up", "bal"), load_vector(x, "up", "ba"), "Eq. 54")
    substitute(x, kind, A, "me", "udot", lanes=False)
    store_vector(x, "me", "bal", A[:3])
    store_vector(x, "me", "ba", A[3:])


def substitute(x: Any, kind: Any, A: Vec, array: str, result: str, lanes: bool) -> None:
    """Solve for the joint's own freedoms, the one eliminated last first. Eq. 53. Changes A."""
    partners = range(len(kind.partners.links)) if x.units else range(0)
    of_partners = [partner_acceleration(x, kind, m, lanes) for m in partners]
    for j, a in enumerate(freedom_axes(kind.joint, kind.axis)):
        G = [x.load("me", f"G{j}.{i}") for i in range(6)]
        G[a] = 1
        value = x.load(array, f"rD.{j}")
        for i in range(6):
            value = value - G[i] * A[i]
        for m in partners:
            for k in SIX:
                value = value - x.load("me", f"G{j}.{6 + 6 * m + k}") * of_partners[m][k]
        udot = x.let("udot", value, "Eq. 53", lanes=lanes)
        x.store(result, str(j), udot)
        A[a] = x.let("A", A[a] + udot, "Eq. 54", lanes=lanes)
