"""What a force element does, for both engines: forces and torques at its ends, on speeds, and its potential energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from ...model.forces import ForceElement
from ..pairs import Pair, Pairs

E = TypeVar("E", bound=ForceElement)


@dataclass(slots=True)
class End:
    """A point of a body, or a face, at a state, in the ground frame.

    Attributes
    ----------
    x, v : Pair
        Position, m, and velocity, (3, 1).
    R : Pair
        Components of the body, or of the face, into ground components, (3, 3).
    omega : Pair
        Angular velocity of the body, (3, 1).
    line : Pair or None
        Of the first end: the direction of the line to the second one where that is always the same, but for its sign.
    """

    x: Pair
    v: Pair
    R: Pair
    omega: Pair
    line: Pair | None = None


@dataclass(slots=True)
class Wrench:
    """What acts on a body at an end, in the ground frame: a force through the point, N, and a torque, N m; (3, 1)."""

    force: Pair | None = None
    torque: Pair | None = None


def line(element: ForceElement, pairs: Pairs, ends: Sequence[End]) -> tuple[Pair, Pair]:
    """The unit vector from the first end to the second, (3, 1), and the distance.

    Raises
    ------
    ValueError
        The ends coincide.
    """
    start, end = ends
    r = end.x - start.x
    length = pairs.dot(r if start.line is None else start.line, r)  # what is across a line that stays is rounding
    if length.value == 0:
        raise ValueError(f"{element.type} {element.name}: its two points coincide, so its force has no direction")
    if start.line is None:
        return pairs.unit(r), pairs.call("sqrt", length)
    return start.line * pairs.call("sign", length), pairs.call("abs", length)


class Law(Generic[E]):
    """The law of a type of force elements; every result with its derivatives.

    Parameters of all methods are the element, what evaluates its expressions at the state, and its ends.
    """

    def wrenches(self, element: E, pairs: Pairs, ends: Sequence[End]) -> Sequence[Wrench]:
        """What acts on the bodies, end by end."""
        return [Wrench() for _ in ends]

    def on_speeds(self, element: E, pairs: Pairs) -> dict[int, Pair]:
        """Generalised forces on the speeds of joints, (f, 1) by body."""
        return {}

    def energy(self, element: E, pairs: Pairs, ends: Sequence[End]) -> Pair | None:
        """Potential energy, a number, J; None where there is none."""
        return None
