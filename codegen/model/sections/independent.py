"""The coordinates that a model with loops asks to be independent."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from pydantic_core import PydanticCustomError

from ..entries import parse_name
from ..errors import nearest
from ..grammar import ExpressionError
from ..joints import JointType
from ..model import joint_coordinates
from ..parts import Instance
from ..positions import Path_
from ..reading import Reader
from ..repetition import name_of
from ..unknown_names import some
from .bodies import BodySection


def read_independent(reader: Reader, bodies: BodySection) -> tuple[str, ...]:
    """Names of coordinates, those of a joint for its own name."""
    joints = {
        name: (type(spec.joint), joint_coordinates(name, spec.joint.type)[0])
        for spec, name in zip(bodies.specs, bodies.names, strict=True)
        if spec is not None
    }
    result: dict[str, None] = {}
    for at, sub, item in reader.listed("independent", "[crank]"):
        name = _name(reader, at, sub, item)
        if name is None or name.partition(".")[0] in reader.broken:
            continue
        joint = name if name in joints else name.rpartition(".")[0]
        kind, coordinates = joints.get(joint, (JointType, ()))
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
                f"write {joint}, for all of the joint"
            )
            reader.report(at, sub, message)
            continue
        else:
            coordinates = (name,)
        if any(f"q.{c}" in reader.prescribed for c in coordinates):
            reader.report(
                at, sub, f"{name!r} is prescribed under `motion`, so it is no coordinate to choose; leave it out"
            )
            continue
        twice = [c for c in coordinates if c in result]
        if twice:
            reader.report(at, sub, f"{name!r} asks again for {some(twice)}; each coordinate may be given once")
        result.update(dict.fromkeys(coordinates))
    return tuple(result)


def _unknown(reader: Reader, name: str, joints: Mapping[str, tuple[type[JointType], tuple[str, ...]]]) -> str:
    groups = [(j, *(() if kind.quaternions else group)) for j, (kind, group) in joints.items() if group]
    known = list(dict.fromkeys(n for group in groups for n in group))
    hint = reader.loop_hint(name) or nearest(name, known)
    return f"unknown coordinate or joint {name!r}; allowed are {some(known)}{hint}"


def _name(reader: Reader, at: Instance, sub: Path_, item: Any) -> str | None:
    """The name that an item means, with its indices in place."""
    try:
        return at.part.name(name_of(parse_name(item, prefix="q."), reader.numbers(at))[2:])
    except PydanticCustomError as error:
        reader.report(at, sub, str(error.message()))
    except ExpressionError as error:
        reader.report(at, sub, error.message)
    return None
