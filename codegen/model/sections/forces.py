"""What drives the joints."""

from __future__ import annotations

from ..errors import nearest
from ..model import JointForce, joint_coordinates
from ..reading import Reader, count_of_values, some
from ..schema import JointForceEntry
from .bodies import BodySection


def read_forces(reader: Reader, bodies: BodySection) -> list[JointForce]:
    result = []
    for at in reader.section("forces"):
        name = reader.key_name(at, "force", "force")
        spec = reader.spec(JointForceEntry, at)
        if spec is None:
            continue
        values = tuple(reader.bound(e, at, ("value", i), "motion") for i, e in enumerate(spec.value))
        joint = reader.reference(spec.joint, at, ("joint",))
        if joint is None:
            continue
        if joint not in bodies.index:
            known = f"a joint has the name of its body: {some(bodies.index)}{nearest(joint, bodies.index)}"
            reader.report(at, ("joint",), f"unknown joint {joint!r}; {known}")
            continue
        body = bodies.specs[bodies.index[joint]]
        if body is None:
            continue
        type_ = body.joint.type
        freedoms = joint_coordinates(joint, type_)[1]
        if not (reader.is_whole(spec) and reader.is_whole(body)):
            continue
        if len(values) != len(freedoms):
            needed = f"{len(freedoms)} are needed, for {', '.join('u.' + n for n in freedoms)}"
            needed = needed if freedoms else "a fixed joint takes no force"
            reader.report(at, ("value",), f"{count_of_values(len(values))} for the {type_} joint {joint!r}; {needed}")
        elif name is not None:
            result.append(JointForce(name, bodies.index[joint], values))
    return result
