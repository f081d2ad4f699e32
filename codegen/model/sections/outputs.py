"""Named scalars of interest."""

from __future__ import annotations

from ..entries import seen
from ..errors import nearest
from ..model import Output, Point
from ..reading import Reader
from ..schema import ENERGIES, OutputEntry
from .bodies import BodySection
from .points import point_at


def read_outputs(reader: Reader, bodies: BodySection, points: dict[str, Point]) -> list[Output]:
    result = []
    for at in reader.section("outputs"):
        name = reader.key_name(at, "output", "output")
        if not isinstance(at.value, dict):
            if isinstance(at.value, str) and at.value in ENERGIES:
                if name is not None:
                    result.append(Output(name, str(at.value)))
            else:
                known = f"{' or '.join(ENERGIES)}, or a mapping such as {{position: tip, axis: z}}, is allowed"
                hint = nearest(at.value, ENERGIES) if isinstance(at.value, str) else ""
                reader.report(at, (), f"{seen(at.value)}; {known}{hint}")
            continue
        spec = reader.spec(OutputEntry, at)
        if spec is None:
            continue
        if spec.value is not None:
            expression = reader.bound(spec.value, at, ("value",), "motion")
            if name is not None:
                result.append(Output(name, "value", expression=expression))
            continue
        measure = "position" if spec.position is not None else "velocity"
        x, y, z = (reader.bound(e, at, ("axis", i), "parameters") for i, e in enumerate(spec.axis))
        reader.direction((x, y, z), at, ("axis",))
        point = point_at(reader, getattr(spec, measure), name or "", at, (measure,), bodies, points)
        if name is not None and point is not None:
            result.append(Output(name, measure, point, (x, y, z)))
    return result
