"""Coordinates that a model with loops lists as independent."""

from __future__ import annotations

from functools import partial

from ..joints import JointType
from ..reading import Reader
from ..unknown_names import some
from .bodies import BodySection
from .coordinates import Joints, unknown_name


def read_independent(reader: Reader, bodies: BodySection) -> tuple[str, ...]:
    """Names of coordinates; the name of a joint gives all of its coordinates."""
    joints = Joints(bodies)
    result: dict[str, None] = {}
    for at, sub, item in reader.listed("independent", "[crank]"):
        name = reader.coordinate(item, at, sub)
        if name is None or name.partition(".")[0] in reader.broken:
            continue
        joint = joints.owner(name)
        kind, coordinates = joints[joint][:2] if joint in joints else (JointType, ())
        if name == joint:
            if not coordinates:
                reader.report(at, sub, f"joint {name!r} is {kind.name} and has no coordinates; leave it out")
                continue
        elif name not in coordinates:
            reader.report(at, sub, partial(_unknown, reader, name, joints))
            continue
        elif kind.quaternions:
            message = (
                f"{name} is one component of the {kind.name} joint {joint!r}, whose quaternion and speeds belong together; "
                f"write {joint} for the whole joint"
            )
            reader.report(at, sub, message)
            continue
        else:
            coordinates = (name,)
        if any(f"q.{c}" in reader.prescribed for c in coordinates):
            reader.report(
                at, sub, f"{name!r} is prescribed under `motion`, so it is not a free coordinate; leave it out"
            )
            continue
        twice = [c for c in coordinates if c in result]
        if twice:
            reader.report(at, sub, f"{name!r} repeats {some(twice)}; each coordinate may be given once")
        result.update(dict.fromkeys(coordinates))
    return tuple(result)


def _unknown(reader: Reader, name: str, joints: Joints) -> str:
    groups = [(j, *(() if x.kind.quaternions else x.coordinates)) for j, x in joints.items() if x.coordinates]
    return unknown_name(reader, "coordinate or joint", name, (n for group in groups for n in group))
