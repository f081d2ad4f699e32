"""The values of outputs, for both engines; their derivatives are those of pairs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from ...model.outputs import Output
from ..pairs import Pair
from .acceleration import acceleration
from .angular_velocity import angular_velocity
from .center_of_mass import center_of_mass
from .distance import distance
from .driving_force import driving_force
from .momentum import momentum
from .points import position, velocity
from .relative_position import relative_position, relative_velocity
from .rotation import rotation
from .seen import Moving, Seen
from .values import kinetic_energy, potential_energy, value

__all__ = ["VALUES", "Moving", "Seen"]

VALUES: Final[dict[str, Callable[[Output, Seen], Pair]]] = {
    function.__name__: function
    for function in (
        position,
        velocity,
        rotation,
        angular_velocity,
        acceleration,
        center_of_mass,
        momentum,
        distance,
        relative_position,
        relative_velocity,
        driving_force,
        value,
        kinetic_energy,
        potential_energy,
    )
}
"""By the name of the measure."""
