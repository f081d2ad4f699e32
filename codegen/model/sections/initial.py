"""Reads initial coordinates and speeds."""

from __future__ import annotations

import math
from typing import Any

from ..entries import shown
from ..errors import count_of_values
from ..expressions import Expression, made
from ..parts import Instance
from ..positions import Path_
from ..reading import Reader
from .bodies import BodySection
from .coordinates import Joints, unknown_name, values_of
from .digits import check_degrees, seems_in_degrees


def read_initial(reader: Reader, bodies: BodySection) -> dict[str, dict[str, Expression]]:
    result: dict[str, dict[str, Expression]] = {"q": {}, "u": {}}
    joints = Joints(bodies)
    groups = {"q": {j: of.coordinates for j, of in joints.items()}, "u": {j: of.speeds for j, of in joints.items()}}
    places: dict[str, tuple[Instance, Path_]] = {}
    for file in reader.parts:
        initial = file.document.root.get("initial")
        if initial is None:
            continue
        if not isinstance(initial, dict):
            reader.report(file.entry("initial"), (), f"{shown(initial)}; a mapping with the keys q, u is needed")
            continue
        for part, section in initial.items():
            at = Instance(part, section, initial, ("initial",), {}, file)
            if part == "equilibrium":
                _check_rest(reader, at, initial)
            elif part not in result:
                reader.report(at, (), f"unknown key {part!r}; keys here: q, u, equilibrium", key=True)
            elif section is not None and not isinstance(section, dict):
                reader.report(at, (), f"{shown(section)}; a mapping of joints to values is needed")
            elif section is not None:
                for at in reader.expand(file, section, ("initial", part)):
                    _initial_value(reader, at, part, groups[part], result[part], places)
    if whole := [entry for entry, angle in result["q"].items() if seems_in_degrees(angle)]:
        unit = {n: u for of in joints.values() for n, u in zip(of.coordinates, of.kind.coordinate_units, strict=True)}
        for entry in whole:
            if unit[entry] == "rad":
                check_degrees(reader, result["q"][entry], *places[f"q.{entry}"])
    for name, of in joints.items():
        if of.kind.quaternions:
            _normalise(reader, name, result["q"], places)
    return result


def is_at_rest(reader: Reader) -> bool:
    """Whether the model begins in equilibrium; the key ``equilibrium`` in the file of a submodel has no effect here."""
    files = [part.document.root.get("initial") for part in reader.parts if not part.is_submodel]
    return any(isinstance(initial, dict) and initial.get("equilibrium") in _YES for initial in files)


_YES, _NO = ("true", True), ("false", False)


def _check_rest(reader: Reader, at: Instance, initial: dict[str, Any]) -> None:
    if at.value not in (*_YES, *_NO):
        reader.report(at, (), f"{shown(at.value)}; true or false is allowed: whether the model begins in equilibrium")
    elif at.value in _YES and initial.get("u"):
        reader.report(at, (), "equilibrium excludes initial speeds; leave u out", key=True)


def _initial_value(
    reader: Reader,
    at: Instance,
    part: str,
    groups: dict[str, tuple[str, ...]],
    result: dict[str, Expression],
    places: dict[str, tuple[Instance, Path_]],
) -> None:
    what = "coordinate" if part == "q" else "speed"
    name = reader.coordinate(at.key, at, (), key=True, of=part)
    if name is None:
        return
    entries = groups.get(name)
    if entries is None:
        if name.partition(".")[0] in reader.broken:
            return
        owner = groups.get(name.rpartition(".")[0], ())
        if name not in owner:

            def unknown() -> str:
                return unknown_name(reader, what, name, (*(n for g in groups.values() for n in g), *groups))

            reader.report(at, (), unknown, key=True)
            return
        entries = (name,)
    held = [n for n in entries if f"q.{n}" in reader.prescribed] if reader.prescribed else []
    if held:
        message = f"{what} {held[0]!r} is prescribed under `motion`, which sets its initial value; leave it out here"
        reader.report(at, (), message, key=True)
        return
    values = list(values_of(at.value))
    if len(values) != len(entries) and name in reader.broken:
        return
    if len(values) != len(entries):
        message = f"{count_of_values(len(values))}; joint {name!r} has {len(entries)}: {', '.join(entries) or 'none'}"
        reader.report(at, (), message)
        return
    for entry, (sub, value) in zip(entries, values, strict=True):
        if entry in places and entry in result:
            reader.report(at, (), f"{what} {entry!r} is already given; each may be given once", key=True)
            continue
        expression = reader.scalar(at, sub, value, "parameters")
        if expression is not None:
            result[entry] = expression
            places[f"{part}.{entry}"] = places[entry] = (at, sub)


def _normalise(
    reader: Reader, name: str, values: dict[str, Expression], places: dict[str, tuple[Instance, Path_]]
) -> None:
    keys = [f"{name}.q{c}" for c in "wxyz"]
    given = [k for k in keys if k in values]
    if not given:
        return
    parts = [values.get(k, Expression.number(int(k.endswith("w")))) for k in keys]
    length = math.hypot(*(reader.numeric(e) for e in parts))
    at = places[given[0]][0]
    if abs(length - 1) > 1e-3:
        message = f"the quaternion {name}.qw qx qy qz has length {length:.6g}; 1 is needed (to 1e-3)"
        reader.report(at, (), message)
    elif abs(length - 1) > 1e-12:
        message = f"the quaternion {name}.qw qx qy qz has length {length:.12g}, not 1, and was normalised"
        reader.report(at, (), message, severity="warning")
        w, x, y, z = (e * e for e in parts)
        norm = made("sqrt", (w + x) + (y + z))
        for key, part in zip(keys, parts, strict=True):
            values[key] = part / norm
