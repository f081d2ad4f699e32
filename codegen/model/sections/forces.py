"""Force elements: what drives the joints, and what acts between points of bodies."""

from __future__ import annotations

from ..forces import ForceElement
from ..places import Point
from ..reading import Reader
from ..schema import AnyForce
from .bodies import BodySection
from .meaning import Meaning


def read_forces(reader: Reader, bodies: BodySection, points: dict[str, Point]) -> list[ForceElement]:
    """Read the force elements in their order."""
    result = []
    for at, name, spec in reader.entries("forces", AnyForce, "force", "force"):
        element = None if spec is None else spec.read(Meaning(reader, at, name or "", bodies, points))
        if element is not None and name is not None:
            result.append(element)
    return result
