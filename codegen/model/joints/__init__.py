"""The types of joints, a file each: a new one is a class that is listed here."""

from __future__ import annotations

from typing import Final

from .cylindrical import Cylindrical
from .fixed import Fixed
from .free import Free
from .inline import Inline
from .joint_type import Closure, JointType
from .planar import Planar
from .prismatic import Prismatic
from .revolute import Revolute
from .screw import Screw
from .spherical import Spherical
from .universal import Universal

__all__ = ["JOINTS", "Closure", "JointType"]

_TYPES: Final[tuple[type[JointType], ...]] = (
    *(Fixed, Revolute, Prismatic, Universal, Spherical, Free),
    *(Screw, Cylindrical, Planar, Inline),
)

JOINTS: Final[dict[str, type[JointType]]] = {kind.name: kind for kind in _TYPES}
"""By name, in the order in which messages list them."""
