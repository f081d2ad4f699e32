"""The types of force elements, a file each: a new one is an entry, the element that it makes, and a place in this list.

What it does stands in `reference.forces` and in the generator.
"""

from __future__ import annotations

from typing import Final

from .actuator import Actuator, ActuatorEntry
from .force import Force, ForceOnBodyEntry
from .force_element import ForceElement, ForceEntry
from .joint_force import JointForce, JointForceEntry
from .spring import Spring, SpringEntry
from .torque import Torque, TorqueEntry
from .torsion import Torsion, TorsionEntry

__all__ = [
    "FORCES",
    "OTHER_WORDS",
    "Actuator",
    "Force",
    "ForceElement",
    "ForceEntry",
    "JointForce",
    "Spring",
    "Torque",
    "Torsion",
]

FORCES: Final[tuple[type[ForceEntry], ...]] = (
    JointForceEntry,
    SpringEntry,
    ForceOnBodyEntry,
    TorqueEntry,
    TorsionEntry,
    ActuatorEntry,
)

OTHER_WORDS: Final = {
    "body": "force",
    "point": "force",
    "wrench": "force",
    "moment": "torque",
    "damper": "spring",
    "motor": "joint",
}
"""What some call them elsewhere, and what they are called here."""
