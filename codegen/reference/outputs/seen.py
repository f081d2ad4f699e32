"""What outputs see of a model: both engines show it, each in its own way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from ...model.outputs import Output
from ...model.places import Point
from ..pairs import Pair, Pairs


@dataclass(frozen=True, slots=True)
class Moving:
    """A body with its mass, in the ground frame.

    Attributes
    ----------
    mass : Pair
        A number, kg.
    x, v : Pair
        Position, m, and velocity of the mass centre, (3, 1).
    spin : Pair
        Angular momentum about the mass centre, (3, 1).
    """

    mass: Pair
    x: Pair
    v: Pair
    spin: Pair


class Seen(Protocol):
    """A model at a state, as an engine sees it."""

    @property
    def pairs(self) -> Pairs:
        """Evaluates expressions at the state."""

    def point(self, point: Point) -> tuple[Pair, Pair]:
        """Position, m, and velocity of a point in the ground frame, (3, 1)."""

    def acceleration(self, point: Point) -> Pair:
        """Acceleration of a point against the ground, (3, 1)."""

    def attitude(self, body: int) -> tuple[Pair, Pair]:
        """Body components into ground components, (3, 3), and angular velocity in the ground frame, (3, 1)."""

    def energies(self) -> tuple[Pair, Pair]:
        """Kinetic and potential energy, J, numbers."""

    def driving_force(self, name: str) -> Pair:
        """The generalised force that a prescribed coordinate takes, a number, N m or N."""

    def bodies(self) -> Sequence[Moving]:
        """All bodies, in the order of the model."""


def along(output: Output, seen: Seen, v: Pair) -> Pair:
    """The component of a vector along the output's axis."""
    assert output.axis is not None
    return seen.pairs.dot(seen.pairs.unit(seen.pairs.vector(output.axis)), v)
