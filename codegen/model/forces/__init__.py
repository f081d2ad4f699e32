"""The types of force elements, a file each.

A law along the line between two points is a file of `line_laws`, and nothing more. Any other type is an entry here, the
element that it makes, and a place in this list; what it does stands in `reference.forces` and in the generator.
"""

from __future__ import annotations

from typing import Final

from .along_line import ALONG_LINES, ENTRIES, AlongLine
from .along_line import OTHER_WORDS as OTHER_WORDS_OF_LAWS
from .force import Force, ForceOnBodyEntry
from .force_element import ForceElement, ForceEntry
from .joint_force import JointForce, JointForceEntry
from .spring import Spring, SpringEntry
from .torque import Torque, TorqueEntry
from .torsion import Torsion, TorsionEntry

__all__ = [
    "ALONG_LINES",
    "FORCES",
    "OTHER_WORDS",
    "AlongLine",
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
    *ENTRIES,
)

OTHER_WORDS: Final = {
    "body": "force",
    "point": "force",
    "wrench": "force",
    "moment": "torque",
    "damper": "spring",
    "motor": "joint",
    **OTHER_WORDS_OF_LAWS,
}
"""What some call them elsewhere, and what they are called here."""
