"""Couplings of coordinates: a closing condition on the joints themselves, without a cut.

``sum of factor q - offset = 0`` is a row of the closure matrix whose entries are the factors. Its values for
displacements, speeds and accelerations are stored as the first angular component of a `motions.Twist`, in which other
conditions store the motion of faces. The same code then handles couplings and loops. A coupling's multiplier is a force
along the coordinates, in proportion to the factors. All coupled links belong to the ear (`structure/regions.py`).
Section 4.11 of the theory page.
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


def _as_twist(value: Value) -> Twist:
    return Twist([value, 0, 0], [0, 0, 0])


def coupling_residual(ear: EarGeometry, c: int) -> Twist:
    """Residual of a coupling. Eq. 32."""
    x = ear.x
    total: Value = -x.load(LOOP_CONSTANTS[c], fields.coupling_offset)
    for t, (k, j) in enumerate(ear.kind.closures[c].terms):
        total = total + ear.ratio(c, t) * ear.members[k].joint.coordinate(j)
    return _as_twist(x.let("gap", total, "Eq. 32"))


def displacement(ear: EarGeometry, c: int, complete: bool) -> Twist:
    """Change of a coupling's residual along a direction, due to parameters, independent coordinates and, with `complete`,
    dependent coordinates. d Eq. 30."""
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
    return _as_twist(x.let("cut", total, "d Eq. 30", lanes=True))


@dataclass(slots=True)
class CouplingForces:
    """Forces of couplings along coordinates, with opposite sign, by link and degree of freedom; and the tangents of
    these forces.

    The tangents hold the multipliers fixed, as for the loops' wrenches.
    """

    forces: dict[tuple[int, int], Value] = field(default_factory=dict)
    tangents: dict[tuple[int, int], Value] = field(default_factory=dict)

    def add(self, ear: EarGeometry, c: int, rows: Sequence[Condition], multipliers: Vector, d: EarTangents) -> None:
        """Add the forces of one coupling, with opposite sign. Eq. 9."""
        for row, value in zip(rows, multipliers, strict=True):
            if row.loop == c:
                for t, place in enumerate(ear.kind.closures[c].terms):
                    factor = ear.ratio(c, t)
                    self.forces[place] = self.forces.get(place, 0) + product(factor, value)
                    self.tangents[place] = self.tangents.get(place, 0) + d.of(factor) * value
