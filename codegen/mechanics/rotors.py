"""Reflected inertia of the rotors that drive joints: what they add along a joint's own speeds, and nowhere else.

A rotor that turns n times as fast as its joint, with inertia J about its axis, has the kinetic energy ``a u^2 / 2``, ``a = n^2
J``; what its spin does to the links that carry it is left out. To everything but the elimination of the speed it is a joint force
``-a udot``: a joint transmits ``tau - a udot`` along itself.
"""

from __future__ import annotations

from ..program.block import Scope
from ..program.scalar import Value
from . import fields
from .spatial import is_zero
from .stores import CONSTANTS, DMOTION, DP, MOTION, TAU, UDOT
from .structure.kinds import LinkKind

ACCELERATION = 2
"""Of what is known of a prescribed coordinate: see `joints.driven`."""


def rotor(x: Scope, kind: LinkKind, j: int) -> Value:
    """The reflected inertia along a speed of a link's joint, kg m^2 or kg; 0 where there is none."""
    return x.load(CONSTANTS, fields.armature(j)) if j < len(kind.geared) and kind.geared[j] else 0


def rotor_change(x: Scope, kind: LinkKind, j: int) -> Value:
    """Its change along a direction, by the design parameters that it depends on."""
    total: Value = 0
    if is_zero(rotor(x, kind, j)):
        return total
    for parameter in range(kind.parameters):
        by = x.load(CONSTANTS, fields.armature(j).derivative(parameter))
        if not is_zero(by):
            total = total + by * x.entry(DP, parameter)
    return total


def rotor_force_change(x: Scope, kind: LinkKind, j: int) -> Value:
    """The change of what the rotor of a freedom takes, along a direction with udot held."""
    changed = rotor_change(x, kind, j)
    return 0 if is_zero(changed) else changed * x.entry(UDOT, j)


def transmitted_along(x: Scope, kind: LinkKind, j: int) -> Value:
    """What a joint transmits along a freedom: its own force, less what its rotor takes."""
    tau: Value = x.entry(TAU, j) if kind.forced[j] else 0
    a = rotor(x, kind, j)
    return tau if is_zero(a) else x.let("tau", tau - a * x.entry(UDOT, j), "Eq. 47")


def driven_rotor(x: Scope, kind: LinkKind) -> Value:
    """What the rotor of a prescribed joint takes."""
    a = rotor(x, kind, 0)
    return 0 if is_zero(a) or not kind.moves[ACCELERATION] else a * x.entry(MOTION, ACCELERATION)


def driven_rotor_change(x: Scope, kind: LinkKind) -> Value:
    """The same along directions."""
    a = rotor(x, kind, 0)
    if is_zero(a) or not kind.moves[ACCELERATION]:
        return 0
    changed = rotor_change(x, kind, 0)
    moved = a * x.entry(DMOTION, ACCELERATION)
    return moved if is_zero(changed) else changed * x.entry(MOTION, ACCELERATION) + moved
