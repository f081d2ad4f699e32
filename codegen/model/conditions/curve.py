"""A point on a curve."""

from __future__ import annotations

from ..entries import Expr
from ..joints import Closure
from .condition_type import ConditionType


class Curve(ConditionType):
    """The origin of `end` stays where two functions of its coordinates in the face `start` are zero."""

    name = "curve"
    closure = Closure(linear=2, angular=0)
    equation_keys = (("equations", 0), ("equations", 1))

    equations: tuple[Expr, Expr]
