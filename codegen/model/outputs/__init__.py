"""The types of outputs: a new one is a class here, a value in `reference.outputs`, statements in `mechanics.outputs`."""

from __future__ import annotations

from typing import Final

from .acceleration import Acceleration
from .angular_velocity import AngularVelocity
from .center_of_mass import CenterOfMass
from .distance import Distance
from .driving_force import DrivingForce
from .energies import KineticEnergy, PotentialEnergy
from .momentum import Momentum
from .output import Measure, Output
from .points import Position, Velocity
from .relative_position import RelativePosition, RelativeVelocity
from .rotation import Rotation
from .value import Value

__all__ = ["MEASURES", "Measure", "Output"]

MEASURES: Final[dict[str, type[Measure]]] = {
    kind.name: kind
    for kind in (
        Position,
        Velocity,
        Rotation,
        AngularVelocity,
        Acceleration,
        CenterOfMass,
        Momentum,
        Distance,
        RelativePosition,
        RelativeVelocity,
        DrivingForce,
        Value,
        KineticEnergy,
        PotentialEnergy,
    )
}
"""By name, in the order in which messages list them."""
