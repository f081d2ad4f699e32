"""Points fixed in bodies, and what means one elsewhere: a name, or a body with a place on it."""

from __future__ import annotations

from typing import Any

from ..errors import nearest
from ..model import Point
from ..positions import Path_
from ..reading import Reader, some
from ..repetition import Instance
from ..schema import ZERO, PointEntry
from .bodies import BodySection, body_index


def read_points(reader: Reader, bodies: BodySection) -> dict[str, Point]:
    result: dict[str, Point] = {}
    for at in reader.section("points"):
        name = reader.key_name(at, "point", "point")
        if name in bodies.index:
            message = f"{name!r} is a body already; outputs name points and bodies alike, choose another name"
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


def named_point(
    reader: Reader, spec: Any, name: str, at: Instance, measure: str, bodies: BodySection, points: dict[str, Point]
) -> Point | None:
    if isinstance(spec, PointEntry):
        return inline_point(reader, name, spec, at, (measure,), bodies)
    target = reader.reference(spec, at, (measure,))
    if target is None:
        return None
    if target in points:
        return points[target]
    if target in bodies.index:
        return Point(target, bodies.index[target], (ZERO, ZERO, ZERO))
    if ("point", target) not in reader.first_seen:  # a point that is there but wrong has been reported
        known = [*points, *bodies.index]
        message = f"unknown point {target!r}; a point or a body is allowed: {some(known)}{nearest(target, known)}"
        reader.report(at, (measure,), message)
    return None
