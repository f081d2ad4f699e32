"""Equations of conditions on points as blocks write them: expressions of the point's coordinates and of numbered parts.

The largest parts of an equation, and of its derivatives, without a coordinate are constants of the loop, found with those of its
faces; loops whose equations differ in these only share their code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...model.expressions import Expression
from ...model.grammar import Tree
from ...model.rates import rate
from ...model.surfaces import SurfaceFunction, depends
from ...model.trees import mapped


@dataclass(frozen=True, slots=True)
class SurfaceForm(SurfaceFunction):
    """An equation, with parts by number in the place of what no coordinate is in.

    Attributes
    ----------
    by_part : tuple of (int, Expression)
        Its derivatives by those parts that parameters are in.
    """

    by_part: tuple[tuple[int, Expression], ...]


def part_name(i: int) -> str:
    """What a part is called in a form; no name of a model is written so."""
    return f"<{i}>"


def part_number(name: str) -> int:
    """Which part a name of a form is."""
    return int(name[1:-1])


def forms_of(functions: Sequence[SurfaceFunction]) -> tuple[tuple[SurfaceForm, ...], tuple[Expression, ...]]:
    """The forms of some equations, and their parts."""
    parts: list[Tree] = []

    def split(e: Expression) -> Expression:
        return Expression(_split(e.tree, parts))

    found = []
    for f in functions:
        value = split(f.value)
        own = [i for i, part in enumerate(parts) if Expression(part).names]
        x, y, z = map(split, f.gradient)
        hessian = tuple(map(split, f.hessian))
        by_part = ((i, rate(value, part_name(i))) for i in own)
        found.append(
            SurfaceForm(value, (x, y, z), hessian, tuple((i, d) for i, d in by_part if d.tree != ("number", 0)))
        )
    return tuple(found), tuple(map(Expression, parts))


def _split(tree: Tree, parts: list[Tree]) -> Tree:
    """An expression with the name of a part where no coordinate is; numbers that structure depends on stay."""
    kind = tree[0]
    if kind == "number" and tree[1] in (0, 1, -1, 2):
        return tree
    if not depends(tree):
        if tree not in parts:
            parts.append(tree)
        return ("name", part_name(parts.index(tree)))
    if kind == "name":
        return tree
    if kind == "**" and tree[2][0] == "number":
        return (kind, _split(tree[1], parts), tree[2])
    return mapped(tree, lambda part: _split(part, parts))
