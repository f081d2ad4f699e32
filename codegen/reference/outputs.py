"""The values of outputs, for both engines; their derivatives are those of pairs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from ..model.outputs import Output
from ..model.places import Point
from .pairs import Pair, Pairs


class Seen(Protocol):
    """A model at a state, as an engine sees it."""

    @property
    def pairs(self) -> Pairs:
        """Evaluates expressions at the state."""

    def point(self, point: Point) -> tuple[Pair, Pair]:
        """Position, m, and velocity of a point in the ground frame, (3, 1)."""

    def energies(self) -> tuple[Pair, Pair]:
        """Kinetic and potential energy, J, numbers."""


def position(output: Output, seen: Seen) -> Pair:
    """n . x"""
    (point,) = output.points
    return _along(output, seen, seen.point(point)[0])


def velocity(output: Output, seen: Seen) -> Pair:
    """n . v"""
    (point,) = output.points
    return _along(output, seen, seen.point(point)[1])


def value(output: Output, seen: Seen) -> Pair:
    assert output.expression is not None
    return seen.pairs.expression(output.expression)


def kinetic_energy(output: Output, seen: Seen) -> Pair:
    return seen.energies()[0]


def potential_energy(output: Output, seen: Seen) -> Pair:
    return seen.energies()[1]


def _along(output: Output, seen: Seen, v: Pair) -> Pair:
    assert output.axis is not None
    return seen.pairs.dot(seen.pairs.unit(seen.pairs.vector(output.axis)), v)


VALUES: Final[dict[str, Callable[[Output, Seen], Pair]]] = {
    function.__name__: function for function in (position, velocity, value, kinetic_energy, potential_energy)
}
"""By the name of the measure."""
