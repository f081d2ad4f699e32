"""Equations of conditions on points as blocks write them: expressions of the point's coordinates and of numbered parts.

The largest parts of an equation, and of its derivatives, without a coordinate are constants of the loop, found with those of its
faces; loops whose equations differ in these only share their code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...model.expressions import Expression, Tree
from ...model.rates import derivative
from ...model.surfaces import SurfaceFunction, depends


@dataclass(frozen=True, slots=True)
class SurfaceForm:
    """An equation, with parts by number in the place of what no coordinate is in.

    Attributes
    ----------
    value : Tree
    gradient : tuple of three Tree
    hessian : tuple of six Tree
        xx, yy, zz, xy, xz, yz.
    by_part : tuple of (int, Tree)
        Its derivatives by those parts that parameters are in.
    """

    value: Tree
    gradient: tuple[Tree, ...]
    hessian: tuple[Tree, ...]
    by_part: tuple[tuple[int, Tree], ...]


def part_name(i: int) -> str:
    """What a part is called in a form; no name of a model is written so."""
    return f"<{i}>"


def forms_of(functions: Sequence[SurfaceFunction]) -> tuple[tuple[SurfaceForm, ...], tuple[Expression, ...]]:
    """The forms of some equations, and their parts."""
    parts: list[Tree] = []
    found = []
    for f in functions:
        value = _split(f.value.tree, parts)
        own = [i for i, part in enumerate(parts) if Expression(part).names]
        gradient, hessian = (tuple(_split(e.tree, parts) for e in those) for those in (f.gradient, f.hessian))
        by_part = tuple((i, derivative(value, part_name(i))) for i in own)
        found.append(SurfaceForm(value, gradient, hessian, tuple((i, d) for i, d in by_part if d != ("number", 0))))
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
    if kind == "call":
        return (kind, tree[1], *(_split(a, parts) for a in tree[2:]))
    if kind == "**" and tree[2][0] == "number":
        return (kind, _split(tree[1], parts), tree[2])
    return (kind, *(_split(a, parts) for a in tree[1:]))
