"""Functions that may change steeply within a small part of a motion, such as ``tanh(u.x/w)`` for a small ``w``.

An integrator must resolve such layers more closely for derivatives of a motion than for the motion itself. The same holds for
the points of cubic tables, where third derivatives jump.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final

from .expressions import Expression
from .grammar import Tree
from .members import PointCondition
from .surfaces import COORDINATES
from .switches import varies_in_motion
from .trees import nodes

if TYPE_CHECKING:
    from .model import Model

EVEN_PACED = ("sin", "cos", "abs", "sign", "at_least")
"""Functions that change no faster than their arguments while their branch is fixed."""

HIGHEST = 3
"""Highest power of a varying number that does not count as steep."""


RATES: Final = 1
"""Bit in the result of `steep_functions`: forces, prescribed motion or surfaces of loops contain steep functions."""

OUTPUTS: Final = 2
"""Bit in the result of `steep_functions`: outputs, which may be integrated, contain steep functions."""


def steep_functions(model: Model) -> int:
    """Which of a model's expressions contain functions that may change steeply during a motion: bits, 0 if none.

    An acceleration contains the second derivatives of a surface, which have kinks at the points of a cubic table.
    """
    varies = varies_in_motion((*model.inputs, *COORDINATES))
    trees = [x.value.tree for x in model.prescribed]
    trees += [e.tree for force in model.elements for e in force.coefficients]
    trees += [e.tree for loop in model.loops if isinstance(loop, PointCondition) for e in loop.equations]
    outputs = [output.expression.tree for output in model.outputs if output.expression is not None]

    def steep(of: Iterable[Tree]) -> bool:
        return any(_is_steep(part, varies) for tree in of for part in nodes(tree))

    return RATES * steep(trees) + OUTPUTS * steep(outputs)


def _is_steep(tree: Tree, varies: Callable[[str], bool]) -> bool:
    """Whether a function of a varying number may change steeply: most functions, quotients, and high or fractional powers."""
    if tree[0] == "call":
        steep = tuple(tree[2:]) if tree[1] not in EVEN_PACED else ()
    elif tree[0] == "/":
        steep = tree[2:]
    elif tree[0] == "**":
        even = tree[2][0] == "number" and float(tree[2][1]) in range(HIGHEST + 1)
        steep = () if even else tree[1:]
    else:
        return False
    return any(varies(name) for of in steep for name in Expression(of).names)


__all__ = ["steep_functions"]
