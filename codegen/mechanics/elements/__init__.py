"""Force elements between bodies, a file for each type: what they do, by the class of the element."""

from __future__ import annotations

from typing import Final

from ...model.forces import ForceElement, Spring
from .element import Law
from .spring import SpringLaw

__all__ = ["LAWS"]

LAWS: Final[dict[type[ForceElement], Law]] = {Spring: SpringLaw()}
"""Of every type that acts on bodies."""
