"""Errors that a motion may raise while other motions succeed; after such an error, a search or a batch continues."""

from __future__ import annotations

from ..runtime.standalone.errors import AssemblyError, SimulationError, SingularJointError

FAILURES = (SimulationError, AssemblyError, SingularJointError)
"""Errors of single motions; any other error is a mistake of the caller."""

__all__ = ["FAILURES"]
