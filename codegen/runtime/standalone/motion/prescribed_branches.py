"""Prescribed motion that has branches: a motion ends before its velocity jumps."""

from __future__ import annotations

from typing import Any

from ..arrays import Array
from ..calls.package import Package
from ..errors import SimulationError
from .inputs import Inputs
from .kinks import first_kink, known_of, times_of

MOST_KINKS = 64
"""Number of sets of parameters and times for which kinks of prescribed motion are remembered."""

SHORT_OF_KINK = 1e-12
"""A motion ends before a kink of prescribed motion by this part of its time."""


class PrescribedBranches(Package):
    """Motions up to where prescribed motion has a kink."""

    def _before_kinks(
        self, start: float, end: float, times: Array, p: Array, inputs: Inputs
    ) -> tuple[float, Array, str]:
        """End and times of a motion up to the first kink of prescribed motion, and why it goes no farther, if there is one.

        Raises
        ------
        SimulationError
            It begins there.
        """
        motion = self._manifest.get("branching_motion")
        if not motion:
            return end, times, ""
        names = {n for one in motion for n in one["names"]}
        key = (start, end, *(x for n, x in zip(self.parameter_names, p.tolist(), strict=True) if n in names))
        looked_at: dict[Any, tuple[float, str] | None] = self.__dict__.setdefault("_kinks", {})
        if key not in looked_at or not names.isdisjoint(self.input_names):
            known = known_of(self.parameter_names, p, self.input_names, inputs)
            if len(looked_at) >= MOST_KINKS:
                looked_at.clear()
            looked_at[key] = first_kink(motion, known, times_of(start, end, inputs))
        found = looked_at[key]
        if found is None:
            return end, times, ""
        t, message = found
        message = f"the motion ends at t = {t:.9g} s: {message}"
        before = t - SHORT_OF_KINK * max(abs(t), end - start)  # where the branches are still those before it
        if before <= start:
            raise SimulationError(message, None)
        return before, times[times <= before], message
