"""Linear and angular momentum of the system, from the sums over links."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.expressions import Expression
from ...model.outputs import Output
from ...program.scalar import Value
from ..spatial import cross, dot, minus
from ..structure.system import System
from .center_of_mass import center_of_system, mass_properties
from .measure import RecordMeasure
from .records import Records


def momentum(records: Records, output: Output) -> Value:
    """Linear momentum ``n . P``; angular momentum ``n . L`` about the ground's origin; or ``n . (L - c x P)`` about the
    centre of mass c."""
    kind, about = output.choice
    n = records.direction(output.axis)
    linear, angular = records.momenta()
    if kind == "linear":
        return dot(n, linear)
    if about == "center_of_mass":
        angular = minus(angular, cross(center_of_system(records), linear))
        angular = [records.x.let("L", e) for e in angular]
    return dot(n, angular)


def about_center(output: Output) -> bool:
    return output.choice[1] == "center_of_mass"


def sums(output: Output) -> tuple[str, ...]:
    """The sums over links that the output reads; momentum about the centre of mass also reads the sums of masses."""
    return ("masses",) if about_center(output) else ()


def more(output: Output, system: System) -> Sequence[Expression]:
    return mass_properties(output, system) if about_center(output) else ()


MOMENTUM = RecordMeasure(("pose", "kinetic", "momenta"), momentum, also=sums, more=more)
