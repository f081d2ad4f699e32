"""Loop joints and conditions on points, and the tolerance for redundant conditions."""

from __future__ import annotations

from typing import Final

from ..conditions import ConditionType
from ..expressions import Expression
from ..grammar import ExpressionError
from ..model import LOOP_TOLERANCE, Loop, Point, PointCondition, Vector
from ..parts import Instance
from ..positions import Path_
from ..reading import Reader
from ..schema import LoopEntry, LoopJoint
from ..surfaces import AS_WRITTEN, as_written, depends, kink, sphere, surface_function, with_coordinates
from .bodies import BodySection
from .digits import check_axis
from .placement import bound_expressions, vector
from .points import face_at, held_together


def read_loops(reader: Reader, bodies: BodySection, points: dict[str, Point]) -> list[Loop]:
    """Read the loops; a loop between rigidly joined bodies is an error."""
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


def read_equations(
    reader: Reader, spec: ConditionType, at: Instance
) -> tuple[tuple[Expression, ...], Expression | None]:
    """The equations of a condition, and its length if it is a distance; reports errors."""
    if spec.length_key:
        sub: Path_ = ("joint", spec.length_key)
        before = reader.errors
        length = reader.bound(getattr(spec, spec.length_key), at, sub, "parameters")
        value = reader.numeric(length)
        if value <= 0 and reader.errors == before:
            message = (
                f"a distance of {value:g} m is not allowed; give a positive number, since a rod without length has no "
                f"direction; for points that coincide, use a spherical joint"
            )
            reader.report(at, sub, message)
        return (sphere(length),), length
    found = []
    for path in spec.equation_keys:
        e = getattr(spec, str(path[0]))
        equation = _equation(reader, e if len(path) == 1 else e[path[1]], at, ("joint", *path))
        if equation is not None:
            found.append(equation)
    if len(found) == len(spec.equation_keys) > 1 and len(set(found)) < len(found):
        reader.report(at, ("joint", "equations"), "both equations are the same; a curve needs two different surfaces")
    return tuple(found), None


def _equation(reader: Reader, written: Expression, at: Instance, sub: Path_) -> Expression | None:
    """An equation in names of the whole model; None after an error."""
    before = reader.errors
    for name in AS_WRITTEN:
        what = _taken(reader, name, at)
        if what and name in written.names:
            message = (
                f"{name} is a coordinate of the point here, and also {what} of the file; give the latter another name"
            )
            reader.report(at, sub, message)
    tree = with_coordinates(written.tree)
    linear = frozenset(name for name, table in at.part.tables.items() if table.kind == "linear")
    if bent := kink(tree, linear):
        message = (
            f"{written} has a kink or a jump where the point moves, by {bent}; an acceleration along a surface needs second "
            f"derivatives: use step(x, from, to), cubic tables or powers, which are smooth"
        )
        reader.report(at, sub, message)
    if reader.errors > before:
        return None
    equation = reader.bound(Expression(tree), at, sub, "equations")
    if reader.errors > before:
        return None
    if not depends(equation.tree):
        message = f"{written} contains none of x, y and z; a surface is an equation in these coordinates of the point"
        reader.report(at, sub, message)
        return None
    try:
        surface_function(equation)
    except ExpressionError as error:
        reader.report(at, sub, f"a derivative of {as_written(equation.tree)} has no value: {error.message}")
        return None
    return equation


def _taken(reader: Reader, name: str, at: Instance) -> str:
    """What the name x, y or z already denotes in the file, such as ``a repeat index``; empty if nothing."""
    part = at.part
    if name in at.indices:
        return "a repeat index"
    if name in part.constants:
        return "a constant"
    if part.name(name) in reader.defaults or part.name(name) in reader.inputs:
        return "a parameter or input"
    return "an expression" if name in part.values else ""


_LARGEST: Final = 0.01


def read_loop_tolerance(reader: Reader) -> float:
    """The tolerance, a number from 0 to 0.01."""
    at = reader.only("loop_tolerance")
    if at is None:
        return LOOP_TOLERANCE
    expression = reader.scalar(at, (), at.value, "constants")
    if expression is None:
        return LOOP_TOLERANCE
    value = float(expression.value)
    if not 0 <= value <= _LARGEST:
        reader.report(
            at, (), f"loop_tolerance is {value:g}; 0 to {_LARGEST:g} is allowed, the default is {LOOP_TOLERANCE:g}"
        )
    return value
