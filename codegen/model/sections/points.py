"""Points fixed in bodies, and references to points: a name, or a body with a position on it."""

from __future__ import annotations

from typing import Any

from .. import checks
from ..entries import ZERO, FaceEntry, PointEntry
from ..errors import nearest
from ..model import GROUND, Face, Point
from ..parts import Instance
from ..positions import Path_
from ..reading import Reader
from ..unknown_names import some
from .bodies import BodySection, body_index
from .placement import bound_expressions, rotation, vector


def read_points(reader: Reader, bodies: BodySection) -> dict[str, Point]:
    result: dict[str, Point] = {}
    for at in reader.section("points"):
        name = reader.key_name(at, "point", "point")
        if name in bodies.index:
            message = f"{name!r} is already a body, and its name denotes the point at its origin; choose another name"
            reader.report(at, (), message, key=True)
        spec = reader.spec(PointEntry, at)
        if spec is not None and name is not None:
            read = inline_point(reader, name, spec, at, (), bodies)
            if read is not None:
                result[name] = read
    return result


def inline_point(
    reader: Reader, name: str, spec: PointEntry, at: Instance, sub: Path_, bodies: BodySection
) -> Point | None:
    body = body_index(reader, spec.body, at, (*sub, "body"), bodies.frames)
    x, y, z = (reader.bound(e, at, (*sub, "at", i), "parameters") for i, e in enumerate(spec.at))
    return None if body is None else Point(name, body, (x, y, z))


def point_at(
    reader: Reader, spec: Any, name: str, at: Instance, sub: Path_, bodies: BodySection, points: dict[str, Point]
) -> Point | None:
    """The point that a mapping or a name denotes; the name of a body, or ground, denotes its origin."""
    if isinstance(spec, PointEntry):
        return inline_point(reader, name, spec, at, sub, bodies)
    target = reader.reference(spec, at, sub)
    if target is None:
        return None
    found = point_named(target, bodies, points)
    if found is not None:
        return found
    if ("point", target) not in reader.first_seen:  # a point with errors has been reported

        def message() -> str:
            known = [*points, *bodies.frames]
            return f"unknown point {target!r}; a point or a body is allowed: {some(known)}{nearest(target, known)}"

        reader.report(at, sub, message)
    return None


def point_named(name: str, bodies: BodySection, points: dict[str, Point]) -> Point | None:
    """The point, or the origin of the body or ground, with the given name; None if there is neither."""
    if name in points:
        return points[name]
    return Point(name, bodies.frames[name], (ZERO, ZERO, ZERO)) if name in bodies.frames else None


def face_at(
    reader: Reader, spec: Any, at: Instance, sub: Path_, bodies: BodySection, points: dict[str, Point]
) -> Face | None:
    """The face that a mapping denotes; the name of a point denotes a face with the axes of its body."""
    if not isinstance(spec, FaceEntry):
        point = point_at(reader, spec, "", at, sub, bodies, points)
        return None if point is None else Face(point.body, point.at)
    body = body_index(reader, spec.body, at, (*sub, "body"), bodies.frames)
    bound = bound_expressions(reader, spec, at, sub)
    turns = rotation(reader, spec, at, sub, bound)
    return None if body is None else Face(body, vector(bound, *sub, "at"), turns)


def unmoved(reader: Reader, what: str, body: int, at: Instance, key: str, bodies: BodySection) -> bool:
    """Report a force element that acts only on the ground, or on a body rigidly fixed to it."""
    if body == GROUND:
        reader.report(at, (key,), f"{what} acts on the ground, which it cannot move; a body is needed")
        return True
    if not bodies.is_tree or reader.broken or rigid_parts(bodies)[body] != rigid_parts(bodies)[GROUND]:
        return False
    name = bodies.names[body]
    message = f"{what} acts on {name!r}, which is fixed to the ground, so it moves nothing; make a joint there movable"
    reader.report(at, (key,), message)
    return True


def rigid_parts(bodies: BodySection) -> list[int]:
    """For each body, and last for the ground, a number that is equal for bodies that cannot move relative to each other."""
    if bodies.rigid_parts is None:
        bodies.rigid_parts = [*checks.rigid_parts(bodies.bodies), GROUND]  # index -1 of the ground is the last
    return bodies.rigid_parts


def held_together(
    reader: Reader, what: str, start: int, end: int, at: Instance, bodies: BodySection, useless: str
) -> bool:
    """Report a loop or force element between two bodies that cannot move relative to each other."""
    if start == end:
        body = "the ground" if start == GROUND else repr(bodies.names[start])
        message = (
            f"{what} joins {body} to itself, so it {useless}; it needs two bodies that can move relative to each other"
        )
    elif not bodies.is_tree or reader.broken:
        return False
    else:
        if rigid_parts(bodies)[start] != rigid_parts(bodies)[end]:
            return False
        path = checks.fixed_path(start, end, bodies.bodies)
        one, other = ("the ground" if k == GROUND else repr(bodies.names[k]) for k in (start, end))
        joints = "joint of" if len(path) == 1 else "joints of"
        message = (
            f"{what} joins {one} to {other}, which the fixed {joints} {some(bodies.names[k] for k in path)} hold"
            f"{'s' * (len(path) == 1)} together, so it {useless}; give such a joint a degree of freedom, or remove {what}"
        )
    reader.report(at, ("to", "body"), message)
    return True
