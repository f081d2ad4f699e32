"""Passes: functions from block to block, in the order of `PASSES`. They preserve values and reduce operations."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Callable, Hashable, Mapping
from itertools import combinations

from . import algebra
from .algebra import Expr, Symbol
from .block import Block, Statement, symbols_of, up_to_sign
from .operations import count_expression
from .store import Store

Step = Statement | tuple[Store, str, Expr]
"""A statement, or a store."""

MOST_FACTORS = 5
"""Largest number of factors of a product in which the pass looks for parts that have names."""


def propagate_copies(block: Block) -> Block:
    """Replace symbols that equal another symbol, its negative or a number, and simplify."""
    known: dict[Symbol, Expr] = {}
    statements = []
    for s in block.statements:
        e = _replace(s.expression, known)
        is_negative = e.is_Mul and len(e.args) == 2 and e.args[0] is algebra.MINUS_ONE and e.args[1].is_Symbol
        if e.is_Symbol or e.is_Number or is_negative:
            known[s.target] = e
        else:
            statements.append(s if e is s.expression else Statement(s.target, e, s.tag, s.lanes))
    if not known:
        return block
    stores = [(a, f, _replace(e, known)) for a, f, e in block.stores]
    return Block(block.name, block.title, block.loads, statements, stores)


def _with(block: Block, statements: list[Statement]) -> Block:
    """A block with other statements; the same block if the statements are unchanged."""
    if len(statements) == len(block.statements) and all(map(operator.is_, statements, block.statements)):
        return block
    return Block(block.name, block.title, block.loads, statements, block.stores)


def _replace(e: Expr, known: dict[Symbol, Expr]) -> Expr:
    if not known:
        return e
    found = {s: known[s] for s in symbols_of(e) if s in known}
    return e.xreplace(found) if found else e


def share_values(block: Block) -> Block:
    """Replace right sides that are equal, or that differ only in sign, by one named value."""
    named: dict[Expr, Expr] = {}
    unsigned: set[Hashable] = set()
    known: dict[Symbol, Expr] = {}
    statements = []
    for s in block.statements:
        e = _replace(s.expression, known)
        bare = up_to_sign(e)
        if e in named:
            known[s.target] = named[e]
        elif bare in unsigned and -e in named:
            known[s.target] = -named[-e]
        else:
            named[e] = s.target
            unsigned.add(bare)
            statements.append(s if e is s.expression else Statement(s.target, e, s.tag, s.lanes))
    if not known:
        return block
    stores = [(a, f, _replace(e, known)) for a, f, e in block.stores]
    return Block(block.name, block.title, block.loads, statements, stores)


def _terms(e: Expr) -> tuple[Expr, ...]:
    return e.args if e.is_Add else (e,)


def _bare(term: Expr) -> Expr:
    """A product without its sign."""
    if term.is_Mul and term.args[0] is algebra.MINUS_ONE:
        return algebra.multiply(*term.args[1:])
    return term


def cancel_terms(block: Block) -> Block:
    """``m - a -> g h`` where a is ``m - g h``: g h is already known, and the difference would lose digits."""
    sums: dict[Symbol, Expr] = {}
    statements = []
    for s in block.statements:
        e = s.expression
        if e.is_Add and not s.lanes:
            for term in e.args:
                bare = _bare(term)
                if isinstance(bare, Symbol) and bare in sums:
                    whole = e.xreplace({bare: sums[bare]})
                    if len(_terms(whole)) < len(_terms(e)):
                        e = whole
            sums[s.target] = e
        statements.append(s if e is s.expression else Statement(s.target, e, s.tag, s.lanes))
    return _with(block, statements)


def share_products(block: Block) -> Block:
    """Name products that occur in several statements."""
    count: Counter[Expr] = Counter()
    for s in block.statements:
        if not s.lanes:
            for term in _terms(s.expression):
                bare = _bare(term)
                if bare.is_Mul or bare.is_Pow:
                    count[bare] += 1
    repeated = {e for e, n in count.items() if n > 1}
    if not repeated:
        return block
    names: dict[Expr, Symbol] = {s.expression: s.target for s in block.statements if s.expression in repeated}
    taken = {s.target.name for s in block.statements}
    made: set[Expr] = set()
    statements: list[Statement] = []
    for s in block.statements:
        if s.lanes or s.expression in repeated:
            statements.append(s)
            made.add(s.expression)
            continue
        terms = []
        changed = False
        for term in _terms(s.expression):
            bare = _bare(term)
            if bare in repeated:
                if bare not in made:
                    if bare in names:
                        terms.append(term)  # a later statement already has this name for the product
                        continue
                    number = len(terms)
                    while f"{s.target.name}_s{number}" in taken:  # an earlier run of this pass has used this name
                        number += 1
                    taken.add(f"{s.target.name}_s{number}")
                    names[bare] = Symbol(f"{s.target.name}_s{number}")
                    statements.append(Statement(names[bare], bare, s.tag))
                    made.add(bare)
                terms.append(names[bare] if bare is term or bare == term else -names[bare])
                changed = True
            else:
                terms.append(term)
        statements.append(Statement(s.target, algebra.add(*terms), s.tag, s.lanes) if changed else s)
    return _with(block, statements)


def share_factors(block: Block) -> Block:
    """``a b c -> d c`` where d is the name of ``a b``; its statement is moved forward if needed."""
    named = {s.expression: s for s in block.statements if s.expression.is_Mul and not s.lanes}
    if not named:
        return block
    statements: list[Statement] = []
    done: set[Symbol] = set()
    for s in block.statements:
        if s.target in done:
            continue
        terms = []
        for term in _terms(s.expression):
            part = None if s.lanes else _named_part(term, named, s)
            if part is not None:
                if part.target not in done:
                    statements.append(part)
                    done.add(part.target)
                term = algebra.multiply(part.target, *_without(term, part.expression))
            terms.append(term)
        e = s.expression if all(map(operator.is_, terms, _terms(s.expression))) else algebra.add(*terms)
        statements.append(s if e is s.expression else Statement(s.target, e, s.tag, s.lanes))
        done.add(s.target)
    return _with(block, statements)


def _named_part(term: Expr, named: Mapping[Expr, Statement], s: Statement) -> Statement | None:
    """Of the statements whose right side is a part of the product, the one that saves most operations. A quotient comes
    before products, since a division costs most."""
    if not term.is_Mul or len(term.args) < 3 or len(term.args) > MOST_FACTORS:
        return None
    found = []
    for n in range(len(term.args) - 1, 1, -1):
        for factors in combinations(term.args, n):
            part = named.get(algebra.multiply(*factors))
            if part is not None and part is not s and _is_bare(part.expression):
                found.append(part)
    return max(
        found, key=lambda part: (count_expression(part.expression).divisions, len(part.expression.args)), default=None
    )


def _is_bare(product: Expr) -> bool:
    """Whether a product has no minus sign in front; a name for the negative of a symbol would save nothing."""
    return product.args[0] is not algebra.MINUS_ONE


def _without(product: Expr, part: Expr) -> list[Expr]:
    """The factors of a product that are not factors of `part`."""
    return [factor for factor in product.args if factor not in part.args]


def factor_sums(block: Block) -> Block:
    """``a b + a c -> a (b + c)`` where that saves a multiplication."""
    statements = []
    for s in block.statements:
        e = s.expression
        if e.is_Add:
            e = _factor(e)
        statements.append(s if e is s.expression else Statement(s.target, e, s.tag, s.lanes))
    return _with(block, statements)


def _factor(e: Expr) -> Expr:
    count: Counter[Expr] = Counter()
    for term in e.args:
        if term.is_Mul:
            count.update(f for f in term.args if f.is_Symbol)
    best = [(n, str(f), f) for f, n in count.items() if n > 1]
    if not best:
        return e
    best.sort(key=lambda t: (-t[0], t[1]))
    f = best[0][2]
    inside = [algebra.multiply(*[a for a in t.args if a != f]) for t in e.args if t.is_Mul and f in t.args]
    outside = [t for t in e.args if not (t.is_Mul and f in t.args)]
    inner = algebra.add(*inside)
    if not inner.is_Add:
        return e
    rest = algebra.add(*outside)
    product = algebra.raw_product(f, inner)
    return algebra.raw_sum(product, rest) if outside else product


def drop_dead(block: Block) -> Block:
    """Remove statements and loads on which no store depends."""
    needed = block.symbols_stored()
    statements: list[Statement] = []
    for s in reversed(block.statements):
        if s.target in needed:
            statements.append(s)
            needed |= symbols_of(s.expression)
    statements.reverse()
    loads = {s: key for s, key in block.loads.items() if s in needed}
    if len(statements) == len(block.statements) and len(loads) == len(block.loads):
        return block
    return Block(block.name, block.title, loads, statements, block.stores)


def by_results(block: Block) -> list[tuple[list[Statement], list[tuple[Store, str, Expr]]]]:
    """Every store, preceded by the statements that it needs and that no earlier store has needed, depth first.

    This order keeps only few values alive at a time. Blocks of a hundred statements run up to 8 % faster than in the
    order of writing, with 16 registers and with 32.
    """
    places = {s.target: i for i, s in enumerate(block.statements)}
    done: set[int] = set()

    def needed(e: Expr) -> list[int]:
        return sorted((places[s] for s in symbols_of(e) if s in places), reverse=True)

    found = []
    for store in block.stores:
        statements: list[Statement] = []
        waiting = [(i, False) for i in needed(store[2])]
        while waiting:
            i, ready = waiting.pop()
            if i in done:
                continue
            if ready:
                done.add(i)
                statements.append(block.statements[i])
            else:
                waiting.append((i, True))
                waiting += [(j, False) for j in needed(block.statements[i].expression)]
        found.append((statements, [store]))
    return found


def in_order(block: Block) -> list[Step]:
    """Statements in their order; each store follows as early as possible, after earlier stores to the same place.

    In this order, the statements of one link are close together. A part of a block then needs few values of other parts.
    """
    made = {s.target: i for i, s in enumerate(block.statements)}
    waiting: dict[int, list[Step]] = {}
    after: dict[tuple[Store, str], int] = {}
    for store, name, value in block.stores:
        at = max((made[s] for s in symbols_of(value) if s in made), default=-1)
        at = after[store.plain, name] = max(at, after.get((store.plain, name), -1))
        waiting.setdefault(at, []).append((store, name, value))
    steps: list[Step] = [*waiting.get(-1, ())]
    for i, s in enumerate(block.statements):
        steps += [s, *waiting.get(i, ())]
    return steps


def as_computed(block: Block) -> list[tuple[list[Statement], list[tuple[Store, str, Expr]]]]:
    """Statements in their order, with each store as early as possible."""
    found: list[tuple[list[Statement], list[tuple[Store, str, Expr]]]] = []
    for step in in_order(block):
        found.append(([step], []) if isinstance(step, Statement) else ([], [step]))
    return found


PASSES: tuple[tuple[str, Callable[[Block], Block]], ...] = (
    ("drop dead statements", drop_dead),
    ("propagate copies", propagate_copies),
    ("share equal values", share_values),
    ("cancel terms", cancel_terms),
    ("share products", share_products),
    ("share factors", share_factors),
    ("factor sums", factor_sums),
    ("propagate copies again", propagate_copies),
    ("drop dead statements again", drop_dead),
)
"""All passes, in the order in which they run."""


def simplify(block: Block) -> Block:
    """Apply all passes in their order."""
    for _, function in PASSES:
        block = function(block)
    return block
