"""The force that prescribed motion takes."""

from __future__ import annotations

from ...model.outputs import Output
from ..pairs import Pair
from .seen import Seen


def driving_force(output: Output, seen: Seen) -> Pair:
    """Of the coordinate that the output names."""
    return seen.driving_force(output.choice[0])
