"""A rod without mass."""

from __future__ import annotations

from ..entries import Expr
from ..joints import Closure
from .condition_type import ConditionType


class Distance(ConditionType):
    """The two points keep a distance."""

    name = "distance"
    closure = Closure(linear=1, angular=0)
    length_key = "length"

    length: Expr
