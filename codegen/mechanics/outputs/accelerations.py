"""Accelerations of links once all of udot is known, against the ground and without gravity; through loops as over a tree."""

from __future__ import annotations

from ...program.algebra import Expr, Symbol
from ...program.block import Expansion, Scope
from .. import fields
from ..stores import DUDOT, LME, ME, MY_LANE, UDOT
from ..structure.kinds import LinkKind
from ..tree.inverse_dynamics import joint_acceleration
from ..tree.kinematics import accelerate, acceleration_matrix, angular_velocity
from ..tree.tangents import differentiate, store_tangent, tangent


def accelerations(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link: how it accelerates, as `inverse_dynamics` has it, but that the ground is at rest. Eqs. 18-21."""
    joint = kind.joint(x, kind)
    motion = fields.moving
    carried, w = angular_velocity(x, joint)
    al, a = joint_acceleration(x, joint, *accelerate(x, joint, carried, motion))
    B = acceleration_matrix(x, w, al)
    vectors = ((motion.w, w), (motion.al, al), (motion.a, a))
    for field, v in vectors:
        x.store(ME, field, v)
    x.store(ME, motion.B, B)
    if x.tangents:
        d = differentiate(x, kind, joint, _of_udot(x))
        for store in (LME, MY_LANE):
            for field, v in vectors:
                store_tangent(x, d, (store,), field, v)
            x.store(store, motion.B, [[tangent(d, e) for e in row] for row in B])


def _of_udot(x: Scope) -> dict[Symbol, Expr]:
    """Tangents of udot, which is no longer held."""
    if not isinstance(x, Expansion):
        return {}
    loads = list(x.block.loads.items())
    return {symbol: x.component(DUDOT, name) for symbol, (store, name) in loads if store is UDOT}
