"""Tangents of blocks: the tangents of symbols that a block loads, and the statements that follow from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from ...program import algebra
from ...program.algebra import Expr, Symbol
from ...program.block import Expansion, Scope
from ...program.derivatives import Tangents, of_symbols
from ...program.field import AnyField, ScalarField
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..joints import LinkJoint
from ..spatial import is_zero
from ..stores import (
    CONSTANTS,
    COORDINATES,
    DP,
    LME,
    LUP,
    ME,
    MY_COLUMNS,
    MY_LANE,
    PARAMETER,
    SPEEDS,
    TANGENT_OF,
    TURNS,
    UP,
)
from ..structure.kinds import LinkKind


def tangent(d: Tangents | None, value: Value) -> Value:
    """Tangent of a value; without `d`, its zero pattern (see `pattern`)."""
    return d.value(value) if d else pattern(value)


def pattern(value: Value) -> Value:
    """Zero pattern of a value's tangent: zero for a number, otherwise the pattern of the value."""
    return 0 if isinstance(value, int) else value


Part = tuple[AnyField, Vector | Matrix]
"""A named value and its field: a vector or a matrix."""


def _scalars(parts: Sequence[Part]) -> Iterator[tuple[ScalarField, Value]]:
    for field, value in parts:
        yield from zip(field.scalars(), (e for v in value for e in (v if isinstance(v, list) else [v])), strict=True)


def store_tangents(x: Scope, d: Tangents | None, stores: Iterable[Store], parts: Sequence[Part]) -> None:
    """Store the tangents of vectors and matrices in each of the stores."""
    for store in stores:
        for field, value in _scalars(parts):
            x.store(store, field, tangent(d, value))


def store_motion(
    x: Scope, kind: LinkKind, joint: LinkJoint, parts: Sequence[Part], also: Mapping[Store, Store] | None = None
) -> None:
    """Store a link's motion in its record. If the block is differentiated, store the tangents of the motion, in the slot
    that the children read too. `also`: see `differentiate`.
    """
    for field, value in _scalars(parts):
        x.store(ME, field, value)
    if x.tangents:
        store_tangents(x, differentiate(x, kind, joint, also=also), (LME, MY_LANE), parts)


UP_TANGENTS = {
    f.name: f.name
    for f in (
        fields.angular_velocity, fields.velocity, fields.position, fields.attitude, fields.closing_twist.angular,
        fields.closing_twist.linear, fields.applied_twist.angular, fields.applied_twist.linear,
    )
} | {
    whole.name: part.name
    for whole, part in (
        (fields.total.al, fields.remainder.al), (fields.total.a, fields.remainder.a), (fields.total.B, fields.remainder.B),
        (fields.moving.w, fields.moving.w), (fields.moving.al, fields.moving.al),
        (fields.moving.a, fields.moving.a), (fields.moving.B, fields.moving.B),
    )
}  # fmt: skip
"""Fields of the parent that have a tangent, each with the name of the field of this tangent."""


OWN_SEEDS = (COORDINATES, SPEEDS, TURNS)
"""Stores of a link's own coordinates and speeds, and of the rotation vector of its joint."""


def seeds(x: Expansion, kind: LinkKind, own: bool = False) -> dict[Symbol, Expr]:
    """Tangents of all symbols that the block has loaded; with `own`, only of the link's own coordinates and speeds."""
    result: dict[Symbol, Expr] = {}
    for symbol, (store, name) in list(x.block.loads.items()):
        stem, _, component = name.partition(".")
        if own and store not in OWN_SEEDS:
            continue
        if store is UP and stem in UP_TANGENTS:
            result[symbol] = x.component(LUP, f"{UP_TANGENTS[stem]}.{component}")
        elif store in TANGENT_OF:
            result[symbol] = x.component(TANGENT_OF[store], name)
        elif store is TURNS:
            result[symbol] = algebra.expression(kind.joint.turn_seed(x, name, MY_COLUMNS if own else MY_LANE))
    for j in range(0 if own else kind.parameters):
        result[x.symbol(PARAMETER, j)] = x.entry(DP, j)
    return {s: v for s, v in result.items() if v is not algebra.ZERO}


def constants_transparent(x: Expansion, kind: LinkKind) -> dict[Symbol, dict[Symbol, Expr]]:
    """A link's constants as functions of the design parameters on which they depend."""
    result: dict[Symbol, dict[Symbol, Expr]] = {}
    for symbol, (store, name) in list(x.block.loads.items()):
        if store is CONSTANTS and "/" not in name:
            result[symbol] = {
                x.symbol(PARAMETER, j): x.component(CONSTANTS, f"{name}/{j}") for j in range(kind.parameters)
            }
    return {s: {r: v for r, v in inner.items() if v is not algebra.ZERO} for s, inner in result.items()}


def differentiate(
    x: Scope,
    kind: LinkKind,
    joint: LinkJoint | None,
    extra: Mapping[Symbol, Value] | None = None,
    same: Mapping[Symbol, Value] | None = None,
    own: bool = False,
    also: Mapping[Store, Store] | None = None,
) -> Tangents | None:
    """Append the tangents of all statements so far, except those in `extra`, whose tangents are given; returns None on
    zero patterns.

    `same` maps a value to an earlier, equal value, whose tangent serves for both. With `own`, tangents are along the
    link's own coordinates and speeds only. `also` maps further stores to the stores of their tangents.
    """
    if not isinstance(x, Expansion):
        return None
    extra, same, also = extra or {}, same or {}, also or {}
    known = [(s, x.component(also[a], name)) for s, (a, name) in list(x.block.loads.items()) if a in also]
    statements = list(x.block.statements)
    transparent = of_symbols(joint.transparent()) if joint else {}
    transparent |= constants_transparent(x, kind)
    given = {s: algebra.expression(v) for s, v in (*extra.items(), *known) if not is_zero(v)}
    d = Tangents(x, seeds(x, kind, own) | given, transparent)
    for statement in statements:
        if statement.target in same:
            d.of[statement.target] = d.value(same[statement.target])
        elif statement.target not in extra:
            d.statement(statement)
    return d
