"""Couplings of coordinates: a closing condition that sees the joints themselves, not what they do at a cut.

``sum of factor q - offset = 0`` is a row of the closure matrix whose entries are the factors. What it sees of displacements,
speeds and accelerations stands where that of faces does, as the first component of an angular part (`motions.Twist`): so
conditions, factors and solutions are those of loops. Its multiplier is a force along the coordinates, in the same proportion.
All coupled links are of the ear (`structure/regions.py`). Section 4.11 of the theory page.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from ...program.scalar import Value, Vector
from ...records import dataclass
from .. import fields
from ..spatial import product
from ..stores import CL_DP, LOOP_CONSTANTS
from .conditions import Condition
from .geometry import EarGeometry
from .motions import Twist
from .tangents import EarTangents


def _seen(value: Value) -> Twist:
    return Twist([value, 0, 0], [0, 0, 0])


def open_by(ear: EarGeometry, c: int) -> Twist:
    """By how much the coordinates miss a coupling. Eq. 32."""
    x = ear.x
    total: Value = -x.load(LOOP_CONSTANTS[c], fields.coupling_offset)
    for t, (k, j) in enumerate(ear.kind.closures[c].terms):
        total = total + ear.ratio(c, t) * ear.members[k].joint.coordinate(j)
    return _seen(x.let("gap", total, "Eq. 32"))


def displacement(ear: EarGeometry, c: int, complete: bool) -> Twist:
    """What a direction changes of that, by parameters and joints; only `complete` seeds have the dependent ones. d Eq. 30."""
    x, closure = ear.x, ear.kind.closures[c]
    total: Value = 0
    for j in range(closure.parameters):
        change: Value = -x.load(LOOP_CONSTANTS[c], fields.coupling_offset.derivative(j))
        for t, (k, freedom) in enumerate(closure.terms):
            factor = x.load(LOOP_CONSTANTS[c], fields.coupling_factor(t).derivative(j))
            change = change + factor * ear.members[k].joint.coordinate(freedom)
        total = total + x.let("gap", change, "d Eq. 30") * x.entry(CL_DP[c], j)
    for t, (k, freedom) in enumerate(closure.terms):
        if complete or freedom not in ear.kind.dependent[k]:
            total = total + ear.ratio(c, t) * ear.members[k].joint.along_freedom(freedom)
    return _seen(x.let("cut", total, "d Eq. 30", lanes=True))


@dataclass(slots=True)
class CouplingForces:
    """What couplings take along coordinates, the opposite of what they exert, by link and freedom; and its tangents.

    These are with the multipliers held, as those of loops' wrenches are.
    """

    forces: dict[tuple[int, int], Value] = field(default_factory=dict)
    tangents: dict[tuple[int, int], Value] = field(default_factory=dict)

    def add(self, ear: EarGeometry, c: int, rows: Sequence[Condition], multipliers: Vector, d: EarTangents) -> None:
        """What one coupling takes. Eq. 9."""
        for row, value in zip(rows, multipliers, strict=True):
            if row.loop == c:
                for t, place in enumerate(ear.kind.closures[c].terms):
                    factor = ear.ratio(c, t)
                    self.forces[place] = self.forces.get(place, 0) + product(factor, value)
                    self.tangents[place] = self.tangents.get(place, 0) + d.of(factor) * value
