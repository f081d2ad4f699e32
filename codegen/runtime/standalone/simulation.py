"""Integration over time, with sensitivities: what a user asks for made a problem of ``motion.h``, run, and its results named."""

from __future__ import annotations

import difflib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .arrays import Array, Numbers
from .arguments import some
from .motion_library import motion_library
from .motion_problem import METHODS, REASONS, Inputs, Problem
from .states import States

CLOSED = 1e-10
"""Scaled residual of an initial state that needs no assembly."""

SLICE = 0.1
"""Seconds that the integrator runs between two looks at Ctrl-C."""

ROWS = 256
"""Rows of results that there is room for at first, where nobody knows how many there will be."""


@dataclass(slots=True)
class Run:
    """What came of a motion.

    Attributes
    ----------
    rows : array (nt, row)
        See ``ordernm_results``.
    reason : str
        One of `REASONS`, or "interrupted".
    counts : dict of str to number
    steps : list of array
        For the adjoint, where asked for.
    q, u : array
        Where it was at its end.
    """

    rows: Array
    reason: str
    counts: dict[str, Any]
    q: Array
    u: Array
    singular: int = 0
    component: int = 0
    steps: list[Array] = field(default_factory=list)


class Simulation(States):
    """Integration over time."""

    def _motion(self) -> tuple[Any, Any, Any]:
        """The library of integrators, its cffi object, and the system of the partition in use."""
        target = self._opened.target
        if target.name != "c":
            raise NotImplementedError("simulate runs compiled code, and this solver computes with NumPy: open it with target='c'")
        library, ffi = motion_library(self.folder)
        address = target.address(f"{self._opened.manifest['name']}_motion")
        return library, ffi, ffi.cast("ordernm_system *", address)

    def _run(
        self, problem: Problem, progress: Callable[[float, float], None] | None = None, keep_steps: bool = False
    ) -> Run:
        """Run a motion to its end."""
        library, ffi, system = self._motion()
        c = problem.in_c(ffi, system)
        room = ffi.from_buffer("double[]", np.empty(library.ordernm_room(c)))
        motion = library.ordernm_begin(c, room)
        size, step_size = library.ordernm_row_size(c), library.ordernm_step_size(c)
        r = ffi.new("ordernm_results *")
        full: list[Array] = []
        steps: list[Array] = []

        def more_rows() -> Array:
            rows = np.empty((len(problem.times) or ROWS * 2 ** min(len(full), 8), size))
            r.rows, r.capacity, r.count = ffi.from_buffer("double[]", rows), len(rows), 0
            return rows

        def more_steps() -> Array:
            rows = np.empty((ROWS * 2 ** min(len(steps), 8), step_size))
            r.steps, r.steps_capacity, r.steps_count = ffi.from_buffer("double[]", rows), len(rows), 0
            return rows

        rows = more_rows()
        kept = more_steps() if keep_steps else None
        began = time.perf_counter()
        while True:
            reason = REASONS[library.ordernm_go(motion, r, SLICE)]
            try:
                if progress is not None:
                    progress(r.t, problem.end)
            except KeyboardInterrupt:
                reason = "interrupted"
            if reason == "full":
                if r.count == r.capacity:
                    full.append(rows)
                    rows = more_rows()
                if kept is not None and r.steps_count == r.steps_capacity:
                    steps.append(kept)
                    kept = more_steps()
            elif reason != "paused":
                break
        if kept is not None:
            steps.append(kept[: r.steps_count])
        q, u = np.empty(self.nq), np.empty(self.nu)
        library.ordernm_state(motion, ffi.from_buffer("double[]", q), ffi.from_buffer("double[]", u))
        counts = {
            "t": r.t, "steps": r.accepted, "rejected": r.rejected, "evaluations": r.evaluations,
            "closing_steps": r.closing_steps, "jacobians": r.jacobians, "factorizations": r.factorizations,
            "stiffness": r.stiffness, "seconds": time.perf_counter() - began,
        }  # fmt: skip
        found = np.concatenate([*full, rows[: r.count]]) if full else rows[: r.count]
        return Run(found, reason, counts, q, u, r.singular, r.component, steps)
