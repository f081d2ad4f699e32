"""The list of available targets."""

from __future__ import annotations

from .c import C
from .numpy import NUMPY
from .numpy.module import write_numpy
from .target import Target

TARGETS: dict[str, Target] = {t.name: t for t in (C, NUMPY)}

RESERVED = frozenset[str]().union(*(t.reserved for t in TARGETS.values()), ("number", "status"))
"""Names that variables of no target may have, because generated tables and types use them."""

BESIDE_C = {"_numpy.py": write_numpy}
"""Files that are written with the C file: their endings, and the functions that write them."""

__all__ = ["BESIDE_C", "RESERVED", "TARGETS"]
