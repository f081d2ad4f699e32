"""Outputs of kinetic and potential energy."""

from __future__ import annotations

from ...program.block import Scope
from .. import fields
from ..propagation import accumulate
from ..rotors import rotor
from ..spatial import add, cross, dot, matvec, scale
from ..stores import CONSTANTS, DKINETIC, KINETIC, LME, LUP, ME, MY_LANE, UP
from ..structure.kinds import LinkKind
from ..tree.kinematics import angular_velocity, origin_velocity
from ..tree.tangents import differentiate, store_tangents, tangent
from ..tree.triangularization import is_first

OUTBOARD = frozenset((*fields.outboard_mass.components, *fields.outboard_moment.components))
"""Contribution of the children to the potential energy; its tangents are stored in slots."""


def kinetic(x: Scope, kind: LinkKind) -> None:
    """Velocity of the link's origin, and kinetic energy: half of velocity times momentum."""
    joint = kind.joint(x, kind)
    _, w = angular_velocity(x, joint)
    v = origin_velocity(x, joint)
    m = x.load(CONSTANTS, fields.mass)
    h = x.load(CONSTANTS, fields.first_moment)
    J = x.load(CONSTANTS, fields.inertia)
    angular = [x.let("L", e, "Eq. 23") for e in add(matvec(J, w), cross(h, v))]
    linear = [x.let("P", e, "Eq. 23") for e in add(scale(m, v), cross(w, h))]
    doubled = dot(w, angular) + dot(v, linear)
    for j, geared in enumerate(kind.geared):
        if geared:
            doubled = doubled + rotor(x, kind, j) * joint.speed(j) * joint.speed(j)
    twice = x.let("T2", doubled, "kinetic energy")
    T = x.let("T", x.half * twice, "kinetic energy")
    x.store(ME, fields.angular_velocity, w)
    x.store(ME, fields.velocity, v)
    x.set_entry(KINETIC.sum, 0, T)
    if x.tangents:
        d = differentiate(x, kind, joint)
        store_tangents(x, d, (LME, MY_LANE), ((fields.angular_velocity, w), (fields.velocity, v)))
        x.set_entry(DKINETIC.sum, 0, tangent(d, T))


def moments(x: Scope, kind: LinkKind) -> None:
    """Mass and first moment of the link and everything outboard, about the parent's origin."""
    joint = kind.joint(x, kind)
    m = x.let("m", x.load(CONSTANTS, fields.mass) + x.load(ME, fields.outboard_mass), "potential energy")
    h = add(x.load(CONSTANTS, fields.first_moment), x.load(ME, fields.outboard_moment))
    h = joint.to_parent(h, "h", "potential energy")
    h = [x.let("h", e, "potential energy") for e in add(h, scale(m, joint.offset()))]
    d = differentiate(x, kind, joint, also={ME: LME}) if x.tangents else None
    first = is_first(x, kind)
    accumulate(x, UP, fields.outboard_mass, m, first, "potential energy")
    accumulate(x, UP, fields.outboard_moment, h, first, "potential energy")
    if x.tangents:
        accumulate(x, LUP, fields.outboard_mass, tangent(d, m), first, "potential energy", lanes=True)
        for field, e in zip(fields.outboard_moment.scalars(), h, strict=True):
            accumulate(x, LUP, field, tangent(d, e), first, "potential energy", lanes=True)
