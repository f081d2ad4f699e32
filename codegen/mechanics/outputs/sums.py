"""Sums over all links, in the ground frame: mass and first moment, linear and angular momentum."""

from __future__ import annotations

from ...program.block import Scope
from ...program.scalar import Vector
from ...program.store import Store
from .. import fields
from ..spatial import add, cross, is_zero, matvec, scale
from ..stores import DMASSES, DMOMENTA, MASSES, ME, MOMENTA, MY_LANE
from ..structure.kinds import LinkKind
from ..tree.kinematics import own_inertia
from ..tree.tangents import differentiate, tangent


def masses(x: Scope, kind: LinkKind) -> None:
    """Mass and first moment of a link about the ground's origin: ``m``, ``m pos + W h``."""
    m, h, _ = own_inertia(x)
    turned = [x.let("h", e, "first moment") for e in matvec(x.load(ME, fields.attitude), h)]
    moment = add(scale(m, x.load(ME, fields.position)), turned)
    _add(x, kind, MASSES, DMASSES, [m, *moment], "first moment")


def momenta(x: Scope, kind: LinkKind) -> None:
    """Linear momentum of a link, and angular momentum about the ground's origin. Eq. 23, shifted from the link's origin."""
    m, h, J = own_inertia(x)
    w, v = x.load(ME, fields.angular_velocity), x.load(ME, fields.velocity)
    linear = [x.let("P", e, "Eq. 23") for e in add(scale(m, v), cross(w, h))]
    angular = [x.let("L", e, "Eq. 23") for e in add(matvec(J, w), cross(h, v))]
    W = x.load(ME, fields.attitude)
    linear, angular = ([x.let("turned", e, "momentum") for e in matvec(W, part)] for part in (linear, angular))
    angular = add(angular, cross(x.load(ME, fields.position), linear))
    _add(x, kind, MOMENTA, DMOMENTA, [*linear, *angular], "momentum")


def _add(x: Scope, kind: LinkKind, into: Store, tangents: Store, values: Vector, tag: str) -> None:
    """Add the contribution of a link to the sums, and the tangent of the contribution to the tangents of the sums."""
    named = [x.let("part", e, tag) for e in values]
    for j, e in enumerate(named):
        if not is_zero(e):
            x.set_entry(into.sum, j, e)
    if x.tangents:
        d = differentiate(x, kind, None, also={ME: MY_LANE})  # records from earlier sweeps have tangents in lanes
        for j, e in enumerate(named):
            moved = tangent(d, e)
            if not is_zero(moved):
                x.set_entry(tangents.sum, j, moved)
