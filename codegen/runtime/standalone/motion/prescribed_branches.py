"""Prescribed motion with branches: ends a motion before its velocity jumps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..arrays import Array
from ..errors import SimulationError
from .inputs import Inputs
from .kinks import first_kink, known_of, times_of

MOST_KINKS = 64
"""Number of sets of parameters and times for which the first kink is kept."""

SHORT_OF_KINK = 1e-12
"""Relative time by which a motion ends before a kink of prescribed motion."""


def before_kinks(
    manifest: Mapping[str, Any], known: dict[Any, tuple[float, str] | None], start: float, end: float, times: Array, p: Array,
    inputs: Inputs,
) -> tuple[float, Array, str]:  # fmt: skip
    """End time and result times before the first kink of prescribed motion, and the reason for an earlier end, if there
    is a kink.

    `known` stores kinks that have already been found.

    Raises
    ------
    SimulationError
        If the motion starts at a kink.
    """
    motion, parameters, signals = manifest["branching_motion"], manifest["parameter_names"], manifest["input_names"]
    names = {n for one in motion for n in one["names"]}
    key = (start, end, *(x for n, x in zip(parameters, p.tolist(), strict=True) if n in names))
    if key not in known or not names.isdisjoint(signals):
        if len(known) >= MOST_KINKS:
            known.clear()
        known[key] = first_kink(motion, known_of(parameters, p, signals, inputs), times_of(start, end, inputs))
    found = known[key]
    if found is None:
        return end, times, ""
    t, message = found
    message = f"the motion ends at t = {t:.9g} s: {message}"
    before = t - SHORT_OF_KINK * max(abs(t), end - start)  # at this time the branches before the kink apply
    if before <= start:
        raise SimulationError(message, None)
    return before, times[times <= before], message
