"""Newton's method on the dependent coordinates of one state, for loops together or apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arguments import placed
from .arrays import Array, Indices, normalise
from .errors import SingularLoopError
from .targets import Opened

STEPS = 60
SEARCH = tuple(0.5**i for i in range(12))
"""Parts of Newton's step that are tried, one after the other."""

NUDGE = 0.1
"""rad or m: how far loops that have lost rank are moved, to go on elsewhere."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Loops that share dependent coordinates with each other and with no others; or all loops.

    Attributes
    ----------
    rows : array of int, or slice
        Their conditions, among those that count.
    coordinates : array of int, or slice
        Their dependent coordinates; may be all coordinates for all loops, since Newton's step is zero for independent ones.
    loops : set of str
    """

    rows: Indices | slice
    coordinates: Indices | slice
    loops: set[str]

    def largest(self, gaps: Array) -> float:
        """The largest residual of its conditions."""
        return float(np.abs(gaps[self.rows]).max(initial=0.0))

    def square(self, gaps: Array) -> float:
        """The sum of squares of its conditions."""
        of_part = gaps[self.rows]
        return float(of_part @ of_part)


class Newton:
    """Newton's method for the closure of a partition.

    Parameters
    ----------
    opened : Opened
    kept : array of int
        The conditions that count.
    """

    def __init__(self, opened: Opened, kept: Indices):
        self.opened, self.kept = opened, kept
        self.still = np.zeros(len(opened.manifest["speed_names"]))
        self.quaternions = tuple(opened.manifest["quaternions"])
        self.np = len(opened.manifest["parameter_names"])

    def named(self, q: Array, p: Array) -> dict[str, Any]:
        """Arguments by name; behind the parameters p may have inputs and the time, see `placing`."""
        return placed(q, p, self.np)

    def all_gaps(self, q: Array, p: Array) -> Array:
        """Scaled position residuals of all conditions, (..., of them); p has the axes of q, or none."""
        given = self.named(q, p) | {"u": self.still}
        found: Array = self.opened.target.values(self.opened.functions["closure"], given, q.shape[:-1])[0]
        return found

    def gaps(self, q: Array, p: Array) -> Array:
        """Those of the conditions that count."""
        found = self.all_gaps(q, p)
        return found if len(self.kept) == found.shape[-1] else found[..., self.kept]

    def solve(
        self, q: Array, p: Array, parts: Sequence[Part], goal: float, rng: np.random.Generator | None = None
    ) -> tuple[Array, Array]:
        """Newton's method with a line search for each of some parts: coordinates, and the conditions that count there.

        A part goes on until its largest residual is at most `goal`, or no step makes it smaller. Loops that have lost rank
        are nudged by numbers of `rng`.

        Raises
        ------
        SingularLoopError
            A loop has lost rank, and there is no `rng`.
        """
        q = q.copy()
        gaps = self.gaps(q, p)
        going = list(parts)
        for _ in range(STEPS):
            going = [part for part in going if part.largest(gaps) > goal]
            if not going:
                break
            try:
                (step,) = self.opened.target.values(self.opened.functions["newton_step"], self.named(q, p), ())
            except SingularLoopError as singular:
                if rng is None:
                    raise
                flat = [part for part in going if singular.link in part.loops]
                if not flat:  # one that is closed: no steps are known for the others
                    break
                for part in flat:
                    q[part.coordinates] += rng.uniform(-NUDGE, NUDGE, q[part.coordinates].size)
                normalise(q, self.quaternions)
                gaps = self.gaps(q, p)
                continue
            with np.errstate(all="ignore"):  # a step may lead anywhere
                q, gaps, going = self._search(q, p, gaps, step, going)
        return q, gaps

    def _search(
        self, q: Array, p: Array, gaps: Array, step: Array, parts: list[Part]
    ) -> tuple[Array, Array, list[Part]]:
        """As much of a step as makes each part smaller: coordinates, conditions, and the parts that are smaller."""
        new, smaller = q.copy(), []
        before = {part: part.square(gaps) for part in parts}
        for fraction in SEARCH:
            trial = new.copy()
            for part in parts:
                trial[part.coordinates] += fraction * step[part.coordinates]
            normalise(trial, self.quaternions)
            after = self.gaps(trial, p)
            # the sum of squares goes down by nearly what a linear closure would take off
            better = [part for part in parts if part.square(after) < (1.0 - 0.2 * fraction) * before[part]]
            smaller += better
            parts = [part for part in parts if part not in better]
            if not parts:
                return trial, after, smaller
            for part in better:
                new[part.coordinates] = trial[part.coordinates]
        return (new, self.gaps(new, p), smaller) if smaller else (q, gaps, smaller)
