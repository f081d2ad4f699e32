"""Data of a model for views, in `model.json`: visuals, joints, loops, points, and force elements with their laws.

Numbers that depend on parameters are expression trees, so that a view follows a change of the design.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

from .model.expressions import Expression
from .model.forces import AlongLine, ForceElement, Spring
from .model.forces.on_body import OnBody
from .model.model import Body, Face, Loop, Model
from .model.parsing import parse
from .model.visuals import Visual

SPRING: Final = parse("-stiffness*(distance - free_length) - damping*rate")
"""The force of a spring on its end point along the line from its start point, N."""


def display(model: Model) -> dict[str, Any]:
    """The entry ``display`` of `model.json`: places in body frames, by index of the body; -1 is the ground."""
    loops = [x for x in model.loops if not x.is_coupling]
    return {
        "bodies": [_body(b) for b in model.bodies],
        **({"visuals": [_visual(v) for v in model.visuals]} if model.visuals else {}),
        "loops": [{"name": x.name, "ends": [_end(e) for e in _faces(x)]} for x in loops],
        "points": [{"name": x.name, **_end(x)} for x in model.points],
        "elements": [
            {"name": x.name, "type": x.type, "ends": [_end(e) for e in x.ends], **_law(x)}
            for x in model.loads
            if x.ends
        ],
        **_others(model),
    }


def _law(element: ForceElement) -> dict[str, Any]:
    """The force of an element along the line between its ends, or its components; empty for other types."""
    if isinstance(element, OnBody):
        return {"components": numbers(element.value), "axes": element.axes}
    if not isinstance(element, Spring | AlongLine):
        return {}
    formula = SPRING if isinstance(element, Spring) else element.law.formula
    values = zip(element.keys, numbers(element.coefficients), strict=True)
    return {"force": number(formula), "coefficients": dict(values)}


def _others(model: Model) -> dict[str, Any]:
    """The forces in joints with one degree of freedom, and the prescribed coordinates with rates that laws may
    contain."""
    single = [f for f in model.forces if len(f.values) == 1]
    joints = [{"name": f.name, "body": f.body, "value": number(f.values[0])} for f in single]
    driven = {x.name: numbers(x.values[:2]) for x in model.prescribed}
    return {**({"joint_forces": joints} if joints else {}), **({"prescribed": driven} if driven else {})}


def _faces(loop: Loop) -> tuple[Face, Face]:
    """The two faces of a loop joint, given as ``from`` and ``to`` in the model file."""
    return (loop.end, loop.start) if loop.turned else (loop.start, loop.end)


def _body(body: Body) -> dict[str, Any]:
    joint, rotation = body.joint, _rotation(body.joint.rotation)
    placed = {"at": numbers(joint.at), "axes": [numbers(a) for a in joint.axes]}
    return {
        "parent": body.parent,
        "joint": {"type": joint.type, **placed, **({"rotation": rotation} if rotation else {})},
        "com": numbers(body.com),
        **({} if body.visuals is None else {"visuals": [_visual(v) for v in body.visuals]}),
    }


def _visual(visual: Visual) -> dict[str, Any]:
    optional = {
        "rotation": _rotation(visual.rotation),
        "axis": None if visual.axis is None else numbers(visual.axis),
        "color": visual.color,
        "file": visual.file,
    }
    given = {key: value for key, value in optional.items() if value}
    return {"type": visual.type, "sizes": numbers(visual.sizes), "at": numbers(visual.at), **given}


def _end(place: Any) -> dict[str, Any]:
    return {"body": place.body, "at": numbers(place.at)}


def _rotation(turns: Iterable[tuple[Iterable[Expression], Expression]]) -> list[Any]:
    return [[numbers(axis), number(angle)] for axis, angle in turns]


def numbers(several: Iterable[Expression]) -> list[Any]:
    """Expressions for `model.json`: numbers, or expression trees."""
    return [number(e) for e in several]


def number(e: Expression) -> float | Sequence[Any]:
    return float(e.value) if e.is_number else e.tree
