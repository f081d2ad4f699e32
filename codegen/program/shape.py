"""Constants of links, loops and force elements that depend on design parameters, grouped by the form of their expressions."""

from __future__ import annotations

from ..records import dataclass
from .algebra import Expr
from .block import Block


@dataclass(slots=True, eq=False)
class Shape:
    """The form that the constants of several links share.

    Attributes
    ----------
    index : int
    parameters : int
        Number of design parameters.
    block : Block
        Computes the constants that depend on parameters, and their derivatives: components ``r.x`` and ``r.x/0`` of `SHAPE`.
    fields : dict of str to Expr
        Every constant; 0 where it is structurally zero.
    varying : dict of str to str
        Fields that depend on parameters, and the first field of equal value.
    fixed : dict of str to Expr
        Fields and primitives that are known numbers.
    """

    index: int
    parameters: int
    block: Block
    fields: dict[str, Expr]
    varying: dict[str, str]
    fixed: dict[str, Expr]


@dataclass(slots=True, eq=False)
class Constants:
    """The constants of links with the same expressions.

    Attributes
    ----------
    shape : Shape
    parameters : tuple of str
    numbers : tuple of float
        Numbers for the shape's slots.
    values : dict of str to float
        Constants that do not depend on parameters and are not structurally zero.
    index : int
    """

    shape: Shape
    parameters: tuple[str, ...]
    numbers: tuple[float, ...]
    values: dict[str, float]
    index: int
