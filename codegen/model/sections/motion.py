"""Prescribed motion: coordinates of joints as functions of time, parameters and inputs."""

from __future__ import annotations

import math
import re

from pydantic_core import PydanticCustomError

from ..entries import parse_name
from ..errors import count_of_values, nearest
from ..expressions import Expression
from ..grammar import ExpressionError
from ..joints import JointType
from ..kinks import Kink, find_kink
from ..model import joint_coordinates
from ..parts import Instance
from ..rates import rate, rates_of
from ..reading import Reader
from ..repetition import name_of
from ..unknown_names import some
from .bodies import BodySection

Groups = dict[str, tuple[type[JointType], tuple[str, ...]]]
"""The type and the coordinates of every joint."""


def read_motion(reader: Reader, bodies: BodySection) -> dict[str, Expression]:
    """What is prescribed, by coordinate; ``q.NAME`` and ``u.NAME`` of it stand for these functions from now on."""
    groups: Groups = {
        name: (type(spec.joint), joint_coordinates(name, spec.joint.type)[0])
        for spec, name in zip(bodies.specs, bodies.names, strict=True)
        if spec is not None
    }
    found: dict[str, Expression] = {}
    for at in reader.section("motion"):
        try:
            name = at.part.name(name_of(parse_name(at.key, prefix="q."), reader.numbers(at))[2:])
        except PydanticCustomError as error:
            reader.report(at, (), str(error.message()), key=True)
            continue
        except ExpressionError as error:
            reader.report(at, (), error.message, key=True)
            continue
        coordinates = _coordinates(reader, at, name, groups)
        if coordinates:
            _read_values(reader, at, name, coordinates, found)
    for name, value in found.items():
        reader.prescribed |= {f"q.{name}": value.tree, f"u.{name}": rate(value, moving=frozenset(reader.inputs)).tree}
    return found


def _coordinates(reader: Reader, at: Instance, name: str, groups: Groups) -> tuple[str, ...]:
    """The coordinates that a name stands for: those of a joint, or one; nothing after a problem."""
    joint = name if name in groups else name.rpartition(".")[0]
    if name.partition(".")[0] in reader.broken:
        return ()
    if joint not in groups or (name != joint and name not in groups[joint][1]):

        def unknown() -> str:
            known = [
                n for j, (kind, of) in groups.items() if of and not kind.quaternions for n in dict.fromkeys((j, *of))
            ]
            hint = reader.loop_hint(name) or nearest(name, known)
            return f"unknown joint or coordinate {name!r}; allowed are {some(known)}{hint}"

        reader.report(at, (), unknown, key=True)
        return ()
    kind, coordinates = groups[joint]
    if not coordinates:
        reader.report(at, (), f"joint {joint!r} is {kind.name} and has no coordinates; leave it out", key=True)
    elif kind.quaternions:
        message = (
            f"the {kind.name} joint {joint!r} has a quaternion, which cannot be prescribed; give the body joints of single "
            f"coordinates, one after the other with bodies without mass between them: prismatic, revolute, universal or "
            f"planar ones"
        )
        reader.report(at, (), message, key=True)
    else:
        return coordinates if name == joint else (name,)
    return ()


def _read_values(
    reader: Reader, at: Instance, name: str, coordinates: tuple[str, ...], found: dict[str, Expression]
) -> None:
    listed = isinstance(at.value, (list, tuple))
    values = [((i,), v) for i, v in enumerate(at.value)] if listed else [((), at.value)]
    if len(values) != len(coordinates):
        message = (
            f"{count_of_values(len(values))}; joint {name!r} has {len(coordinates)}: {', '.join(coordinates)}; give a list, or "
            f"single ones by name"
        )
        reader.report(at, (), message)
        return
    for coordinate, (sub, value) in zip(coordinates, values, strict=True):
        if coordinate in found:
            reader.report(at, (), f"coordinate {coordinate!r} is prescribed already; each may be given once", key=True)
            continue
        errors = reader.errors
        expression = reader.scalar(at, sub, value, "inputs")
        if expression is None or reader.errors > errors:
            continue
        missing = _without_value(reader, expression)
        if missing:
            reader.report(at, sub, f"{expression} {missing}")
            continue
        kink = find_kink(expression, reader.defaults, frozenset(reader.inputs))
        if kink is not None:
            reader.report(at, sub, _kinked(at, value, kink))
        place = reader.key_place(at)
        reader.places.setdefault("motion", {})[coordinate] = place
        found[coordinate] = expression


def _kinked(at: Instance, value: object, kink: Kink) -> str:
    """What is wrong with a motion that jumps, or whose velocity does, and what may be written instead."""
    where = f"at t = {kink.t:.9g} s" if kink.t is not None else f"where inputs change the branch of {kink.node}"
    what = "velocity" if kink.order else "value"
    called = [t for n, t in at.part.tables.items() if re.search(rf"\b{re.escape(n)}\s*\(", str(value))]
    inside = "" if called or kink.t is None or str(kink.node) == str(value) else f", by {kink.node}"
    advice = (
        "write a smooth function, such as step(t, from, to), which begins and ends at rest, a square such as "
        "max(0, x)**2, or a table of kind: cubic"
    )
    if any(t.kind == "linear" for t in called):
        advice = "give the table kind: cubic, and outside: linear unless it ends at rest"
    elif called:
        advice = "its slope is not zero at that end, beyond which it is constant; give the table outside: linear"
    return (
        f"{value}: the {what} of this motion jumps from {kink.before:.6g} to {kink.after:.6g} {where}{inside}; other bodies "
        f"would have to feel an impulse, which would be lost; {advice}"
    )


def _without_value(reader: Reader, expression: Expression) -> str:
    """What is wrong with a motion where the model begins; nothing if it has a value, a rate and an acceleration."""
    inputs = frozenset(reader.inputs)
    start = reader.defaults | {n: 0.0 for x in inputs for n in (x, *rates_of(x))} | {"t": 0.0}
    of = expression
    for what in ("value", "rate", "acceleration"):
        try:
            value = float(of.evaluate(start))
            of = rate(of, moving=inputs)
        except (ArithmeticError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            return f"has no finite {what} at t = 0, the default parameters and inputs of zero, where the motion begins"
    return ""
