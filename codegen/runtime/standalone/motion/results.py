"""Memory for the results of a motion, which grows as needed."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.targets import Opened
from .problem import Problem, Segment

ROWS = 256
"""Initial number of rows of results, if it is not known."""

FLAT_POSES = 64
"""Maximum number of flat poses that a motion records; later ones mostly repeat them."""

NO_POSES: Array = np.empty((0, 0))

SAMPLES = 8
"""Maximum number of results at times of switches that a motion records."""


class Results:
    """The results of a motion with one partition.

    Parameters
    ----------
    library, ffi : object
        The integrators, and their cffi object.
    c : cffi pointer
        The motion's ``ordernm_problem``.
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
        The ``ordernm_results``.
    size : int
        Length of a row of results.
    """

    def __init__(self, library: Any, ffi: Any, c: Any, problem: Problem, loops: int, keep_steps: bool, memory: int):
        self.r = r = ffi.new("ordernm_results *")
        self._library, self._ffi, self._c, self._problem, self._memory = library, ffi, c, problem, memory
        self._doubles = ffi.typeof("double[]")
        self.size: int = library.ordernm_row_size(c)
        self._flat = NO_POSES
        if loops:
            self._flat = np.empty((FLAT_POSES, 1 + 2 * loops))
            r.flat, r.flat_capacity = self._in_c(self._flat), FLAT_POSES
        along = len(problem.dp)
        if along or keep_steps:
            self._lost = np.empty((along + SAMPLES if along else 1, self.size))
            self._why = ffi.new("int[]", 2 * len(self._lost))
            r.lost, r.lost_why, r.lost_capacity = self._in_c(self._lost), self._why, len(self._lost)
        self._full: list[Array] = []
        self._steps: list[Array] = []
        self._known: list[Array] = []
        self._heads: list[Array | None] = []
        self._events: list[tuple[int, Array]] = []
        if problem.events:
            self._places = np.empty((ROWS + 2 * len(problem.events), library.ordernm_event_size(c)))
            self._which = ffi.new("int[]", len(self._places))
            r.events, r.which, r.events_capacity = self._in_c(self._places), self._which, len(self._places)
        self._rows = self._more_rows()
        self._kept = self._more_steps() if keep_steps else None

    def _in_c(self, x: Array) -> Any:
        return self._ffi.from_buffer(self._doubles, x)

    def _more_rows(self) -> Array:
        r, rows = self.r, np.empty((len(self._problem.times) or ROWS * 2 ** min(len(self._full), 8), self.size))
        r.rows, r.capacity, r.count = self._in_c(rows), len(rows), 0
        return rows

    def _more_steps(self) -> Array:
        r, size = self.r, self._library.ordernm_step_size(self._c)
        most = max(self._memory // (4 * 8 * size), 2)  # memory holds two complete parts at the same time
        rows = np.empty((min(ROWS * 2 ** min(len(self._steps), 8), most), size))
        r.steps, r.steps_capacity, r.steps_count = self._in_c(rows), len(rows), 0
        self._known.append(np.zeros(self._library.ordernm_known_size(self._c)))
        r.known = self._in_c(self._known[-1]) if self._known[-1].size else self._ffi.NULL
        return rows

    def _take_steps(self) -> None:
        if self._kept is not None:
            self._steps.append(self._kept[: self.r.steps_count])
            self._heads.append(None)

    def _take_events(self) -> None:
        self._events.extend((self._which[i], self._places[i].copy()) for i in range(self.r.events_count))
        self.r.events_count = 0

    def grow(self) -> None:
        """Allocates more memory where the memory for results is full."""
        r = self.r
        if r.count == r.capacity:
            self._full.append(self._rows)
            self._rows = self._more_rows()
        if self._kept is not None and r.steps_count == r.steps_capacity:
            self._take_steps()
            if 8 * sum(x.size for x in self._steps) > self._memory // 2:
                let_go(self._steps, self._heads, self._library.ordernm_head_size(self._c))
            self._kept = self._more_steps()
        if self._problem.events and r.events_count + 2 * len(self._problem.events) > r.events_capacity:
            self._take_events()

    def rows(self) -> Array:
        """All rows of results."""
        last = self._rows[: self.r.count]
        return np.concatenate([*self._full, last]) if self._full else last

    def row_here(self, motion: Any) -> Array:
        """A row for the current state of the motion; empty if there is none."""
        row = np.zeros(self.size)
        return self._rows[:0] if self._library.ordernm_row(motion, self.r, self._in_c(row)) else row

    def segment(self, opened: Opened, reason: str, condition: float, precise: int) -> Segment:
        """The segment of a motion that has ended, with the reason and the condition number of the loops."""
        r = self.r
        if self._problem.events:
            self._take_events()
        self._take_steps()
        counts = {
            "t": r.t, "steps": r.accepted, "rejected": r.rejected, "evaluations": r.evaluations,
            "closing_steps": r.closing_steps, "condition": r.condition, "jacobians": r.jacobians,
            "factorizations": r.factorizations, "stiffness": r.stiffness,
        }  # fmt: skip
        return Segment(
            opened, self._problem, reason, counts, r.singular, r.component, self._steps, self._known, self._heads,
            self._events, condition, r.next_step, precise, r.grazed, r.not_held,
            (r.together_at, r.together_with - 1, r.together - 1) if r.together_with else None,
            bool(r.ordered), r.event_together, bool(r.event_ordered), (r.coarse, r.coarsest, r.coarse_at, r.coarse_entry),
            (r.coarse_along, r.coarsest_along, r.coarse_along_at),
            (r.late_at, r.late - 1) if r.late else None,
            self._flat[: r.flat_count].copy() if self._flat.size else self._flat,
            [(self._lost[i], self._why[2 * i], self._why[2 * i + 1]) for i in range(r.lost_count)],
        )  # fmt: skip


def let_go(steps: list[Array], heads: list[Array | None], head: int) -> None:
    """Reduces the first complete part to the numbers from which its steps can be repeated."""
    for i, part in enumerate(steps):
        if heads[i] is None and len(part) > 1:
            steps[i], heads[i] = part[:1].copy(), part[:, :head].copy()
            return
