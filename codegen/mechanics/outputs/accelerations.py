"""Accelerations of links relative to the ground, without gravity, computed from udot; for trees and for loops."""

from __future__ import annotations

from ...program.block import Scope
from .. import fields
from ..stores import DUDOT, UDOT
from ..structure.kinds import LinkKind
from ..tree.inverse_dynamics import joint_acceleration
from ..tree.kinematics import accelerate, acceleration_matrix, angular_velocity
from ..tree.tangents import store_motion


def accelerations(x: Scope, kind: LinkKind) -> None:
    """Outward block of a link: accelerations as in `inverse_dynamics`, but with the ground at rest. Eqs. 18-21."""
    joint = kind.joint(x, kind)
    motion = fields.moving
    carried, w = angular_velocity(x, joint, motion.w)
    al, a = joint_acceleration(x, joint, *accelerate(x, joint, carried, motion))
    B = acceleration_matrix(x, w, al)
    parts = ((motion.w, w), (motion.al, al), (motion.a, a), (motion.B, B))
    store_motion(x, kind, joint, parts, also={UDOT: DUDOT})  # udot is no longer held constant
