"""What a motion may fail by where another one would do, so that a search or a batch goes on."""

from __future__ import annotations

from ..runtime.standalone.errors import AssemblyError, SimulationError, SingularJointError

FAILURES = (SimulationError, AssemblyError, SingularJointError)
"""Anything else is an error of the caller's."""

__all__ = ["FAILURES"]
