"""Tangents of blocks: which symbols have one, which are functions of others, and the statements that follow."""

from __future__ import annotations

from typing import Any

from sympy import Expr, Symbol

from ..program.derivatives import Tangents
from .joints import JointTransform
from .spatial import XYZ, Vec


def tangent(d: Tangents | None, value: Any) -> Any:
    """Tangent of a value. On zero patterns (no `d`) it may differ from zero where the value does, unless that is a number."""
    return d.value(value) if d else pattern(value)


def pattern(value: Any) -> Any:
    """Where the tangent of a structural value can differ from zero."""
    return 0 if isinstance(value, int) else value


def store_tangent(x: Any, d: Tangents | None, array: str, name: str, v: Vec) -> None:
    """Store the tangent of a vector."""
    for k, i in enumerate(XYZ):
        x.store(array, f"{name}.{i}", tangent(d, v[k]))


UP_TANGENTS = {
    "w": "w", "tal": "al", "ta": "a", "tB": "B", "v": "v", "T": "T", "pos": "pos", "W": "W", "cw": "cw", "cv": "cv",
    "vw": "vw", "vv": "vv",
}  # fmt: skip
"""Fields of the parent that have a tangent, and the name of it."""


def seeds(x: Any, kind: Any) -> dict[Symbol, Expr]:
    """Tangents of everything that the block has loaded."""
    result: dict[Symbol, Expr] = {}
    for symbol, (array, name) in list(x.block.loads.items()):
        stem, _, component = name.partition(".")
        if array == "up" and stem in UP_TANGENTS:
            result[symbol] = x.load("lup", f"{UP_TANGENTS[stem]}.{component}" if component else UP_TANGENTS[stem])
        elif array == "u":
            result[symbol] = x.load("du", name)
        elif array == "q":
            result[symbol] = x.load("dq", name)
        elif array == "turn":
            result[symbol] = x.load("dq", "0") if kind.joint == "revolute" else x.load("lane", f"turn.{name}")
    for j in range(kind.parameters):
        result[x.load("parameter", str(j))] = x.load("dp", str(j))
    return {s: v for s, v in result.items() if v != 0}


def constants_transparent(x: Any, kind: Any) -> dict[Symbol, dict[Symbol, Expr]]:
    """A link's constants as functions of the design parameters that they depend on."""
    result: dict[Symbol, dict[Symbol, Expr]] = {}
    for symbol, (array, name) in list(x.block.loads.items()):
        if array == "c" and "/" not in name:
            result[symbol] = {x.load("parameter", str(j)): x.load("c", f"{name}/{j}") for j in range(kind.parameters)}
    return {s: {r: v for r, v in inner.items() if v != 0} for s, inner in result.items()}


def differentiate(
    x: Any, kind: Any, joint: JointTransform | None, extra: dict[Symbol, Expr] | None = None
) -> Tangents | None:
    """Append the tangents of all statements so far. None on zero patterns."""
    if x.structural:
        return None
    statements = list(x.block.statements)
    transparent = joint.transparent() if joint else {}
    transparent |= constants_transparent(x, kind)
    d = Tangents(x, seeds(x, kind) | (extra or {}), transparent)
    for statement in statements:
        d.statement(statement)
    return d
