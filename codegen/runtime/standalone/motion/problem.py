"""The integrators' input as a C struct: arrays and options; and the results of motions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Array
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

        def begin(x: Array) -> Any:
            """Pointer to the first entry of an array."""
            if x.dtype is not DOUBLE or not x.flags.c_contiguous:
                x = np.ascontiguousarray(x, float)
            found = ffi.from_buffer("double[]", x)
            kept.append(found)
            return found

        if n := len(self.times):
            c.ntimes, c.times = n, begin(self.times)
        if k := len(self.dp):
            c.ndirections, c.dq, c.du, c.dp = k, begin(self.dq), begin(self.du), begin(self.dp)
            if self.atol_directions is not None:
                c.atol_directions = begin(self.atol_directions)
        c.start, c.end, c.rtol, c.most_steps = self.start, self.end, self.rtol, self.most_steps
        if self.step or self.largest_step:
            c.step, c.fixed, c.largest_step = self.step, self.fixed, self.largest_step
        if self.poor:
            c.poor, c.looked_at = self.poor, self.looked_at
        c.system, c.method = system, METHODS.index(self.method)
        inputs, of_motion = c.inputs, self.inputs
        inputs.degree, inputs.count = of_motion.degree, len(of_motion.values)
        if of_motion.values.size:
            inputs.values = begin(of_motion.values)
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
