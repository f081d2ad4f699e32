"""Reflected inertia of the rotors that drive joints, which acts along the joint's own speeds only.

Let a rotor spin n times as fast as its joint, and let J be its inertia about its axis. Its kinetic energy is ``a u^2 / 2`` with
``a = n^2 J``. Its gyroscopic effect on the links that carry it is neglected. Except in the elimination of the speed, it acts as a
joint force ``-a udot``: the joint transmits ``tau - a udot`` along itself.
"""

from __future__ import annotations

from ..program.block import Scope
from ..program.scalar import Value
from . import fields
from .spatial import is_zero
from .stores import CONSTANTS, DMOTION, DP, MOTION, TAU, UDOT
from .structure.kinds import LinkKind

ACCELERATION = 2
"""Index of the acceleration in a prescribed motion; see `joints.driven`."""


def rotor(x: Scope, kind: LinkKind, j: int) -> Value:
    """The reflected inertia along a speed of a link's joint, kg m^2 or kg; 0 without a rotor."""
    return x.load(CONSTANTS, fields.armature(j)) if j < len(kind.geared) and kind.geared[j] else 0


def rotor_change(x: Scope, kind: LinkKind, j: int) -> Value:
    """Change of the reflected inertia along a direction, due to design parameters."""
    total: Value = 0
    if is_zero(rotor(x, kind, j)):
        return total
    for parameter in range(kind.parameters):
        by = x.load(CONSTANTS, fields.armature(j).derivative(parameter))
        if not is_zero(by):
            total = total + by * x.entry(DP, parameter)
    return total


def rotor_force_change(x: Scope, kind: LinkKind, j: int) -> Value:
    """Change along a direction of the force that a rotor requires, with udot held constant."""
    changed = rotor_change(x, kind, j)
    return 0 if is_zero(changed) else changed * x.entry(UDOT, j)


def transmitted_along(x: Scope, kind: LinkKind, j: int) -> Value:
    """Force that a joint transmits along a degree of freedom: its own force minus the force of its rotor."""
    tau: Value = x.entry(TAU, j) if kind.forced[j] else 0
    a = rotor(x, kind, j)
    return tau if is_zero(a) else x.let("tau", tau - a * x.entry(UDOT, j), "Eq. 47")


def driven_rotor(x: Scope, kind: LinkKind) -> Value:
    """Force that the rotor of a prescribed joint requires."""
    a = rotor(x, kind, 0)
    return 0 if is_zero(a) or not kind.moves[ACCELERATION] else a * x.entry(MOTION, ACCELERATION)


def driven_rotor_change(x: Scope, kind: LinkKind) -> Value:
    """Tangent of the force that the rotor of a prescribed joint requires."""
    a = rotor(x, kind, 0)
    if is_zero(a) or not kind.moves[ACCELERATION]:
        return 0
    changed = rotor_change(x, kind, 0)
    moved = a * x.entry(DMOTION, ACCELERATION)
    return moved if is_zero(changed) else changed * x.entry(MOTION, ACCELERATION) + moved
