"""Force elements in joints or between points of bodies, and outputs."""

from __future__ import annotations

from ..entries import shown
from ..errors import nearest
from ..forces import ForceElement
from ..outputs import MEASURES, Output
from ..places import Point
from ..reading import Reader
from ..schema import ENERGIES, AnyForce, OutputEntry
from .bodies import BodySection
from .meaning import Meaning


def read_forces(reader: Reader, bodies: BodySection, points: dict[str, Point]) -> list[ForceElement]:
    """Read the force elements, in the order of the file."""
    result = []
    for at, name, spec in reader.entries("forces", AnyForce, "force", "force"):
        element = None if spec is None else spec.read(Meaning(reader, at, name or "", bodies, points))
        if element is not None and name is not None:
            result.append(element)
    return result


def read_outputs(reader: Reader, bodies: BodySection, points: dict[str, Point]) -> list[Output]:
    result = []
    for at in reader.section("outputs"):
        name = reader.key_name(at, "output", "output")
        reading, output = Meaning(reader, at, name or "", bodies, points), None
        if isinstance(at.value, dict):
            spec = reader.spec(OutputEntry, at)
            output = None if spec is None else spec.measure.read(spec, reading)
        elif isinstance(at.value, str) and at.value in ENERGIES:
            output = MEASURES[str(at.value)].read(None, reading)
        else:
            known = f"{' or '.join(ENERGIES)}, or a mapping such as {{position: tip, axis: z}}, is allowed"
            hint = nearest(at.value, ENERGIES) if isinstance(at.value, str) else ""
            reader.report(at, (), f"{shown(at.value)}; {known}{hint}")
        if output is not None and name is not None:
            result.append(output)
    return result
