"""The conditions on points that close loops: a new one is a class here that is listed at the end."""

from __future__ import annotations

from typing import ClassVar, Final

from .entries import Entry, Expr
from .joints import Closure


class ConditionType(Entry):
    """A condition on where the origin of the face `to` is in the face `from`: an equation, or two, of its coordinates there.

    It stands where a loop has its joint. A subclass has a field for each key of the file, and these facts.

    Attributes
    ----------
    name : str
        The value of the key ``type``.
    closure : Closure
        How many conditions it sets; all are linear ones.
    equation_keys : tuple of tuple of (str or int)
        Paths of the equations, expressions of the coordinates, in an entry.
    length_key : str
        Of a distance: the key of the length. Empty for others.
    """

    name: ClassVar[str] = ""
    synonyms: ClassVar[tuple[str, ...]] = ()
    closure: ClassVar[Closure]
    equation_keys: ClassVar[tuple[tuple[str | int, ...], ...]] = ()
    length_key: ClassVar[str] = ""
    axis_keys: ClassVar[tuple[tuple[str | int, ...], ...]] = ()

    type: str


class Distance(ConditionType):
    """The two points keep a distance."""

    name = "distance"
    closure = Closure(linear=1, angular=0)
    length_key = "length"

    length: Expr


class Surface(ConditionType):
    """The origin of `end` stays where a function of its coordinates in the face `start` is zero."""

    name = "surface"
    closure = Closure(linear=1, angular=0)
    equation_keys = (("equation",),)

    equation: Expr


class Curve(ConditionType):
    """The origin of `end` stays where two functions of its coordinates in the face `start` are zero."""

    name = "curve"
    closure = Closure(linear=2, angular=0)
    equation_keys = (("equations", 0), ("equations", 1))

    equations: tuple[Expr, Expr]


CONDITIONS: Final[dict[str, type[ConditionType]]] = {kind.name: kind for kind in (Distance, Surface, Curve)}
"""By name, in the order in which messages list them."""
