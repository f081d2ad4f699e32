"""Data of a model for views, in `model.json`: visuals, joints, loops, points and force elements on bodies.

Numbers that depend on parameters are expression trees, so that a view follows a change of the design.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from .model.expressions import Expression
from .model.model import Body, Face, Loop, Model
from .model.visuals import Visual


def display(model: Model) -> dict[str, Any]:
    """The entry ``display`` of `model.json`: places in body frames, by index of the body; -1 is the ground."""
    loops = [x for x in model.loops if not x.is_coupling]
    return {
        "bodies": [_body(b) for b in model.bodies],
        **({"visuals": [_visual(v) for v in model.visuals]} if model.visuals else {}),
        "loops": [{"name": x.name, "ends": [_end(e) for e in _faces(x)]} for x in loops],
        "points": [{"name": x.name, **_end(x)} for x in model.points],
        "elements": [
            {"name": x.name, "type": x.type, "ends": [_end(e) for e in x.ends]} for x in model.loads if x.ends
        ],
    }


def _faces(loop: Loop) -> tuple[Face, Face]:
    """The two faces of a loop joint, ``from`` and ``to`` of the file."""
    return (loop.end, loop.start) if loop.turned else (loop.start, loop.end)


def _body(body: Body) -> dict[str, Any]:
    joint, rotation = body.joint, _rotation(body.joint.rotation)
    placed = {"at": _numbers(joint.at), "axes": [_numbers(a) for a in joint.axes]}
    return {
        "parent": body.parent,
        "joint": {"type": joint.type, **placed, **({"rotation": rotation} if rotation else {})},
        "com": _numbers(body.com),
        **({} if body.visuals is None else {"visuals": [_visual(v) for v in body.visuals]}),
    }


def _visual(visual: Visual) -> dict[str, Any]:
    optional = {
        "rotation": _rotation(visual.rotation),
        "axis": None if visual.axis is None else _numbers(visual.axis),
        "color": visual.color,
        "file": visual.file,
    }
    given = {key: value for key, value in optional.items() if value}
    return {"type": visual.type, "sizes": _numbers(visual.sizes), "at": _numbers(visual.at), **given}


def _end(place: Any) -> dict[str, Any]:
    return {"body": place.body, "at": _numbers(place.at)}


def _rotation(turns: Iterable[tuple[Iterable[Expression], Expression]]) -> list[Any]:
    return [[_numbers(axis), _number(angle)] for axis, angle in turns]


def _numbers(several: Iterable[Expression]) -> list[Any]:
    return [_number(e) for e in several]


def _number(e: Expression) -> float | Sequence[Any]:
    return float(e.value) if e.is_number else e.tree
