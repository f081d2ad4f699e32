"""The list of available targets."""

from __future__ import annotations

from .c import C
from .numpy import NUMPY
from .numpy.module import write_numpy
from .target import Target

TARGETS: dict[str, Target] = {t.name: t for t in (C, NUMPY)}

RESERVED = frozenset[str]().union(*(t.reserved for t in TARGETS.values()), ("number", "status"))
"""Names that no target may use for variables, or that generated tables and types have; all targets use the same names."""

BESIDE_C = {"_numpy.py": write_numpy}
"""Files besides the C file: endings, and the functions that write these files."""

__all__ = ["BESIDE_C", "RESERVED", "TARGETS"]
