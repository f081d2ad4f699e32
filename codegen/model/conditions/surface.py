"""A point on a surface."""

from __future__ import annotations

from ..entries import Expr
from ..joints import Closure
from .condition_type import ConditionType


class Surface(ConditionType):
    """The origin of `end` stays where a function of its coordinates in the face `start` is zero."""

    name = "surface"
    closure = Closure(linear=1, angular=0)
    equation_keys = (("equation",),)

    equation: Expr
