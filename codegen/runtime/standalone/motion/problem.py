"""The integrators' input as a C struct: arrays and options; and the results of motions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.targets import Opened
from .controllers import Sampling
from .inputs import Inputs
from .settings import METHODS

REASONS = (
    "end", "paused", "full", "event", "singular", "open loop", "step collapsed", "not finite", "too many steps",
    "imprecise", "poor", "undetermined", "sliding", "accumulated", "apart", "refused",
)  # fmt: skip
"""Reasons for the end of a motion, in the order of the constants in ``motion.h``."""


DOUBLE = np.dtype(np.float64)


@dataclass(slots=True)
class Problem:
    """Input of the integrators for one motion.

    Attributes
    ----------
    q, u : array (nq,), (nu,)
        The initial state, consistent.
    p : array (np,)
    times : array (ntimes,)
        Times of results; empty for results at every step.
    dq, du, dp : array (k, nq), (k, nu), (k, np)
        Directions of differentiation.
    dinputs : array (k, count, nsignals) or None
    atol : array (nq + nu + nintegrals,)
        Tolerances of coordinates, speeds and integrals; only those of independent ones are used.
    atol_directions : array (k,) or None
        None if errors of sensitivities do not affect the step size.
    integrals : tuple of int
        Outputs that are integrated over time.
    events : tuple of (output, level, direction, stop)
    sampling : Sampling or None
        The controller that sets inputs during the motion.
    kink : str
        Why the motion ends at a kink of prescribed motion; empty without a kink.
    """

    start: float
    end: float
    q: Array
    u: Array
    p: Array
    inputs: Inputs
    times: Array
    dq: Array
    du: Array
    dp: Array
    dinputs: Array | None
    rtol: float
    atol: Array
    atol_directions: Array | None = None
    method: str = "dop853"
    step: float = 0.0
    largest_step: float = 0.0
    most_steps: int = 0
    poor: float = 0.0
    looked_at: float = 0.0
    integrals: tuple[int, ...] = ()
    events: tuple[tuple[int, float, int, bool], ...] = ()
    fixed: bool = False
    sampling: Sampling | None = None
    kink: str = ""
    kept: list[Any] = field(default_factory=list)

    def in_c(self, ffi: Any, system: Any) -> Any:
        """The C struct; the memory that it points to lives as long as this object."""
        c = ffi.new("ordernm_problem *")
        kept = self.kept = [c]
        doubles, from_buffer = ffi.typeof("double[]"), ffi.from_buffer

        def begin(x: Array) -> Any:
            """Pointer to the first entry of an array."""
            if x.dtype is not DOUBLE or not x.flags.c_contiguous:
                x = np.ascontiguousarray(x, float)
            found = from_buffer(doubles, x)
            kept.append(found)
            return found

        if n := len(self.times):
            c.ntimes, c.times = n, begin(self.times)
        if k := len(self.dp):
            c.ndirections, c.dq, c.du, c.dp = k, begin(self.dq), begin(self.du), begin(self.dp)
            if self.atol_directions is not None:
                c.atol_directions = begin(self.atol_directions)
        c.start, c.end, c.step, c.fixed, c.rtol = self.start, self.end, self.step, self.fixed, self.rtol
        c.largest_step, c.most_steps = self.largest_step, self.most_steps
        c.poor, c.looked_at = self.poor, self.looked_at
        c.system, c.method = system, METHODS.index(self.method)
        inputs, of_motion = c.inputs, self.inputs
        inputs.degree, inputs.count, inputs.values = of_motion.degree, len(of_motion.values), begin(of_motion.values)
        if of_motion.knots is not None:
            inputs.knots = begin(of_motion.knots)
        if self.dinputs is not None and self.dinputs.size:
            inputs.directions = begin(self.dinputs)
        counting = self.atol
        if system.nfree_q + system.nfree_u < system.nq + system.nu:
            counting = self.atol[
                [
                    *(ffi.unpack(system.free_q, system.nfree_q) if system.nfree_q else ()),
                    *(system.nq + i for i in (ffi.unpack(system.free_u, system.nfree_u) if system.nfree_u else ())),
                    *range(system.nq + system.nu, len(self.atol)),
                    *(range(system.nq) if not system.nfree_q + system.nfree_u else ()),
                ]
            ]
        # one array: each call of `from_buffer` takes as long as joining all four
        c.p = at = begin(np.concatenate((self.p, self.q, self.u, counting)))
        c.q = at = at + len(self.p)
        c.u = at = at + len(self.q)
        c.atol = at + len(self.u)
        if self.integrals:
            integrals = ffi.new("int[]", list(self.integrals))
            self.kept.append(integrals)
            c.nintegrals, c.integrals = len(self.integrals), integrals
        if self.events:
            events = ffi.new("ordernm_event[]", [tuple(e) for e in self.events])
            self.kept.append(events)
            c.nevents, c.events = len(self.events), events
        return c


@dataclass(slots=True, eq=False)
class Segment:
    """The part of a motion with one partition in use.

    Attributes
    ----------
    opened : Opened
        The partition.
    problem : Problem
    reason : str
        One of `REASONS`, or "interrupted".
    counts : dict of str to number
    singular, component : int
        See ``ordernm_results``.
    steps, known, heads : list of array
        For the adjoint, if requested, for each part of the motion: rows of ``ordernm_step_size`` entries, and the integrator's
        memory before them. If memory is short, a part keeps its first row and, in `heads`, the numbers from which its other
        rows can be repeated.
    events : list of (int, array)
        Index of the event, and a row of results.
    condition, next_step : float
        Condition number of the loops at the end, and the next step size.
    precise : int
        Address of the functions in long double, if the motion came near a pose at which a loop loses rank; else 0.
    grazed, not_held : int
        For a motion with derivatives: 1 plus the number of a switch that the motion only touched, or whose branch has no value on
        the other side; else 0.
    together : tuple of float and int and int, or None
        Time and numbers of two switches passed at the same time, if their order may affect derivatives.
    ordered : bool
        Whether their order does affect a direction.
    event_together : int
        1 plus the number of an event at the same time as the second of these switches; else 0.
    event_ordered : bool
        Whether derivatives of the event depend on the order.
    late : tuple of float and int, or None
        Time and number of a switch passed at a pose where a loop loses rank, so that its old branch was used for too long.
    coarse : tuple of three floats and int
        Method "rk4" with loops or steep functions: the sum of the steps' errors relative to the state; the largest error, its
        time, s, and its entry.
    coarse_along : tuple of three floats
        The same errors of derivatives, without an entry; only with steep functions.
    flat : array (n, 1 + 2 nq)
        Flat poses passed by a motion with derivatives: time, and coordinates near the pose and farther away.
    lost : list of (array, int, int)
        Loss of directions: a row of results, the reason, and the switch or entry; see ``ordernm_results``.
    """

    opened: Opened
    problem: Problem
    reason: str
    counts: dict[str, Any]
    singular: int
    component: int
    steps: list[Array]
    known: list[Array]
    heads: list[Array | None]
    events: list[tuple[int, Array]]
    condition: float
    next_step: float
    precise: int
    grazed: int
    not_held: int
    together: tuple[float, int, int] | None
    ordered: bool
    event_together: int
    event_ordered: bool
    coarse: tuple[float, float, float, int]
    coarse_along: tuple[float, float, float]
    late: tuple[float, int] | None
    flat: Array
    lost: list[tuple[Array, int, int]]


@dataclass(slots=True, eq=False)
class Run:
    """The results of a motion over all its segments.

    Attributes
    ----------
    rows : array (nt, row)
        See ``ordernm_results``.
    reason, counts, singular, component, events
        As in the last segment; but counts are sums over all segments, and only those that apply to the method and model.
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
