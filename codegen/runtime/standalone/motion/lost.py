"""Warnings about directions along which a motion has no derivative after a time, although the motion itself continues."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.non_finite import culprit
from .results import Segment
from .switches import switch_words

INFINITE, RESTS, JUMPS, PASSES, BEGINS, BENDS, SAMPLED = range(7)
"""Reasons for the loss of a direction, numbered as in ``motion.h``."""


def why_lost(
    segment: Segment, why: int, which: int, state: Mapping[str, Any], entries: Sequence[str], names: Sequence[str]
) -> str:
    """The warning for the loss of the directions `names`; `entries` are the names of the state's entries."""
    if why == SAMPLED:
        place = switch_words(segment.opened.manifest, which)
        return (
            f"at t = {state['t']:.9g} s, exactly where {place} changes its branch, derivatives of results with respect to "
            f"{', '.join(names)} are those of one side if they jump there"
        )
    if why == RESTS:
        place = switch_words(segment.opened.manifest, which)
        reason = f"the motion stays at {place}, where the branch changes, and motions on the two branches differ"
    elif why == BEGINS:
        place = switch_words(segment.opened.manifest, which)
        reason = f"the motion begins where {place} jumps, and motions that begin beside it differ"
    elif why == BENDS:
        place = switch_words(segment.opened.manifest, which)
        reason = f"the motion reaches {place} exactly at a knot of the inputs, and motions that pass it beside the knot differ"
    elif why == PASSES:
        place = switch_words(segment.opened.manifest, which)
        reason = f"the motion passes {place}, where the value or its derivatives jump or are unbounded"
    elif why == JUMPS:
        reason = (
            f"the rate of {entries[which]} jumps there without a known switch, for example because the ends of a spring meet or "
            f"both arguments of atan2 are zero"
        )
    else:
        found = culprit(segment.opened, state, along=True)
        reason = f"derivatives of the rates are not finite{f': {found}' if found else ''}"
    lost = "do not exist and are NaN" if why in (RESTS, BEGINS, BENDS) else "may not exist and are NaN"
    return (
        f"from t = {state['t']:.9g} s on, derivatives of the motion with respect to {', '.join(names)} {lost}: {reason}"
    )


def lost_names(derivatives: Array, known: set[str], names: Sequence[str]) -> list[str]:
    """Names of the directions, rows of `derivatives` (k, n), that have NaN entries; names in `known` are left out."""
    gone = np.flatnonzero(np.isnan(derivatives).any(axis=1)).tolist()
    return [names[i] for i in gone if names[i] not in known]
