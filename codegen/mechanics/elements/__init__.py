"""Force elements between bodies: one file for each type, and one for all laws along a line. `LAWS` maps elements to laws."""

from __future__ import annotations

from typing import Final

from ...model.forces import (
    ALONG_LINES,
    Bushing,
    Force,
    ForceElement,
    JointLoad,
    Spring,
    Torque,
    Torsion,
)
from .along_line import AlongLineLaw
from .bushing import BushingLaw
from .element import Law
from .joint_load import JointLoadLaw
from .on_body import OnBodyLaw
from .spring import SpringLaw
from .torsion import TorsionLaw

__all__ = ["LAWS"]

LAWS: Final[dict[type[ForceElement], Law]] = {
    Spring: SpringLaw(),
    Force: OnBodyLaw("force"),
    JointLoad: JointLoadLaw(),
    Torque: OnBodyLaw("torque"),
    Torsion: TorsionLaw(),
    Bushing: BushingLaw(),
    **{element: AlongLineLaw(element.law) for element in ALONG_LINES.values()},
}
"""The force law of every type of element that acts on bodies."""
