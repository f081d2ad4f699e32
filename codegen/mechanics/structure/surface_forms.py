"""Equations of conditions on points, written with the point's coordinates and numbered parts.

The largest subexpressions of an equation, and of its derivatives, that contain no coordinate are constants of the loop, like
those of its faces. Loops whose equations differ only in these constants share their code.
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
    """An equation whose subexpressions without coordinates are replaced by numbered parts.

    Attributes
    ----------
    by_part : tuple of (int, Expression)
        Derivatives of the equation with respect to parts that contain parameters, each with the number of the part.
    """

    by_part: tuple[tuple[int, Expression], ...]


def part_name(i: int) -> str:
    """Name of a part in a form; it cannot be a name of the model."""
    return f"<{i}>"


def part_number(name: str) -> int:
    """Number of the part that a name refers to."""
    return int(name[1:-1])


def forms_of(functions: Sequence[SurfaceFunction]) -> tuple[tuple[SurfaceForm, ...], tuple[Expression, ...]]:
    """The forms of some equations, and the parts that they contain."""
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
