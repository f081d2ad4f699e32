"""A `pinocchio.Model`: its joints, placements and inertias."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from .mjcf import leave_out_armature
from .naming import free_name
from .placement import Placement, Three
from .robot import WORLD, Coupling, Inertia, Link, Place, Robot, RobotJoint, as_three

_FILE: Final = "pinocchio.Model"
_BASE: Final = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
