"""Joints of links, a file each: a new one is a class that is listed here.

The joint of a body is a chain of motions (`model.joints`); it becomes links whose joints are chains of these.
"""

from __future__ import annotations

from typing import Final

from .column import Column
from .cylindrical import Cylindrical
from .driven import DRIVEN_JOINTS
from .free import Free
from .link_joint import LinkJoint
from .prismatic import Prismatic
from .revolute import Revolute
from .screw import Screw
from .slides import Slides
from .spherical import Spherical

__all__ = ["DRIVEN_JOINTS", "LINK_JOINTS", "Column", "LinkJoint"]

LINK_JOINTS: Final[tuple[type[LinkJoint], ...]] = (Free, Cylindrical, Screw, Slides, Spherical, Revolute, Prismatic)
"""The longest chains first: of a body's chain each link takes as much as it can."""
