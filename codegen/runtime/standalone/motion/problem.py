"""What the integrators are told of a motion: arrays and options as a C struct, and the rows of results taken apart."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.targets import Opened
from .inputs import Inputs
from .settings import METHODS

REASONS = (
    "end", "paused", "full", "event", "singular", "open loop", "step collapsed", "not finite", "too many steps",
    "imprecise", "poor", "undetermined", "sliding", "accumulated", "apart",
)  # fmt: skip
"""Why a motion ended, in the order of the constants of ``motion.h``."""


DOUBLE = np.dtype(np.float64)


@dataclass(slots=True)
class Problem:
    """A motion.

    Attributes
    ----------
    q, u : array (nq,), (nu,)
        The initial state, consistent.
    p : array (np,)
    times : array (ntimes,)
        Where results are wanted; without entries: at every step.
    dq, du, dp : array (k, nq), (k, nu), (k, np)
        Directions.
    dinputs : array (k, count, nsignals) or None
    atol : array (nq + nu + nintegrals,)
        Of coordinates, speeds, integrals; those of independent ones count.
    atol_directions : array (k,) or None
        None where errors of sensitivities do not matter to the step.
    integrals : tuple of int
        Outputs that are integrated over time.
    events : tuple of (output, level, direction, stop)
    kink : str
        Why the motion must not go on beyond its end, where prescribed motion has a kink.
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
    kink: str = ""
    kept: list[Any] = field(default_factory=list)

    def in_c(self, ffi: Any, system: Any) -> Any:
        """The struct; what it points to lives as long as this object."""
        c = ffi.new("ordernm_problem *")
        kept = self.kept = [c]
        doubles, from_buffer = ffi.typeof("double[]"), ffi.from_buffer

        def begin(x: Array) -> Any:
            """Where an array begins."""
            if x.dtype is not DOUBLE or not x.flags.c_contiguous:
                x = np.ascontiguousarray(x, float)
            found = from_buffer(doubles, x)
            kept.append(found)
            return found

        c.p, c.q, c.u = begin(self.p), begin(self.q), begin(self.u)
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
        c.atol = begin(counting)
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
    """What came of a motion while one partition was in use.

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
    steps, known : list of array
        For the adjoint, where asked for: parts of the motion, rows of ``ordernm_step_size``, and what the method knew before
        each. A part that did not fit into memory has its first row, and of all rows what making them again takes, in `heads`.
    events : list of (int, array)
        Which one, and a row of results.
    condition, next_step : float
        Of the loops at the end, and the step that would be tried there.
    precise : int
        The address of the functions in long double, where the motion came near a pose at which a loop loses rank; else 0.
    grazed, not_held : int
        1 and the number of a switch that the motion has only touched, or beyond which its branch has no value, where there is one
        with derivatives; else 0.
    together : tuple of float and int and int, or None
        When two switches, and which, were passed at one time, where their order may matter to derivatives.
    ordered : bool
        It does, along a direction.
    event_together : int
        1 and the number of an event that came at the same time as the second of these switches, if one did; else 0.
    event_ordered : bool
        Derivatives of an event depend on which comes first.
    late : tuple of float and int, or None
        When a switch, and which, was passed at a pose where a loop loses rank, so that its old branch was kept too long.
    coarse : tuple of three floats
        Of method "rk4" in models with loops: the sum of errors of steps, relative to the state, the largest, and its time, s.
    flat : array (n, 1 + 2 nq)
        Poses at which a loop has lost rank, of a motion with derivatives: time, and coordinates beside it, near and farther away.
    lost : list of (array, int, int)
        Where directions cease to have derivatives: a row of results, why, and of which switch or entry; see ``ordernm_results``.
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
    coarse: tuple[float, float, float]
    late: tuple[float, int] | None
    flat: Array
    lost: list[tuple[Array, int, int]]


@dataclass(slots=True, eq=False)
class Run:
    """What came of a motion.

    Attributes
    ----------
    rows : array (nt, row)
        See ``ordernm_results``.
    reason, counts, singular, component, events
        As of its last segment; counts are sums, of what the method and the model make use of.
    segments : list of Segment
    last : array (row,)
        Of a motion that cannot go on, the state at its end; without entries where there is none.
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
        """The partition that was in use at the end."""
        return self.segments[-1].opened
