"""The discrete adjoint of a motion: gradients of weighted sums of results, integrated from the end to the start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from .problem import REASONS
from .results import Segment


@dataclass(slots=True)
class Adjoint:
    """Gradients with respect to the initial state, the parameters and the inputs.

    Attributes
    ----------
    q, u : array (m, nq), (m, nu)
        Gradients with respect to independent entries of the initial state; zero for the others.
    p : array (m, np)
    inputs : array (m, count, nsignals)
    counts : dict of str to int
    """

    q: Array
    u: Array
    p: Array
    inputs: Array
    counts: dict[str, int]


def segment_backwards(
    motion: tuple[Any, Any, Any], segment: Segment, times: Array, weights: Array, of_states: Array,
    behind: tuple[Array, Array, Array], integral_weights: Array, end_q: Array, end_u: Array,
    whole: tuple[Array, Array] | None = None,
) -> Adjoint:  # fmt: skip
    """Gradients of m functionals with respect to the start, parameters and inputs of a segment whose steps were kept.

    Parameters
    ----------
    motion : (library, ffi, system)
    times : array (ntimes,)
    weights : array (m, ntimes, noutputs)
        Derivatives of the functionals with respect to the outputs at these times, all of which are in the segment.
    of_states : array (m, ntimes, nq + nu), or (m, ntimes, 0) for zeros
        Derivatives of the functionals with respect to the coordinates and speeds at these times.
    behind : array (n,), (m, n, noutputs), (m, n)
        Times of events at which outputs jump; derivatives with respect to the outputs after the jump, and to these times.
    end_q, end_u : array (m, nq), (m, nu)
        Derivatives with respect to independent entries of the state at the segment's end; to all entries, if `whole` is given.
    whole : (array (nq,), array (nu,)), optional
        The state at the segment's end, if the next segment has other independent coordinates.
    """
    library, ffi, system = motion
    problem, m = segment.problem, len(weights)
    # repeated steps must use the same functions as the original steps
    system.precise = ffi.cast("const ordernm_precise *", segment.precise)
    c = problem.in_c(ffi, system)
    shapes = [(m, system.nq), (m, system.nu), (m, system.np), (m, *problem.inputs.values.shape)]
    found = [np.zeros(s) for s in shapes]
    g = ffi.new("ordernm_gradients *")
    state = whole or (np.zeros(0), np.zeros(0))
    held = [
        np.ascontiguousarray(x, float)
        for x in (times, weights, of_states, *behind, integral_weights, end_q, end_u, *state)
    ]
    pointers = [ffi.from_buffer("double[]", x) if x.size else ffi.NULL for x in (*held, *found)]
    g.nfunctionals, g.ntimes, g.nbehind = m, len(times), len(behind[0])
    members = (
        "times", "weights", "state_weights", "behind", "behind_weights", "time_weights", "integral_weights", "end_q",
        "end_u", "whole_q", "whole_u", "q", "u", "p", "inputs",
    )  # fmt: skip
    for name, pointer in zip(members, pointers, strict=True):
        setattr(g, name, pointer)
    room = ffi.from_buffer("double[]", np.empty(library.ordernm_adjoint_room(c, g)))
    adjoint = library.ordernm_adjoint_begin(c, g, room)
    if g.singular:
        raise RuntimeError(f"the adjoint cannot close the loops in a state of the motion ({g.singular})")
    parts = zip(segment.steps, segment.known, segment.heads, strict=True)
    for part, known, heads in reversed(list(parts)):
        rows = part if heads is None else made_again(library, ffi, c, part, known, heads)
        reason = REASONS[library.ordernm_backwards(adjoint, ffi.from_buffer("double[]", rows), len(rows))]
        if reason in ("not finite", "step collapsed"):  # no derivative at a state, or radau's equations not solved
            for x in found:
                x.fill(np.nan)
            break
        if reason != "end":
            raise RuntimeError(f"the adjoint cannot use a state of the motion: {reason} ({g.singular})")
    library.ordernm_adjoint_end(adjoint)
    q, u, p, inputs = found
    return Adjoint(q, u, p, inputs, {"evaluations": g.evaluations, "transposes": g.transposes})


def made_again(library: Any, ffi: Any, c: Any, first: Array, known: Array, heads: Array) -> Array:
    """The rows of steps, computed again. Given are the first row, the integrator's memory before it (`known`), and the first
    entries of all rows (`heads`)."""
    rows = np.empty((len(heads), first.shape[1]))
    rows[:, : heads.shape[1]] = heads
    rows[0] = first[0]
    room = ffi.from_buffer("double[]", np.empty(library.ordernm_room(c)))  # workspace of the integrator
    motion = library.ordernm_begin(c, room)
    before = ffi.from_buffer("double[]", known) if known.size else ffi.NULL
    reason = REASONS[library.ordernm_replay(motion, before, ffi.from_buffer("double[]", rows), len(rows))]
    if reason != "end":
        raise RuntimeError(f"kept steps cannot be repeated: {reason}")
    return rows
