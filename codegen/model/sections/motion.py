"""Prescribed motion: coordinates of joints as functions of time, parameters and inputs."""

from __future__ import annotations

import math
import re

from ...jumps import from_to
from ..errors import count_of_values
from ..expressions import Expression
from ..kinks import Kink, find_kink
from ..parts import Instance
from ..rates import rate, rates_of
from ..reading import Reader
from .bodies import BodySection
from .coordinates import Joints, values_of


def read_motion(reader: Reader, bodies: BodySection) -> dict[str, Expression]:
    """Read prescribed coordinates; in expressions that are read later, their functions replace ``q.NAME`` and
    ``u.NAME``."""
    joints = Joints(bodies)
    found: dict[str, Expression] = {}
    for at in reader.section("motion"):
        name = reader.coordinate(at.key, at, (), key=True)
        if name is not None and (named := joints.named(reader, at, (), name, "prescribed", key=True)) is not None:
            joint, of = named
            _read_values(reader, at, name, of.coordinates if name == joint else (name,), found)
    for name, value in found.items():
        reader.prescribed |= {f"q.{name}": value.tree, f"u.{name}": rate(value, moving=frozenset(reader.inputs)).tree}
    return found


def _read_values(
    reader: Reader, at: Instance, name: str, coordinates: tuple[str, ...], found: dict[str, Expression]
) -> None:
    values = list(values_of(at.value))
    if len(values) != len(coordinates):
        message = (
            f"{count_of_values(len(values))}; joint {name!r} has {len(coordinates)}: {', '.join(coordinates)}; give a list of "
            f"values, or single coordinates by name"
        )
        reader.report(at, (), message)
        return
    for coordinate, (sub, value) in zip(coordinates, values, strict=True):
        if coordinate in found:
            reader.report(at, (), f"coordinate {coordinate!r} is already prescribed; each may be given once", key=True)
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
    """Message about a motion that jumps, or whose velocity jumps, with advice."""
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
        advice = "its slope is not zero at that end, and it is constant beyond; give the table outside: linear"
    return (
        f"{value}: the {what} of this motion jumps {from_to(kink.before, kink.after)} {where}{inside}; the impulse "
        f"on other bodies would be lost; {advice}"
    )


def _without_value(reader: Reader, expression: Expression) -> str:
    """Message about a motion without a finite value, rate or acceleration at the initial time; empty if it has all three."""
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
