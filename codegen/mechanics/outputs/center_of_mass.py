"""Centre of mass of the system, from sums over the links, or of some bodies, from the records of their links."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.expressions import Expression
from ...model.outputs import Output
from ...model.places import Point
from ...program.scalar import Value, Vector
from ..spatial import add, dot, scale
from ..structure.system import System
from .measure import RecordMeasure
from .records import Records, expressions_of, grounded


def mass_properties(output: Output, system: System) -> Sequence[Expression]:
    """Masses and mass centres of the bodies that an output names. If it names none: those of bodies fixed to the ground."""
    bodies = output.bodies or grounded(system)
    found = [] if output.bodies else expressions_of(system, bodies)
    for k in bodies:
        found += [system.model.bodies[k].mass, *system.model.bodies[k].com]
    return found


def center(records: Records, bodies: Sequence[int], mass: Value, moment: Vector) -> Vector:
    """Centre of mass of the listed bodies and of other bodies with a given total mass and first moment."""
    let = records.x.let
    for k in bodies:
        body = records.system.model.bodies[k]
        m = let("m", records.evaluate(body.mass))
        x = records.position(Point(body.name, k, body.com))
        moment = [let("h", e) for e in add(moment, scale(m, [let("x", e) for e in x]))]
        mass = let("m", mass + m)
    inverse = let("inverse", 1 / mass)
    return [let("c", e * inverse) for e in moment]


def center_of_system(records: Records) -> Vector:
    """Centre of mass of all bodies."""
    mass, *moment = records.masses()
    return center(records, grounded(records.system), mass, moment)


def center_of_mass(records: Records, output: Output) -> Value:
    """Component of the centre of mass along the output's axis: ``n . sum m x / sum m``."""
    n = records.direction(output.axis)
    c = center(records, output.bodies, 0, [0, 0, 0]) if output.bodies else center_of_system(records)
    return dot(n, c)


def sums(output: Output) -> tuple[str, ...]:
    """Names of the sums over all links that the output reads; none if the output names bodies."""
    return () if output.bodies else ("masses",)


CENTER_OF_MASS = RecordMeasure(("pose",), center_of_mass, also=sums, more=mass_properties)
