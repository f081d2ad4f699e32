"""Implementation of `EntryReader`, by which force elements and outputs read their expressions and references."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..axes import Vector
from ..entries import ZERO, Entry
from ..entry_reader import NamedJoint
from ..errors import nearest
from ..expressions import Expression
from ..model import joint_coordinates
from ..motions import Motion
from ..parts import Instance
from ..places import GROUND, Face, Point
from ..reading import Reader
from ..unknown_names import is_measured, some
from .bodies import BodySection, body_index
from .points import face_at, held_together, point_at, point_named, unmoved


@dataclass(frozen=True, slots=True)
class Meaning:
    """One entry and its context; the methods are those of `EntryReader`."""

    reader: Reader
    at: Instance
    name: str
    bodies: BodySection
    points: dict[str, Point]

    def is_whole(self, entry: Entry) -> bool:
        return bool(self.name) and self.reader.is_whole(entry)

    def bound(self, expression: Expression, *path: str | int, scope: str) -> Expression:
        return self.reader.bound(expression, self.at, path, scope)

    def direction(self, axis: Vector, key: str) -> Vector:
        before = self.reader.errors
        x, y, z = (self.reader.bound(e, self.at, (key, i), "parameters") for i, e in enumerate(axis))
        if self.reader.errors == before:
            self.reader.direction((x, y, z), self.at, (key,))
        return x, y, z

    def point(self, point: Any, key: str | tuple[str | int, ...], name: str) -> Point | None:
        path = (key,) if isinstance(key, str) else key
        return point_at(self.reader, point, name, self.at, path, self.bodies, self.points)

    def body(self, reference: Expression, *path: str | int) -> int | None:
        return body_index(self.reader, reference, self.at, path, self.bodies.frames)

    def mass(self, bodies: Sequence[int] | None = None) -> float | None:
        if not self.bodies.is_sound:
            return None
        if bodies is None:
            bodies = range(len(self.bodies.bodies))
        return sum(self.reader.numeric(self.bodies.bodies[k].mass) for k in bodies if k != GROUND)

    def measured(self, *expressions: Expression) -> tuple[Point, ...]:
        names = (n for e in expressions for n in sorted(e.names) if is_measured(n))
        found = (point_named(n.split(".")[1], self.bodies, self.points) for n in names)
        return tuple({p.name: p for p in found if p is not None}.values())

    def unmoved(self, what: str, place: Point | Face, key: str) -> bool:
        return unmoved(self.reader, what, place.body, self.at, key, self.bodies)

    def face(self, face: Any, key: str) -> Face | None:
        return face_at(self.reader, face, self.at, (key,), self.bodies, self.points)

    def joint(self, reference: Expression, key: str, entry: Entry) -> NamedJoint | None:
        reader, bodies = self.reader, self.bodies
        joint = reader.reference(reference, self.at, (key,))
        if joint is None:
            return None
        if joint not in bodies.index:

            def message() -> str:
                hint = reader.loop_hint(joint) or nearest(joint, bodies.index)
                return f"unknown joint {joint!r}; joints have the names of their bodies: {some(bodies.index)}{hint}"

            reader.report(self.at, (key,), message)
            return None
        index = bodies.index[joint]
        body = bodies.specs[index]
        if body is None or not (reader.is_whole(entry) and reader.is_whole(body)):
            return None
        return NamedJoint(joint, index, body.joint.name, joint_coordinates(joint, body.joint.name)[1])

    def placed(self, joint: NamedJoint) -> tuple[Face, Face, tuple[Motion, ...], tuple[Vector, ...]]:
        body = self.bodies.bodies[joint.body]
        at = body.joint
        return Face(joint.body, (ZERO, ZERO, ZERO)), Face(body.parent, at.at, at.rotation), at.kind.motion, at.axes

    def prescribed(self, reference: Expression, key: str) -> tuple[str, str] | None:
        reader = self.reader
        found = reader.coordinate(reference, self.at, (key,))
        if found is None:
            return None
        name, known = found, [n[2:] for n in reader.prescribed if n[:2] == "q."]
        if name not in known:
            own = [n for n in known if n.rpartition(".")[0] == name]
            hint = f"; write one of {some(own)}" if own else nearest(name, known)
            nothing = (
                "; nothing is prescribed, see the section motion"
                if not known
                else f"; prescribed are {some(known)}{hint}"
            )
            reader.report(self.at, (key,), f"{name!r} is not a coordinate with prescribed motion{nothing}")
            return None
        body = self.bodies.specs[self.bodies.index[name.partition(".")[0]]]
        assert body is not None
        of_joint = joint_coordinates(name.partition(".")[0], body.joint.type)[0]
        unit = body.joint.coordinate_units[of_joint.index(name)]
        return name, "N" if unit == "m" else "N m"

    def held_together(self, what: str, start: Point | Face, end: Point | Face, useless: str) -> bool:
        return held_together(self.reader, what, start.body, end.body, self.at, self.bodies, useless)

    def report(self, path: tuple[str | int, ...], message: str) -> None:
        self.reader.report(self.at, path, message)
