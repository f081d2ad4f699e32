"""Named scalars of interest."""

from __future__ import annotations

from ..entries import seen
from ..errors import nearest
from ..outputs import MEASURES, Output
from ..places import Point
from ..reading import Reader
from ..schema import ENERGIES, OutputEntry
from .bodies import BodySection
from .meaning import Meaning


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
            reader.report(at, (), f"{seen(at.value)}; {known}{hint}")
        if output is not None and name is not None:
            result.append(output)
    return result
