"""Force elements between bodies, a file for each type: what they do, by the class of the element."""

from __future__ import annotations

from typing import Final

from ...model.forces import (
    Actuator,
    Force,
    ForceElement,
    Spring,
    Torque,
    Torsion,
)
from .actuator import ActuatorLaw
from .element import Law
from .force import ForceLaw
from .spring import SpringLaw
from .torque import TorqueLaw
from .torsion import TorsionLaw

__all__ = ["LAWS"]

LAWS: Final[dict[type[ForceElement], Law]] = {
    Spring: SpringLaw(),
    Force: ForceLaw(),
    Torque: TorqueLaw(),
    Torsion: TorsionLaw(),
    Actuator: ActuatorLaw(),
}
"""Of every type that acts on bodies."""
