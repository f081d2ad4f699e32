"""What force elements do, a file for each type; the engines go over the elements of a model and know none of them."""

from __future__ import annotations

from typing import Any, Final

from ...model.forces import (
    Actuator,
    Force,
    ForceElement,
    JointForce,
    Spring,
    Torque,
    Torsion,
)
from .actuator import ActuatorLaw
from .force import ForceLaw
from .joint_force import JointForceLaw
from .law import End, Law, Wrench
from .spring import SpringLaw
from .torque import TorqueLaw
from .torsion import TorsionLaw

__all__ = ["LAWS", "End", "Law", "Wrench"]

LAWS: Final[dict[type[ForceElement], Law[Any]]] = {
    JointForce: JointForceLaw(),
    Spring: SpringLaw(),
    Force: ForceLaw(),
    Torque: TorqueLaw(),
    Torsion: TorsionLaw(),
    Actuator: ActuatorLaw(),
}
"""By the class of the element."""
