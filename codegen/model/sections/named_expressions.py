"""Named expressions, which several entries use. The expression replaces its name wherever the name occurs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from ..entries import ZERO
from ..expressions import Expression
from ..grammar import ExpressionError
from ..parts import Instance
from ..reading import Reader

MAX_SIZE: Final = 20_000
"""Largest number of names and operations in an expression, after named expressions have been inserted."""


def read_named_expressions(reader: Reader) -> list[tuple[Instance, Expression]]:
    """Read the section; expressions that are read later may contain the names. Named expressions are checked when all
    names are known."""
    found = []
    for at in reader.section("expressions"):
        name = reader.key_name(at, "expression", "value")
        expression = reader.parsed(at, (), at.value)
        if name is None or expression is None:
            continue
        local = at.part.written(name)
        try:
            tree = at.part.bound(expression, at.indices).tree
        except ExpressionError as error:
            reader.report(at, (), error.message, inside=error.column)
            continue
        if _size(tree, MAX_SIZE) > MAX_SIZE:
            message = (
                f"with the named expressions inserted it has more than {MAX_SIZE} names and operations; "
                f"each use of a name inserts its whole expression, so use such names less often"
            )
            reader.report(at, (), message)
            continue
        at.part.stands_for(local, tree)
        dimension = reader.dimension(expression, at, ())
        if dimension is not None:
            at.part.dimensions[local] = dimension
        found.append((at, expression))
    return found


def check_named_expressions(reader: Reader, found: list[tuple[Instance, Expression]]) -> None:
    """Report unknown names in the named expressions, once coordinates and points are known."""
    for at, expression in found:
        before = reader.errors
        reader.bound(expression, at, (), "measured")
        if reader.errors > before:
            at.part.stands_for(reader.local_name(at), ZERO.tree)  # the error in this name has already been reported


def warn_of_unused(reader: Reader, what: str, found: Iterable[Instance]) -> None:
    """Warn of expressions or tables that are not used."""
    for at in found:
        name = reader.local_name(at)
        if name not in at.part.used_names:
            reader.report(at, (), f"{what} {name!r} is not used", key=True, severity="warning")


def _size(tree: Any, most: int) -> int:
    """Number of nodes of a tree, counted up to `most` and not much further."""
    count, waiting = 0, [tree]
    while waiting and count <= most:
        node = waiting.pop()
        count += 1
        waiting.extend(a for a in node[1:] if isinstance(a, tuple))
    return count
