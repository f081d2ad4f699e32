"""Numerical analysis of closed loops: finds the loops, closes them, and chooses dependent coordinates."""

from .assembling import initial_configuration
from .description import describe
from .ears import Ear, Partition
from .errors import AssemblyError, PartitionError
from .partition import partition
from .velocities import complete_speeds

__all__ = [
    "AssemblyError",
    "Ear",
    "Partition",
    "PartitionError",
    "complete_speeds",
    "describe",
    "initial_configuration",
    "partition",
]
