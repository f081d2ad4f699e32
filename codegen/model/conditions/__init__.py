"""The conditions on points that close loops, a file each: a new one is a class that is listed here."""

from __future__ import annotations

from typing import Final

from .condition_type import ConditionType
from .curve import Curve
from .distance import Distance
from .surface import Surface

__all__ = ["CONDITIONS", "ConditionType"]

CONDITIONS: Final[dict[str, type[ConditionType]]] = {kind.name: kind for kind in (Distance, Surface, Curve)}
"""By name, in the order in which messages list them."""
