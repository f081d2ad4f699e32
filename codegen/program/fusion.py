"""Fusion: several blocks in sequence become one block, in which later ones use values of earlier ones directly."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from . import algebra
from .algebra import Expr, Symbol
from .block import Block, Component, Statement, symbols_of
from .store import Store


def fused(name: str, title: str, blocks: Iterable[Block], zero: Callable[[Store, str], bool]) -> Block:
    """Combine blocks that run in sequence into one block.

    A value that an earlier block stores is not loaded again, and only the last value of each place is stored. This is right
    only if all blocks access a place through the same store, or if no block overwrites it.

    Parameters
    ----------
    name, title : str
        Of the result.
    blocks : iterable of Block
    zero : callable (store, component) -> bool
        Returns whether the place contains zero or an unused value before the block runs. Then the block does not load the
        place, and overwrites it instead of adding to it.
    """
    x = _Fusion(name, title, zero)
    for block in blocks:
        x.add(block)
    return x.finish()


class _Fusion:
    """Builds one block from several.

    Attributes
    ----------
    known : dict of (Store, str) to Expr
        Current value of each place, where known.
    pending : dict of (Store, str) to (Expr, bool)
        Value to store at the end, and whether it is added to the stored value.
    """

    def __init__(self, name: str, title: str, zero: Callable[[Store, str], bool]):
        self.block = Block(name, title)
        self.zero = zero
        self.known: dict[Component, Expr] = {}
        self.pending: dict[Component, tuple[Expr, bool]] = {}
        self.taken: set[str] = set()

    def add(self, block: Block) -> None:
        """Append a block to the combined one."""
        new: dict[Symbol, Expr] = {}
        for symbol, (store, name) in block.loads.items():
            new[symbol] = self.value((store.plain, name), symbol)
        for s in block.statements:
            target = self.fresh(s.target.name)
            changed = {a: new[a] for a in symbols_of(s.expression) if new.get(a, a) is not a}
            e = algebra.replaced_in_order(s.expression, changed) if changed else s.expression
            self.block.statements.append(
                s if e is s.expression and target is s.target else Statement(target, e, s.tag, s.lanes)
            )
            new[s.target] = target
        for store, name, e in block.stores:
            self.store(store, name, algebra.replaced_in_order(algebra.expression(e), new))

    def value(self, at: Component, symbol: Symbol) -> Expr:
        """The current value of a place; loaded at most once."""
        if at not in self.known and at not in self.pending and self.zero(*at):
            self.known[at] = algebra.ZERO
        if at not in self.known:
            loaded: Expr = (read := self.fresh(symbol.name))
            self.block.loads[read] = at
            if at in self.pending:
                loaded = self.let(symbol.name, loaded + self.pending[at][0], at[0].lanes)
                self.pending[at] = loaded, False
            self.known[at] = loaded
        return self.named(at)

    def named(self, at: Component) -> Expr:
        """The known value of a place, named so that several statements can read it."""
        e = self.known[at]
        if self.pending.get(at, (None,))[0] is e:
            self.known[at] = self.let(f"{at[0].label}_{at[1]}", e, at[0].lanes)
            self.pending[at] = self.known[at], False
        return self.known[at]

    def store(self, store: Store, name: str, e: Expr) -> None:
        """Replace the value of a place, or add to it."""
        at = store.plain, name
        if store.adds and at not in self.known and at not in self.pending and self.zero(*at):
            self.known[at] = algebra.ZERO
        if store.adds and at in self.known:
            e = self.named(at) + e
        elif store.adds:
            self.pending[at] = (self.pending[at][0] + e if at in self.pending else e), True
            return
        self.known[at] = e
        self.pending[at] = e, False

    def let(self, name: str, e: Expr, lanes: bool) -> Expr:
        """Name a value that has no name yet."""
        if e.is_Symbol or e.is_Number or (-e).is_Symbol:
            return e
        target = self.fresh(name.replace(".", "_").replace("/", "_d").replace("#", ""))
        self.block.statements.append(Statement(target, e, "", lanes))
        return target

    def fresh(self, name: str) -> Symbol:
        """A symbol with an unused name, the given one if possible."""
        unique, n = name, 0
        while unique in self.taken:
            n += 1
            unique = f"{name}_b{n}"
        self.taken.add(unique)
        return Symbol(unique)

    def finish(self) -> Block:
        self.block.stores = [(s.sum if adds else s, n, e) for (s, n), (e, adds) in self.pending.items()]
        return self.block
