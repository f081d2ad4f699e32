"""What the integrators are told of a motion: arrays and options as a C struct, and the rows of results taken apart."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .arrays import Array

METHODS = ("rk4", "dop853", "radau")
"""In the order of the constants of ``motion.h``."""

REASONS = (
    "end", "paused", "full", "event", "singular", "open loop", "step collapsed", "not finite", "too many steps",
)  # fmt: skip
"""Why a motion ended, in the order of the constants of ``motion.h``."""


@dataclass(slots=True)
class Inputs:
    """Inputs over time: a B-spline, or constant numbers.

    Attributes
    ----------
    degree : int
    knots : array (count + degree + 1,) or None
        None for constant inputs, of which count is 1.
    values : array (count, ninputs)
        Control points: of degree 0 and 1 the values themselves.
    """

    degree: int
    knots: Array | None
    values: Array


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
    dinputs : array (k, count, ninputs) or None
    atol : array (n,)
        Of independent coordinates and speeds, then integrals.
    atol_directions : array (k,) or None
        None where errors of sensitivities do not matter to the step.
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
    fixed: bool = False
    largest_step: float = 0.0
    most_steps: int = 0
    integrals: tuple[int, ...] = ()
    kept: list[Any] = field(default_factory=list)

    def in_c(self, ffi: Any, system: Any) -> Any:
        """The struct; what it points to lives as long as this object."""
        c = ffi.new("ordernm_problem *")
        self.kept = [c]

        def pointer(x: Array | None) -> Any:
            if x is None or not x.size:
                return ffi.NULL
            held = ffi.from_buffer("double[]", np.ascontiguousarray(x, float))
            self.kept.append(held)
            return held

        c.system = system
        c.method = METHODS.index(self.method)
        c.p, c.q, c.u = pointer(self.p), pointer(self.q), pointer(self.u)
        c.ndirections = len(self.dp)
        c.dq, c.du, c.dp = pointer(self.dq), pointer(self.du), pointer(self.dp)
        c.inputs.degree = self.inputs.degree
        c.inputs.count = len(self.inputs.values)
        c.inputs.knots = pointer(self.inputs.knots)
        c.inputs.values = pointer(self.inputs.values)
        c.inputs.directions = pointer(self.dinputs)
        c.start, c.end = self.start, self.end
        c.ntimes, c.times = len(self.times), pointer(self.times)
        c.step, c.fixed, c.largest_step, c.most_steps = self.step, self.fixed, self.largest_step, self.most_steps
        c.rtol, c.atol, c.atol_directions = self.rtol, pointer(self.atol), pointer(self.atol_directions)
        integrals = ffi.new("int[]", list(self.integrals) or [0])
        self.kept.append(integrals)
        c.nintegrals, c.integrals = len(self.integrals), integrals
        return c
