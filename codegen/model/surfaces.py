"""Functions of the place of a point whose zeros are surfaces: themselves and their derivatives, as expressions.

They are in the grammar of model files, of parameters and of the point's three coordinates, which have names of their own here:
what a file calls x may be anything else in another file of the same model.
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
"""Names of a point's coordinates in an equation; no name of a file is written so."""

AS_WRITTEN: Final = dict(zip("xyz", COORDINATES, strict=True))
"""Those names, by how a file writes them."""

PAIRS: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Coordinates by which a second derivative is, in the order xx, yy, zz, xy, xz, yz."""

KINKED: Final = ("abs", "sign", "min", "max", "mod", AT_LEAST)


@dataclass(frozen=True, slots=True)
class SurfaceFunction:
    """A function whose zeros are a surface.

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
    """A function with its derivatives, by exact rules.

    Raises
    ------
    ExpressionError
        A number of a derivative is not finite.
    """
    x, y, z = (rate(equation, name) for name in COORDINATES)
    first = (x, y, z)
    return SurfaceFunction(equation, first, tuple(rate(first[i], COORDINATES[j]) for i, j in PAIRS))


def sphere(radius: Expression) -> Expression:
    """The equation of a sphere about the origin, ``(x^2 + y^2 + z^2 - r^2)/2``, whose gradient is the place itself."""
    x, y, z = (Expression(("name", name)) for name in COORDINATES)
    return (x**2 + y**2 + z**2 - radius**2) / 2


def with_coordinates(tree: Tree) -> Tree:
    """A parsed tree with the names of the coordinates for x, y and z."""
    return (
        ("name", AS_WRITTEN[tree[1]]) if tree[0] == "name" and tree[1] in AS_WRITTEN else mapped(tree, with_coordinates)
    )


def as_written(tree: Tree) -> str:
    """The text of an expression with x, y and z as a file writes them."""
    text = str(Expression(tree))
    for written, name in AS_WRITTEN.items():
        text = text.replace(name, written)
    return text


def kink(tree: Tree, linear_tables: frozenset[str] = frozenset()) -> str:
    """What in a parsed equation has a kink, or a jump, where the point moves; empty where nothing has.

    A smooth ``step``, which is written out as of ``min`` and ``max``, has none, nor has a cubic table.
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
    """Whether a coordinate is in a tree, parsed or bound."""
    return any(node[0] == "name" and node[1] in COORDINATES for node in nodes(tree))


def _of_step(tree: Tree) -> Tree | None:
    """Of a written out ``step``, that in its place between 0 and 1 which has no kink; None for anything else."""
    if tree[0] != "*" or tree[1][0] != "**" or tree[1][2] != ("number", 3):
        return None
    s = tree[1][1]
    if s[:2] != ("call", "min") or s[3] != ("number", 1) or s[2][:2] != ("call", "max") or s[2][3] != ("number", 0):
        return None
    inner: Tree = s[2][2]
    return inner
