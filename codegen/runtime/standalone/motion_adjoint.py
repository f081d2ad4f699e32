"""The discrete adjoint of a motion: gradients of weighted sums of outputs, from the end to the beginning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .arrays import Array
from .motion_problem import REASONS, Problem


@dataclass(slots=True)
class Adjoint:
    """Gradients by what a motion begins with and depends on.

    Attributes
    ----------
    q, u : array (m, nq), (m, nu)
        By independent entries of the initial state; others are zero.
    p : array (m, np)
    inputs : array (m, count, ninputs)
    counts : dict of str to int
    """

    q: Array
    u: Array
    p: Array
    inputs: Array
    counts: dict[str, int]


def run_backwards(
    motion: tuple[Any, Any, Any],
    problem: Problem,
    steps: list[Array],
    times: Array,
    weights: Array,
    integral_weights: Array,
) -> Adjoint:
    """Gradients of m functionals of a motion whose steps have been kept.

    Parameters
    ----------
    motion : (library, ffi, system)
    steps : list of array
        Rows of steps, in their order.
    times : array (ntimes,)
    weights : array (m, ntimes, noutputs)
    integral_weights : array (m, nintegrals)
    """
    library, ffi, system = motion
    m = len(weights)
    c = problem.in_c(ffi, system)
    shapes = [(m, system.nq), (m, system.nu), (m, system.np), (m, len(problem.inputs.values), system.ninputs)]
    found = [np.zeros(s) for s in shapes]
    g = ffi.new("ordernm_gradients *")
    held = [np.ascontiguousarray(x, float) for x in (times, weights, integral_weights)]
    pointers = [ffi.from_buffer("double[]", x) if x.size else ffi.NULL for x in (*held, *found)]
    g.nfunctionals, g.ntimes = m, len(times)
    g.times, g.weights, g.integral_weights, g.q, g.u, g.p, g.inputs = pointers
    room = ffi.from_buffer("double[]", np.empty(library.ordernm_adjoint_room(c, g)))
    adjoint = library.ordernm_adjoint_begin(c, g, room)
    for part in reversed(steps):
        reason = REASONS[library.ordernm_backwards(adjoint, ffi.from_buffer("double[]", part), len(part))]
        if reason != "end":
            raise RuntimeError(
                f"the adjoint met a state that the motion had passed, and found it {reason} ({g.singular})"
            )
    library.ordernm_adjoint_end(adjoint)
    q, u, p, inputs = found
    return Adjoint(q, u, p, inputs, {"evaluations": g.evaluations, "transposes": g.transposes})
