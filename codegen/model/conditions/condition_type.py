"""What a condition on a point is that closes a loop: the keys of a model file, and the equations that hold."""

from __future__ import annotations

from typing import ClassVar

from ..entries import Entry
from ..joints import Closure


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
