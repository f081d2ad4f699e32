"""Directions along which a motion has no derivative from some time on, though it goes on itself: where, and why, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.non_finite import culprit
from .problem import Segment
from .switches import switch_words

INFINITE, RESTS, JUMPS, PASSES = range(4)
"""As ``motion.h`` numbers the reasons."""


def why_lost(
    segment: Segment, why: int, which: int, state: Mapping[str, Any], entries: Sequence[str], names: Sequence[str]
) -> str:
    """The warning for a place where the directions of these names are lost; `entries` are names of those of the state."""
    if why == RESTS:
        place = switch_words(segment.opened.manifest, which)
        reason = f"the motion stays where {place} changes its branch, and the branches differ"
    elif why == PASSES:
        place = switch_words(segment.opened.manifest, which)
        reason = f"the motion passes {place}, and the value or its derivatives jump there or grow without bounds"
    elif why == JUMPS:
        reason = (
            f"the rate of {entries[which]} jumps there at no switch that is known, as where the ends of a spring meet or "
            f"both arguments of atan2 are zero"
        )
    else:
        found = culprit(segment.opened, state, along=True)
        reason = f"those of the rates are not finite{f': {found}' if found else ''}"
    return f"from t = {state['t']:.9g} s on derivatives of the motion by {', '.join(names)} do not exist and are NaN: {reason}"


def lost_names(derivatives: Array, known: set[str], names: Sequence[str]) -> list[str]:
    """Names of directions (k, n) that are NaN in a row, but for those that are known to be lost."""
    gone = np.flatnonzero(np.isnan(derivatives).any(axis=1)).tolist()
    return [names[i] for i in gone if names[i] not in known]
