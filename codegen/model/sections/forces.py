"""What drives the joints, and the springs between points."""

from __future__ import annotations

from ..errors import nearest
from ..model import JointForce, Point, Spring, joint_coordinates
from ..reading import Reader, count_of_values, some
from ..repetition import Instance
from ..schema import AnyForce, JointForceEntry, SpringEntry
from .bodies import BodySection
from .points import held_together, point_at


def read_forces(reader: Reader, bodies: BodySection, points: dict[str, Point]) -> tuple[list[JointForce], list[Spring]]:
    """Read the forces, those on joints and the springs each in their order."""
    on_joints: list[JointForce] = []
    springs: list[Spring] = []
    for at in reader.section("forces"):
        name = reader.key_name(at, "force", "force")
        spec = reader.spec(AnyForce, at)
        if isinstance(spec, JointForceEntry):
            on_joint = _joint_force(reader, name, spec, at, bodies)
            if on_joint is not None:
                on_joints.append(on_joint)
        elif isinstance(spec, SpringEntry):
            spring = _spring(reader, name, spec, at, bodies, points)
            if spring is not None:
                springs.append(spring)
    return on_joints, springs


def _joint_force(
    reader: Reader, name: str | None, spec: JointForceEntry, at: Instance, bodies: BodySection
) -> JointForce | None:
    values = tuple(reader.bound(e, at, ("value", i), "motion") for i, e in enumerate(spec.value))
    joint = reader.reference(spec.joint, at, ("joint",))
    if joint is None:
        return None
    if joint not in bodies.index:

        def message() -> str:
            hint = reader.loop_hint(joint) or nearest(joint, bodies.index)
            return f"unknown joint {joint!r}; a joint has the name of its body: {some(bodies.index)}{hint}"

        reader.report(at, ("joint",), message)
        return None
    body = bodies.specs[bodies.index[joint]]
    if body is None or not (reader.is_whole(spec) and reader.is_whole(body)):
        return None
    type_ = body.joint.type
    freedoms = joint_coordinates(joint, type_)[1]
    if len(values) != len(freedoms):
        needed = f"{len(freedoms)} are needed, for {', '.join('u.' + n for n in freedoms)}"
        needed = needed if freedoms else "a fixed joint takes no force"
        reader.report(at, ("value",), f"{count_of_values(len(values))} for the {type_} joint {joint!r}; {needed}")
        return None
    return None if name is None else JointForce(name, bodies.index[joint], values)


def _spring(
    reader: Reader, name: str | None, spec: SpringEntry, at: Instance, bodies: BodySection, points: dict[str, Point]
) -> Spring | None:
    start = point_at(reader, spec.start, f"{name}.from", at, ("from",), bodies, points)
    end = point_at(reader, spec.end, f"{name}.to", at, ("to",), bodies, points)
    stiffness, damping, free_length = (
        reader.bound(getattr(spec, key), at, (key,), "inputs") for key in ("stiffness", "damping", "free_length")
    )
    if name is None or start is None or end is None or not reader.is_whole(spec):
        return None
    if held_together(reader, f"spring {name!r}", start.body, end.body, at, bodies, "moves nothing"):
        return None
    return Spring(name, start, end, stiffness, damping, free_length)
