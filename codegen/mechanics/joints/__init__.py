"""Joints of links, one file each. To add a joint, write a class and list it here.

The joint of a body is a chain of motions (`model.joints`). It becomes one or more links, whose joints are parts of that chain.
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
"""Joint classes, longest chain first: each link takes the longest part of the body's chain that one class can
represent."""
