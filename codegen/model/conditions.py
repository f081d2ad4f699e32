"""Conditions on points that close loops; a new one is a class here, listed at the end."""

from __future__ import annotations

from typing import ClassVar, Final

from .entries import Entry, Expr
from .joints import Closure


class ConditionType(Entry):
    """A condition on the position of the face `to`'s origin in the face `from`: one or two equations in its coordinates.

    It takes the place of a loop joint. A subclass has a field for each key of the file, and the following class attributes.

    Attributes
    ----------
    name : str
        The value of the key ``type``.
    closure : Closure
        Number of its conditions, all of them linear.
    equation_keys : tuple of tuple of (str or int)
        Paths of the equations in an entry; each equation is an expression of the coordinates.
    length_key : str
        Key of the length of a distance; empty for other types.
    """

    name: ClassVar[str] = ""
    synonyms: ClassVar[tuple[str, ...]] = ()
    closure: ClassVar[Closure]
    equation_keys: ClassVar[tuple[tuple[str | int, ...], ...]] = ()
    length_key: ClassVar[str] = ""
    axis_keys: ClassVar[tuple[tuple[str | int, ...], ...]] = ()

    type: str


class Distance(ConditionType):
    """Keeps the distance between the origins of the two faces."""

    name = "distance"
    closure = Closure(linear=1, angular=0)
    length_key = "length"

    length: Expr


class Surface(ConditionType):
    """Keeps the origin of `end` where a function of its coordinates in the face `start` is zero."""

    name = "surface"
    closure = Closure(linear=1, angular=0)
    equation_keys = (("equation",),)

    equation: Expr


class Curve(ConditionType):
    """Keeps the origin of `end` where two functions of its coordinates in the face `start` are zero."""

    name = "curve"
    closure = Closure(linear=2, angular=0)
    equation_keys = (("equations", 0), ("equations", 1))

    equations: tuple[Expr, Expr]


CONDITIONS: Final[dict[str, type[ConditionType]]] = {kind.name: kind for kind in (Distance, Surface, Curve)}
"""Types of conditions by name, in the order in which messages list the types."""
