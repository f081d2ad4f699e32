"""Errors that a motion may raise while another motion succeeds; a search or a batch continues after them."""

from __future__ import annotations

from ..runtime.standalone.errors import AssemblyError, SimulationError, SingularJointError

FAILURES = (SimulationError, AssemblyError, SingularJointError)
"""Any other error is the caller's."""

__all__ = ["FAILURES"]
