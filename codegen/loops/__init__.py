"""Closed loops before any symbol: where they are, how they close, which coordinates depend on which. Floats only."""

from .assembling import assemble, complete_speeds, initial_configuration
from .closure import closure, closure_matrix
from .errors import AssemblyError, PartitionError
from .partition import Ear, Partition, describe, partition

__all__ = [
    "AssemblyError",
    "Ear",
    "Partition",
    "PartitionError",
    "assemble",
    "closure",
    "closure_matrix",
    "complete_speeds",
    "describe",
    "initial_configuration",
    "partition",
]
