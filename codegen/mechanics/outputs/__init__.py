"""Measures for outputs: energies, points, rotations, formulas. To add a measure, write a file with the statements and
list the measure here."""

from __future__ import annotations

from typing import Final

from .angular_velocity import ANGULAR_VELOCITY
from .center_of_mass import CENTER_OF_MASS
from .measure import DrivingMeasure, EnergyMeasure, FormulaMeasure, Measure, RecordMeasure
from .momentum import MOMENTUM
from .points import ACCELERATION, DISTANCE, POSITION, VELOCITY
from .rotation import ROTATION

__all__ = ["MEASURES", "DrivingMeasure", "EnergyMeasure", "FormulaMeasure", "Measure", "RecordMeasure"]

MEASURES: Final[dict[str, Measure]] = {
    "position": POSITION,
    "velocity": VELOCITY,
    "rotation": ROTATION,
    "angular_velocity": ANGULAR_VELOCITY,
    "acceleration": ACCELERATION,
    "center_of_mass": CENTER_OF_MASS,
    "momentum": MOMENTUM,
    "distance": DISTANCE,
    "relative_position": POSITION,
    "relative_velocity": VELOCITY,
    "driving_force": DrivingMeasure(),
    "value": FormulaMeasure(),
    "kinetic_energy": EnergyMeasure(0),
    "potential_energy": EnergyMeasure(1),
}
"""Measures of outputs, by their names in `codegen.model.outputs.MEASURES`."""
