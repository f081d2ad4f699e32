"""Refuses objects that are no solvers."""

from __future__ import annotations

from typing import Any

from ..wording import with_article


def check_given(solver: Any) -> None:
    """Raises TypeError for an object without a method that solvers of all versions have."""
    if not hasattr(solver, "assemble"):
        raise TypeError(f"expected a solver, as ordernm.load returns it, not {with_article(type(solver).__name__)}")
