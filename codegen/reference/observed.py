"""What outputs see of a model at a state of an engine."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ..model.places import Point
from .arguments import State
from .outputs import Moving
from .pairs import Pair, Pairs

if TYPE_CHECKING:
    from .engine import Engine


class Seen:
    """What outputs see of a model: `outputs.Seen`. Accelerations and sums are found when the first output asks."""

    def __init__(self, engine: Engine, state: State, motion: Any) -> None:
        self.engine = engine
        self.state = state
        self.motion = motion

    @property
    def pairs(self) -> Pairs:
        return self.state.pairs

    def point(self, point: Point) -> tuple[Pair, Pair]:
        return self.engine._point(self.motion, point.body, self.pairs.vector(point.at))

    @cached_property
    def _accelerations(self) -> Callable[[int, Pair], Pair]:
        return self.engine._accelerating(self.state, self.motion, self.engine._accelerations(self.state))

    def acceleration(self, point: Point) -> Pair:
        return self._accelerations(point.body, self.pairs.vector(point.at))

    def attitude(self, body: int) -> tuple[Pair, Pair]:
        return self.engine._attitude(self.motion, body)

    @cached_property
    def _bodies(self) -> list[Moving]:
        return self.engine._moving(self.state, self.motion)

    def bodies(self) -> list[Moving]:
        return self._bodies

    @cached_property
    def _driving_forces(self) -> Pair:
        return self.engine._driving_forces(self.state)

    def driving_force(self, name: str) -> Pair:
        return self._driving_forces[self.engine.given.prescribed_names.index(name), 0]

    def energies(self) -> tuple[Pair, Pair]:
        kinetic, potential = self.engine._energies(self.state, self.motion)
        return kinetic[0, 0], potential[0, 0]
