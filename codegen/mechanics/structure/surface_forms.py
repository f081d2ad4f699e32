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
from .constants import split


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

    def part(constant: Tree) -> Tree:
        if constant not in parts:
            parts.append(constant)
        return ("name", part_name(parts.index(constant)))

    def of(e: Expression) -> Expression:
        return Expression(split(e.tree, lambda inner: not depends(inner), part, lambda coordinate: coordinate))

    found = []
    for f in functions:
        value = of(f.value)
        own = [i for i, part in enumerate(parts) if Expression(part).names]
        x, y, z = map(of, f.gradient)
        hessian = tuple(map(of, f.hessian))
        by_part = ((i, rate(value, part_name(i))) for i in own)
        found.append(
            SurfaceForm(value, (x, y, z), hessian, tuple((i, d) for i, d in by_part if d.tree != ("number", 0)))
        )
    return tuple(found), tuple(map(Expression, parts))
