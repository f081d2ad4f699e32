"""The transpose of a block: the adjoint of its linear map from inputs per direction to outputs per direction.

A block over directions has a scalar part and a part that is linear in the values per direction. Each statement of the
linear part is ``t = sum_i c_i s_i`` with scalar ``c_i``. The transpose goes from the last statement to the first and
adds ``c_i t_bar`` to every ``s_i_bar``. It reads the adjoints of fields that the block stores, and adds to the adjoints
of fields that the block loads. The adjoint of a field uses the memory of the field. So ``lambda^T J`` costs about as much
as ``J v``, whatever the number of parameters. Scalars are not recorded but computed again from the same inputs.

If the block overwrites a place, its transpose sets the adjoint of the place to zero, unless the adjoint is never used again
(`Cleared`). If the block loads a place, adds to the value and stores it again, the adjoint stays unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from ..records import dataclass
from . import algebra
from .algebra import Expr, Function, Symbol
from .block import Block, Component, Expansion, symbols_of
from .functions import Along
from .passes import drop_dead
from .store import Store

Cleared = Callable[[Store, str], bool]
"""A function that returns whether the adjoint of a stored component must be zero after the transpose. This is not needed for
results that are never overwritten."""

Nonzero = Callable[[Store, str], bool]
"""A function that returns whether the adjoint of a stored component can differ from zero."""


def _never(store: Store, name: str) -> bool:
    return False


def always(store: Store, name: str) -> bool:
    return True


def coefficients(e: Expr, lanes: set[Symbol]) -> dict[Symbol, Expr]:
    """Return the scalar factor of each symbol in an expression that is linear in the given symbols (`lanes`).

    Raises
    ------
    ValueError
        If it is not linear in them.
    """
    if e in lanes:
        return {e: algebra.ONE}
    if isinstance(e, Function) and e.name == "Along" and e.args[0] in lanes and isinstance(e.args[0], Symbol):
        return {e.args[0]: guarded(e.args[1])}
    if e.is_Add:
        total: dict[Symbol, Expr] = {}
        for term in e.args:
            for s, c in coefficients(term, lanes).items():
                total[s] = _scaled(algebra.add, total[s], c) if s in total else c
        return total
    if not (symbols_of(e) & lanes):
        if e is algebra.ZERO:
            return {}
        raise ValueError(f"{e} is added to values per direction")
    if e.is_Mul:
        inner = [f for f in e.args if symbols_of(f) & lanes]
        if len(inner) == 1:
            rest = algebra.multiply(*(f for f in e.args if f is not inner[0]))
            return {s: _scaled(algebra.multiply, rest, c) for s, c in coefficients(inner[0], lanes).items()}
    raise ValueError(f"{e} is not linear in values per direction")


class Operation(Protocol):
    """An operation that makes a sum or a product of expressions."""

    def __call__(self, *args: Expr) -> Expr: ...


GUARDED = "Guarded"
"""Function that marks a factor as possibly infinite: its product with zero is zero. See `Along`."""


def guarded(factor: Expr) -> Expr:
    """Mark a factor as possibly infinite."""
    return algebra.function(GUARDED, factor)


def _scaled(operation: Operation, *factors: Expr) -> Expr:
    """The sum or product of factors of which some may be infinite."""
    if not any(isinstance(f, Function) and f.name == GUARDED for f in factors):
        return operation(*factors)
    return guarded(operation(*(f.args[0] if isinstance(f, Function) and f.name == GUARDED else f for f in factors)))


@dataclass(frozen=True)
class Kept:
    """The scalars that an earlier sweep has computed and stored for transposes.

    Attributes
    ----------
    holds : callable (store, component) -> bool
        Returns whether a component is one of these scalars.
    place : callable (store) -> Store
        Returns the store from which transposes load the component.
    final : callable (store) -> bool
        Returns whether no other block adds to the store, so that the value need not be recomputed.
    """

    holds: Callable[[Store, str], bool]
    place: Callable[[Store], Store]
    final: Callable[[Store], bool]

    def at(self, store: Store, name: str) -> Component:
        """The place at which a kept scalar is stored."""
        return (self.place(store) if self.holds(store, name) else store), name

    def stored_by(self, block: Block) -> dict[Symbol, Component]:
        """Kept scalars that a block has stored; its transpose loads them instead of computing them again."""
        return {
            e: (self.place(a), n)
            for a, n, e in block.stores
            if not a.lanes and self.holds(a, n) and self.final(a) and isinstance(e, Symbol) and e not in block.loads
        }


def values(
    block: Block, name: str, title: str, kept: Kept, also: Callable[[Store], bool] = lambda store: False
) -> Block:
    """The part of a block over directions that computes and stores scalars for transposes, and the stores that `also` selects."""
    found = Block(name, title)
    found.loads = {s: kept.at(a, n) for s, (a, n) in block.loads.items() if not a.lanes}
    found.statements = [s for s in block.statements if not s.lanes]
    found.stores = [
        (kept.at(a, n)[0], n, e) for a, n, e in block.stores if not a.lanes and (kept.holds(a, n) or also(a))
    ]
    return found


NOTHING_KEPT = Kept(lambda store, name: False, lambda store: store, lambda store: False)
"""The value of `Kept` for blocks that keep no scalars."""


def transposed(
    block: Block, name: str, title: str, cleared: Cleared = _never, kept: Kept = NOTHING_KEPT, nonzero: Nonzero = always
) -> Block:
    """The block that computes the adjoints of the loads of `block` from the adjoints of its stores.

    Parameters
    ----------
    block : Block
    name, title : str
    cleared : callable (Store, str) -> bool
    kept : Kept
    nonzero : callable (Store, str) -> bool
    """
    x = Expansion(name, title, nonzero)
    x.block.loads = {s: kept.at(a, n) for s, (a, n) in block.loads.items() if not a.lanes}
    x.reserve(s.name for s in (*block.loads, *(t.target for t in block.statements)))
    there = kept.stored_by(block)
    x.block.loads |= there
    x.block.statements = [s for s in block.statements if not s.lanes and s.target not in there]
    lanes = {s for s, (a, _) in block.loads.items() if a.lanes} | {s.target for s in block.statements if s.lanes}
    bars: dict[Symbol, list[Expr]] = {}
    incoming: dict[Component, Expr] = {}

    def give(e: Expr, bar: Expr) -> None:
        if bar is algebra.ZERO:
            return
        for s, c in coefficients(e, lanes).items():
            if isinstance(c, Function) and c.name == GUARDED:
                bars.setdefault(s, []).append(Along(bar, x.let("c", c.args[0], "primitive")))
                continue
            factor = c if c.is_Number or c.is_Symbol or (-c).is_Symbol else x.let("c", c, "primitive")
            bars.setdefault(s, []).append(factor * bar)

    for store, n, e in reversed(block.stores):
        if store.lanes:
            bar = incoming[store, n] = x.component(store.plain, n)
            give(e, bar)
    for statement in reversed(block.statements):
        if statement.lanes and statement.target in bars:
            tag = f"T {statement.tag}" if statement.tag else ""
            bar = x.let(f"{statement.target.name}_bar", algebra.add(*bars[statement.target]), tag, lanes=True)
            give(statement.expression, bar)
    done: set[Component] = set()
    for symbol, (store, n) in block.loads.items():
        if not store.lanes:
            continue
        bar = x.let(f"{symbol.name}_bar", algebra.add(*bars.get(symbol, [])), lanes=True)
        done.add((store, n))
        if (store, n) in incoming:  # loaded and stored again: the adjoint is replaced
            if bar != incoming[store, n]:
                x.block.stores.append((store, n, bar))
        elif bar is not algebra.ZERO:
            x.block.stores.append((store.sum, n, bar))
    for store, n, _ in block.stores:
        if store.lanes and not store.adds and (store, n) not in done and cleared(store, n):
            x.block.stores.append((store, n, algebra.ZERO))
    return x.finish()


def deferred(
    block: Block,
    late: Callable[[Store, str], bool],
    saved: Callable[[int], Component],
    steady: Callable[[Store, str], bool],
) -> tuple[Block, Block]:
    """Split a block into a part that can run now and a part that needs scalars computed later.

    The second part loads values per direction from the stores of the first part. Other values of the first part are
    saved for the second part.

    Parameters
    ----------
    block : Block
    late : callable (store, component) -> bool
        Returns whether a scalar is computed later.
    saved : callable (int) -> (Store, str)
        Returns a place for a saved value.
    steady : callable (store, component) -> bool
        Returns whether the stored value remains unchanged until the second part runs.
    """
    waiting = {s for s, at in block.loads.items() if late(*at)}
    for s in block.statements:
        if symbols_of(s.expression) & waiting:
            waiting.add(s.target)
    stores = [(s, bool(symbols_of(s[2]) & waiting)) for s in block.stores]
    first = drop_dead(
        Block(block.name, block.title, block.loads, block.statements, [s for s, waits in stores if not waits])
    )
    second = Block(block.name, block.title, block.loads, block.statements, [s for s, waits in stores if waits])
    lanes = {s for s, (a, _) in block.loads.items() if a.lanes}
    there = {s.target for s in first.statements if s.lanes} | (first.loads.keys() & lanes)
    needed = second.symbols_stored()
    statements = []
    for s in reversed(block.statements):
        if s.target in needed and s.target not in there:
            statements.append(s)
            needed |= symbols_of(s.expression)
    second.statements = statements[::-1]
    places = {e: (a.plain, n) for a, n, e in first.stores if e.is_Symbol and steady(a.plain, n)}
    loads: dict[Symbol, Component] = {}
    count = 0
    for symbol in [*block.loads, *(s.target for s in block.statements)]:
        if symbol not in needed:
            continue
        if symbol in there or symbol in lanes:
            if symbol not in places:
                places[symbol], count = saved(count), count + 1
                first.stores.append((*places[symbol], symbol))
                if symbol in block.loads:
                    first.loads[symbol] = block.loads[symbol]
            loads[symbol] = places[symbol]
        elif symbol in block.loads:
            loads[symbol] = block.loads[symbol]
    second.loads = loads
    return first, second
