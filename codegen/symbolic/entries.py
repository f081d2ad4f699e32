"""Entries of matrices: their size, the intermediate variables that they need, and the steps in which numbers are computed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import sympy

from .polynomials import Polynomial

LONGEST = 400
"""Maximum number of terms of a sum that is computed at once, since compilers limit the nesting of operators."""

LARGEST = 2**53
"""Largest integer up to which all integers are exact as floats."""


def needed(
    of: Iterable[sympy.Basic], definitions: Sequence[tuple[sympy.Symbol, sympy.Expr | Polynomial]]
) -> dict[sympy.Symbol, sympy.Expr]:
    """The intermediate variables of expressions and matrices, in the order of their definitions."""
    needed, found = {s for e in of for s in e.free_symbols}, {}
    for symbol, value in reversed(definitions):
        if symbol in needed:
            found[symbol] = value.expression if isinstance(value, Polynomial) else value
            needed |= found[symbol].free_symbols
    return dict(reversed(found.items()))


def count(e: sympy.Basic, known: dict[sympy.Basic, int]) -> int:
    """Number of terms of an expression; for a product, the terms of all its factors that are sums."""
    if e not in known:
        inner = [count(x, known) for x in e.args]
        known[e] = sum(inner) if e.is_Add else sum(n for n in inner if n > 1) or 1
    return known[e]


def floats(e: sympy.Expr) -> sympy.Expr:
    """An expression in which exact numbers beyond the range of machine integers are replaced by floats."""
    large = {x: sympy.Float(x, 17) for x in e.atoms(sympy.Rational) if max(abs(x.p), x.q) > LARGEST}
    return e.xreplace(large) if large else e


def steps(inner: dict[sympy.Symbol, sympy.Expr], cse: bool, entries: Any) -> tuple[list[Any], Any]:
    """Definitions to be evaluated first, and the entries in terms of them. The definitions are `inner` or common
    subexpressions, and parts of long sums."""
    before, entries = sympy.cse(entries, list=False) if cse and not inner else (list(inner.items()), entries)
    found: list[Any] = []

    def short(e: Any) -> Any:
        if isinstance(e, list):
            return [short(x) for x in e]
        if not any(len(x.args) > LONGEST for x in e.atoms(sympy.Add)):
            return e
        args = [short(x) for x in e.args]
        while e.is_Add and len(args) > LONGEST:
            parts = [sympy.Add(*args[k : k + LONGEST]) for k in range(0, len(args), LONGEST)]
            args = [sympy.Dummy("part") for _ in parts]
            found.extend(zip(args, parts, strict=True))
        return e.func(*args)

    for symbol, value in before:
        found.append((symbol, short(value)))
    return found, short(entries)
