"""Joints, and conditions on points, that close loops."""

from __future__ import annotations

from ..conditions import ConditionType
from ..expressions import Expression
from ..model import Loop, Point, PointCondition, Vector
from ..parts import Instance
from ..reading import Reader
from ..schema import LoopEntry, LoopJoint
from .bodies import BodySection
from .digits import check_axis
from .placement import bound_expressions, vector
from .point_conditions import read_equations
from .points import face_at, held_together


def read_loops(reader: Reader, bodies: BodySection, points: dict[str, Point]) -> list[Loop]:
    """Read the loops; one that joins what is rigidly joined already is reported."""
    result: list[Loop] = []
    for at, name, spec in reader.entries("loops", LoopEntry, "loop", "body"):
        if spec is None:
            continue
        axes: tuple[Vector, ...] = ()
        equations: tuple[Expression, ...] = ()
        length: Expression | None = None
        if isinstance(spec.joint, ConditionType):
            equations, length = read_equations(reader, spec.joint, at)
        else:
            axes = _axes(reader, spec.joint, at)
        start = face_at(reader, spec.start, at, ("from",), bodies, points)
        end = face_at(reader, spec.end, at, ("to",), bodies, points)
        if name is None or start is None or end is None or not reader.is_whole(spec):
            continue
        if held_together(reader, f"loop {name!r}", start.body, end.body, at, bodies, "closes nothing"):
            continue
        if isinstance(spec.joint, ConditionType):
            result.append(PointCondition(name, spec.joint.name, (), start, end, equations, length))
        else:
            result.append(Loop(name, spec.joint.name, axes, start, end))
    return result


def _axes(reader: Reader, spec: LoopJoint, at: Instance) -> tuple[Vector, ...]:
    before = reader.errors
    bound = bound_expressions(reader, spec, at, ("joint",))
    places = [("joint", *key) for key in spec.axis_keys]
    axes = tuple(vector(bound, *sub) for sub in places)
    for axis, sub in zip(axes, places, strict=True):
        if reader.errors > before:
            break
        reader.direction(axis, at, sub)
        check_axis(reader, axis, at, sub)
    return axes
