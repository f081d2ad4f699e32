"""The part of a motion with one partition in use: its results, and memory for them, which grows as needed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.targets import Opened
from .problem import Problem

ROWS = 256
"""Initial number of rows of results, if it is not known."""

FLAT_POSES = 64
"""Maximum number of flat poses that a motion records; later ones mostly repeat them."""

SAMPLES = 8
"""Maximum number of results at times of switches that a motion records."""


class Segment:
    """The part of a motion with one partition in use.

    Parameters
    ----------
    library, ffi : object
        The integrators, and their cffi object.
    c : cffi pointer
        The motion's ``ordernm_problem``.
    opened : Opened
        The partition.
    problem : Problem
    loops : int
        Number of coordinates in a model with loops, else 0.
    keep_steps : bool
        Whether to keep the steps for the adjoint.
    memory : int
        Bytes for kept steps; of steps beyond it, only the numbers needed to repeat them are kept.

    Attributes
    ----------
    r : cffi pointer
        The ``ordernm_results``, whose members say how the segment ended.
    size : int
        Length of a row of results.
    reason : str
        One of `REASONS`, or "interrupted".
    steps, known, heads : list of array
        For the adjoint, if requested, for each part of the motion: rows of ``ordernm_step_size`` entries, and the integrator's
        memory before them. If memory is short, a part keeps its first row and, in `heads`, the numbers from which its other
        rows can be repeated.
    events : list of (int, array)
        Index of the event, and a row of results.
    condition : float
        Condition number of the loops at the end.
    precise : int
        Address of the functions in long double, if the motion came near a pose at which a loop loses rank; else 0.
    """

    reason = ""
    condition = 0.0
    precise = 0

    def __init__(
        self, library: Any, ffi: Any, c: Any, opened: Opened, problem: Problem, loops: int, keep_steps: bool, memory: int
    ):  # fmt: skip
        self.opened, self.problem = opened, problem
        self.r = r = ffi.new("ordernm_results *")
        self._library, self._ffi, self._c, self._memory = library, ffi, c, memory
        self.size: int = library.ordernm_row_size(c)
        if loops:
            self._flat = np.empty((FLAT_POSES, 1 + 2 * loops))
            r.flat, r.flat_capacity = self._in_c(self._flat), FLAT_POSES
        along = len(problem.dp)
        if along or keep_steps:
            self._lost = np.empty((along + SAMPLES if along else 1, self.size))
            self._why = ffi.new("int[]", 2 * len(self._lost))
            r.lost, r.lost_why, r.lost_capacity = self._in_c(self._lost), self._why, len(self._lost)
        self._full: list[Array] = []
        self.steps: list[Array] = []
        self.known: list[Array] = []
        self.heads: list[Array | None] = []
        self.events: list[tuple[int, Array]] = []
        if problem.events:
            self._places = np.empty((ROWS + 2 * len(problem.events), library.ordernm_event_size(c)))
            self._which = ffi.new("int[]", len(self._places))
            r.events, r.which, r.events_capacity = self._in_c(self._places), self._which, len(self._places)
        self._rows = self._more_rows(len(problem.times) or ROWS)
        self._kept = self._more_steps() if keep_steps else None

    def _in_c(self, x: Array) -> Any:
        return self._ffi.from_buffer("double[]", x)

    # -- memory --------------------------------------------------------------------------------------------------------

    def _more_rows(self, count: int) -> Array:
        r, rows = self.r, np.empty((count, self.size))
        r.rows, r.capacity, r.count = self._in_c(rows), count, 0
        return rows

    def _more_steps(self) -> Array:
        r, size = self.r, self._library.ordernm_step_size(self._c)
        most = max(self._memory // (4 * 8 * size), 2)  # memory holds two complete parts at the same time
        rows = np.empty((min(ROWS * 2 ** min(len(self.steps), 8), most), size))
        r.steps, r.steps_capacity, r.steps_count = self._in_c(rows), len(rows), 0
        self.known.append(np.zeros(self._library.ordernm_known_size(self._c)))
        r.known = self._in_c(self.known[-1]) if self.known[-1].size else self._ffi.NULL
        return rows

    def _take_steps(self) -> None:
        if self._kept is not None:
            self.steps.append(self._kept[: self.r.steps_count])
            self.heads.append(None)

    def _take_events(self) -> None:
        self.events.extend((self._which[i], self._places[i].copy()) for i in range(self.r.events_count))
        self.r.events_count = 0

    def grow(self) -> None:
        """Allocates more memory where the memory for results is full."""
        r = self.r
        if r.count == r.capacity:
            self._full.append(self._rows)
            self._rows = self._more_rows(len(self.problem.times) or ROWS * 2 ** min(len(self._full), 8))
        if self._kept is not None and r.steps_count == r.steps_capacity:
            self._take_steps()
            if 8 * sum(x.size for x in self.steps) > self._memory // 2:
                let_go(self.steps, self.heads, self._library.ordernm_head_size(self._c))
            self._kept = self._more_steps()
        if self.problem.events and r.events_count + 2 * len(self.problem.events) > r.events_capacity:
            self._take_events()

    # -- results -------------------------------------------------------------------------------------------------------

    def end(self, reason: str) -> Array:
        """Ends the segment for a reason; returns all rows of results, (nt, size)."""
        self.reason, self.condition = reason, self.r.condition_here
        if self.problem.events:
            self._take_events()
        self._take_steps()
        last = self._rows[: self.r.count]
        rows = np.concatenate([*self._full, last]) if self._full else last
        self._full, self._rows, self._kept = [], last[:0], None
        return rows

    def row_here(self, motion: Any) -> Array:
        """A row for the current state of the motion; empty if there is none."""
        row = np.zeros(self.size)
        failed = self._library.ordernm_row(motion, self.r, self._in_c(row))
        if self.reason != "poor":  # with constant steps, a stage may have a larger condition number than this state
            self.condition = self.r.condition_here
        return np.empty((0, self.size)) if failed else row

    @property
    def t(self) -> float:
        """The time reached, s."""
        return float(self.r.t)

    @property
    def late(self) -> tuple[float, int] | None:
        """Time and number of a switch passed at a pose where a loop loses rank, so that its old branch was used for too
        long."""
        return (self.r.late_at, self.r.late - 1) if self.r.late else None

    @property
    def together(self) -> tuple[float, int, int] | None:
        """Time and numbers of two switches passed at the same time, if their order may affect derivatives."""
        r = self.r
        return (r.together_at, r.together_with - 1, r.together - 1) if r.together_with else None

    @property
    def flat(self) -> Array:
        """Flat poses passed by a motion with derivatives, (n, 1 + 2 nq): time, and coordinates near the pose and farther
        away."""
        return self._flat[: self.r.flat_count] if self.r.flat_capacity else np.empty((0, 0))

    @property
    def lost(self) -> list[tuple[Array, int, int]]:
        """Loss of directions: a row of results, the reason, and the switch or entry; see ``ordernm_results``."""
        return [(self._lost[i], self._why[2 * i], self._why[2 * i + 1]) for i in range(self.r.lost_count)]


def let_go(steps: list[Array], heads: list[Array | None], head: int) -> None:
    """Reduces the first complete part to the numbers from which its steps can be repeated."""
    for i, part in enumerate(steps):
        if heads[i] is None and len(part) > 1:
            steps[i], heads[i] = part[:1].copy(), part[:, :head].copy()
            return


@dataclass(slots=True, eq=False)
class Run:
    """The results of a motion over all its segments.

    Attributes
    ----------
    rows : array (nt, row)
        See ``ordernm_results``.
    reason : str
        As in the last segment.
    counts : dict of str to number
        Sums over all segments; only those that apply to the method and model.
    singular, component : int
        See ``ordernm_results``.
    events : list of (int, array)
        Index of the event, and a row of results.
    segments : list of Segment
    last : array (row,)
        The state at the end of a motion that failed; else empty.
    """

    rows: Array
    reason: str
    counts: dict[str, Any]
    singular: int = 0
    component: int = 0
    events: list[tuple[int, Array]] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)
    last: Array = field(default_factory=lambda: np.empty(0))

    @property
    def opened(self) -> Opened:
        """The partition that was in use at the end of the motion."""
        return self.segments[-1].opened
