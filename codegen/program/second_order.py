"""Forward over reverse differentiation: the tangent of a block, its adjoint, and the tangent of its adjoint.

The adjoint of a block is the transpose of its tangent, for one vector of weights, so each of its values is a single number.
The tangent of the adjoint along directions gives products with second derivatives. One function makes both tangents from the
derivative primitives of the statements, so no second derivative is written by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from . import algebra
from .algebra import Expr, Function, Symbol
from .block import Block, Component, Expansion, Statement
from .derivatives import Tangents
from .functions import Along
from .store import MARGIN, Store
from .transpose import Nonzero, transposed

Primitives = dict[Symbol, dict[Symbol, Expr]]
"""Derivatives of transparent symbols with respect to the symbols on which they depend; see `derivatives.Tangents`."""

Further = Callable[[Tangents], list[tuple[Store, str, Expr]]]
"""A function from the tangents of a block to further stores, besides the tangents of stored values."""


def nothing(d: Tangents) -> list[tuple[Store, str, Expr]]:
    """The default of `further`: no stores besides the tangents of stored values."""
    return []


def along(
    x: Expansion,
    tangent_of: Callable[[Store, str], Component | None],
    primitives: Callable[[Expansion], tuple[Primitives, Mapping[Symbol, Expr]]] = lambda x: ({}, {}),
    equal: Mapping[Symbol, Expr] = MappingProxyType({}),
    recalled: Mapping[Symbol, Component] = MappingProxyType({}),
    known: Mapping[Symbol, Component] = MappingProxyType({}),
    further: Further = nothing,
) -> Block:
    """Append the tangents of all statements to a block, and store tangents in place of values.

    Parameters
    ----------
    x : Expansion
        The expansion that continues the block, as `Expansion.resume` returns it.
    tangent_of : callable (Store, str) -> (Store, str) or None
        Returns the place of the tangent of a component; None if it has none.
    primitives : callable (Expansion) -> (dict, mapping)
        Returns the transparent symbols, and the tangents of symbols on which they depend.
    equal : mapping of Symbol to Expr
        Symbols that have the tangent of another expression.
    recalled : mapping of Symbol to (Store, str)
        Values that are loaded instead of computed. Their tangents follow from the statements that would compute them.
    known : mapping of Symbol to (Store, str)
        Values that are stored as components, whose tangents are loaded.
    further : callable (Tangents) -> list of (Store, str, Expr)
        See `Further`.
    """
    block = x.block
    transparent, roots = primitives(x)
    seeds = dict(roots)
    for symbol, (store, name) in list(block.loads.items()):
        if store.lanes or symbol in transparent or symbol in roots or symbol in recalled:
            continue
        at = tangent_of(store, name)
        if at is not None:
            seeds[symbol] = x.component(*at)
    d = Tangents(x, {s: v for s, v in seeds.items() if v is not algebra.ZERO}, transparent)
    for statement in list(block.statements):
        if statement.target in known:
            at = tangent_of(*known[statement.target])
            d.of[statement.target] = algebra.ZERO if at is None else x.component(*at)
        elif statement.target in equal:
            d.of[statement.target] = d.value(equal[statement.target])
        else:
            _differentiate(d, statement)
    stores: list[tuple[Store, str, Expr]] = []
    for store, name, e in block.stores:
        at = None if store.memory is MARGIN else tangent_of(store.plain, name)
        if at is not None:
            value = _value(d, e) if _guarded(e) else d.value(e)
            stores.append((at[0].sum if store.adds else at[0], at[1], value))
    block.stores = stores + further(d)
    block.statements = [s for s in block.statements if s.target not in recalled]
    block.loads |= recalled
    return block


def _guarded(e: Expr) -> list[Expr]:
    """The terms of a sum that are products with possibly infinite factors; see `functions.Along`."""
    return [t for t in (e.args if e.is_Add else (e,)) if isinstance(t, Function) and t.name == "Along"]


def _differentiate(d: Tangents, statement: Statement) -> None:
    """Write the tangent of a statement; products with possibly infinite factors remain zero where the other factor is zero."""
    if not _guarded(statement.expression):
        d.statement(statement)
        return
    value = _value(d, statement.expression)
    if value is not algebra.ZERO:
        name, tag = statement.target.name, f"d {statement.tag}" if statement.tag else ""
        d.of[statement.target] = d.expansion.let(f"d_{name}", value, tag, lanes=True)


def _value(d: Tangents, e: Expr) -> Expr:
    """Tangent of a sum that contains products with possibly infinite factors: ``d(b c) = db c + b dc``."""
    special = _guarded(e)
    plain = algebra.add(*(t for t in (e.args if e.is_Add else (e,)) if t not in special))
    terms = [d.expression(plain)]
    for term in special:
        b, c = term.args
        terms.append(_along(d, d.value(b), c))
        changed = d.value(c)
        if changed is not algebra.ZERO:
            terms.append(_along(d, changed, b))
    return algebra.add(*terms)


def _along(d: Tangents, along: Expr, factor: Expr) -> Expr:
    """A value per direction times a factor that may be infinite."""
    if along is algebra.ZERO:
        return algebra.ZERO
    sign, symbol = (algebra.ONE, along) if along.is_Symbol else algebra.coefficient(along)
    return Along(symbol, d.expansion.let("d", sign * factor, "primitive"))


def adjoint(block: Block, name: str, title: str, place: Callable[[Store], Store], nonzero: Nonzero) -> Block:
    """The adjoint of a block of values, from its tangent.

    Parameters
    ----------
    block : Block
        The tangent, see `along`.
    name, title : str
        Name and title of the adjoint.
    place : callable (Store) -> Store
        Returns the store of the adjoints of a store of tangents; adjoints do not have one value per direction.
    nonzero : callable (Store, str) -> bool
    """
    found = transpose(block, name, title, place, nonzero)
    return Block(
        name,
        title,
        found.loads,
        [Statement(s.target, s.expression, s.tag) for s in found.statements],
        found.stores,
    )


def transpose(block: Block, name: str, title: str, place: Callable[[Store], Store], nonzero: Nonzero) -> Block:
    """The transpose of a tangent for adjoints that have one value per direction; see `adjoint`."""
    found = transposed(block, name, title, nonzero=nonzero)
    for store, component, _ in found.stores:
        assert store.adds, f"{name}: {store}.{component} is overwritten, and its former adjoint is needed again"
    return Block(
        name,
        title,
        {s: (place(a) if a.lanes else a, n) for s, (a, n) in found.loads.items()},
        found.statements,
        [(place(a.plain).sum if a.lanes else a, n, e) for a, n, e in found.stores],
    )
