"""Functions of a point's position whose zeros are surfaces, with their derivatives, as expressions.

They are expressions of parameters and of the point's three coordinates, which have special names here: the names x, y
and z may have other meanings in another file of the same model.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from .expressions import Expression
from .grammar import AT_LEAST, Tree
from .rates import rate
from .trees import mapped, nodes, parts

COORDINATES: Final = ("<x>", "<y>", "<z>")
"""Names of a point's coordinates in an equation; no name in a file has this form."""

AS_WRITTEN: Final = dict(zip("xyz", COORDINATES, strict=True))
"""`COORDINATES` by the names x, y and z that a file uses."""

PAIRS: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Pairs of coordinates of the second derivatives, in the order xx, yy, zz, xy, xz, yz."""

KINKED: Final = ("abs", "sign", "min", "max", "mod", AT_LEAST)


@dataclass(frozen=True, slots=True)
class SurfaceFunction:
    """A function whose zeros form a surface.

    Attributes
    ----------
    value : Expression
    gradient : tuple of three Expression
    hessian : tuple of six Expression
        xx, yy, zz, xy, xz, yz.
    """

    value: Expression
    gradient: tuple[Expression, Expression, Expression]
    hessian: tuple[Expression, ...]


@lru_cache(maxsize=4096)
def surface_function(equation: Expression) -> SurfaceFunction:
    """A function with its exact derivatives.

    Raises
    ------
    ExpressionError
        If a number in a derivative is not finite.
    """
    x, y, z = (rate(equation, name) for name in COORDINATES)
    first = (x, y, z)
    return SurfaceFunction(equation, first, tuple(rate(first[i], COORDINATES[j]) for i, j in PAIRS))


def sphere(radius: Expression) -> Expression:
    """The equation of a sphere about the origin, ``(x^2 + y^2 + z^2 - r^2)/2``; its gradient is the position vector."""
    x, y, z = (Expression(("name", name)) for name in COORDINATES)
    return (x**2 + y**2 + z**2 - radius**2) / 2


def with_coordinates(tree: Tree) -> Tree:
    """A parsed tree with the names of the coordinates in place of x, y and z."""
    return (
        ("name", AS_WRITTEN[tree[1]]) if tree[0] == "name" and tree[1] in AS_WRITTEN else mapped(tree, with_coordinates)
    )


def as_written(tree: Tree) -> str:
    """The text of an expression with x, y and z as in a file."""
    text = str(Expression(tree))
    for written, name in AS_WRITTEN.items():
        text = text.replace(name, written)
    return text


def kink(tree: Tree, linear_tables: frozenset[str] = frozenset()) -> str:
    """Part of a parsed equation with a kink or a jump where the point moves; empty if there is none.

    A smooth ``step``, although written with ``min`` and ``max``, has no kink, nor has a cubic table.
    """
    inner = _of_step(tree)
    if inner is not None:
        return kink(inner, linear_tables)
    if tree[0] == "indexed" and tree[1] in linear_tables and depends(tree):
        return f"the linear table {tree[1]!r}"
    if tree[0] == "call" and tree[1] in KINKED and depends(tree):
        return "a comparison" if tree[1] == AT_LEAST else repr(tree[1])
    return next(filter(None, (kink(a, linear_tables) for a in parts(tree))), "")


def depends(tree: Tree) -> bool:
    """Whether a parsed or bound tree contains a coordinate."""
    return any(node[0] == "name" and node[1] in COORDINATES for node in nodes(tree))


def _of_step(tree: Tree) -> Tree | None:
    """The argument of a ``step`` that has been written with ``min`` and ``max``; None for any other tree."""
    if tree[0] != "*" or tree[1][0] != "**" or tree[1][2] != ("number", 3):
        return None
    s = tree[1][1]
    if s[:2] != ("call", "min") or s[3] != ("number", 1) or s[2][:2] != ("call", "max") or s[2][3] != ("number", 0):
        return None
    inner: Tree = s[2][2]
    return inner
