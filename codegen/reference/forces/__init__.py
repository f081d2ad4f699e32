"""What force elements do, a file for each type but one for all laws along a line; the engines go over elements and know none."""

from __future__ import annotations

from typing import Any, Final

from ...model.forces import (
    ALONG_LINES,
    Bushing,
    Force,
    ForceElement,
    JointForce,
    JointLoad,
    Spring,
    Torque,
    Torsion,
)
from .along_line import AlongLineLaw
from .bushing import BushingLaw
from .force import ForceLaw
from .joint_force import JointForceLaw
from .joint_load import JointLoadLaw
from .law import End, Law, Wrench
from .spring import SpringLaw
from .torque import TorqueLaw
from .torsion import TorsionLaw

__all__ = ["LAWS", "End", "Law", "Wrench"]

LAWS: Final[dict[type[ForceElement], Law[Any]]] = {
    JointForce: JointForceLaw(),
    JointLoad: JointLoadLaw(),
    Spring: SpringLaw(),
    Force: ForceLaw(),
    Torque: TorqueLaw(),
    Torsion: TorsionLaw(),
    Bushing: BushingLaw(),
    **dict.fromkeys(ALONG_LINES.values(), AlongLineLaw()),
}
"""By the class of the element."""
