"""Hessian products of functionals of a motion, by tangents of the discrete adjoint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import PackageError
from ..statics.second_derivatives import SecondDerivatives
from .adjoint import made_again
from .at_states import AtStates
from .functionals import Functional, LeastSquares, WeightedResults
from .problem import Problem
from .results import Segment
from .switches import switch_words
from .switches_along import HEAD, REFUSED, check_switches, lasting_modes
from .weights_along import Crossed, by_control_points, of_event, of_squares

TOGETHER = 8
"""Number of directions that are computed together; further ones repeat the motion's steps."""

FUNCTIONS = "motion, hessian_products"
"""Functions that a package needs, as messages name them."""


def directions_of(hessian: Any, names: Sequence[str]) -> Array | None:
    """Rows of factors of the variables (r, k) from a user's argument; None if no Hessian product is requested.

    Raises
    ------
    ValueError
    """
    if hessian is None or hessian is False:
        return None
    k = len(names)
    if not k:
        raise ValueError("hessian: there is nothing to differentiate by; name variables in wrt")
    if hessian is True:
        return np.eye(k)
    try:
        found = np.asarray(hessian, float)
    except (TypeError, ValueError):
        found = np.empty(())
    if found.ndim not in (1, 2) or found.shape[-1] != k or not found.size:
        raise ValueError(
            f"hessian is {hessian!r}; allowed are True, for the whole Hessian, or directions (r, {k}): "
            f"a factor for each of {', '.join(names[:4])}{', ...' if k > 4 else ''}"
        )
    if not np.isfinite(found).all():
        raise ValueError("hessian: directions must be finite numbers")
    return np.atleast_2d(found)


def check_supported(package: Any, wanted: Sequence[Functional]) -> None:
    """Refuses models and functionals without Hessian products.

    Raises
    ------
    ValueError
    PackageError
        The package lacks a function.
    """
    if refused := [type(f).__name__ for f in wanted if isinstance(f, WeightedResults)]:
        raise ValueError(
            f"hessian: a functional is {refused[0]}; allowed are Final, At, Integral, AtEvent and LeastSquares. Gradients are "
            "available without hessian"
        )
    rates = ["coordinate_rate_hessian_products"] if package.coordinate_names != package.speed_names else []
    for name in ("hessian_products", "sensitivities_transposed", "output_sensitivities_transposed", *rates):
        if name not in package._functions:
            functions = ", ".join([FUNCTIONS, *rates])
            raise PackageError(
                f"hessian: {package.name} was generated without {name}; generate it with --functions '{functions}'"
            )


def check_joints(name: str, system: Any) -> None:
    """Refuses partitions with only some speeds of a joint independent, as the integrator then changes states between steps.

    Raises
    ------
    ValueError
    """
    if system.split:
        raise ValueError(
            f"hessian: a joint of {name} has both independent and dependent speeds; choose independents "
            "that take all speeds of a joint, or none. Gradients are available without hessian"
        )


@dataclass(slots=True)
class Curvature:
    """Gradients of functionals (with respect to initial state, parameters and inputs), and their changes along r directions.

    Attributes
    ----------
    state : array (m, 1 + r, nq + nu)
        First the gradient, then its changes.
    p : array (m, 1 + r, np)
    inputs : array (m, 1 + r, count, nsignals)
    products : int
        Number of Hessian products at single states.
    """

    state: Array
    p: Array
    inputs: Array
    products: int


@dataclass(slots=True)
class _Piece:
    """Steps of a part that are repeated together.

    Attributes
    ----------
    part : int
    rows : slice
        The steps within the part.
    until : float
        Time at their end, s.
    before : array (2 + nswitches + (1 + r) free,)
        The state before them, see ``ordernm_hessians_keep``.
    kept : tuple of array, or None
        Steps, records and nodes, if memory allows.
    """

    part: int
    rows: slice
    until: float = math.inf
    before: Array = field(default_factory=lambda: np.zeros(0))
    kept: tuple[Array, Array, Array] | None = None


class _Tangents:
    """The steps of a segment with tangents of their stages, ready for functionals."""

    def __init__(
        self, motion: tuple[Any, Any, Any], functions: SecondDerivatives, segment: Segment, along: Problem, times: Array
    ):
        self.library, self.ffi, system = motion
        self.along, self.times, self.r = along, times, len(along.dp)
        unpack, nq = self.ffi.unpack, len(along.q)
        free_q = unpack(system.free_q, system.nfree_q) if system.nfree_q else []
        free_u = unpack(system.free_u, system.nfree_u) if system.nfree_u else []
        self.free = np.array([*free_q, *(nq + i for i in free_u)], int)
        self.functions = AtStates(functions, along, self.free)
        # repeated steps must use the same functions as the original steps
        system.precise = self.ffi.cast("const ordernm_precise *", segment.precise)
        plain, c = segment.problem.in_c(self.ffi, system), along.in_c(self.ffi, system)
        g = self.g = self.ffi.new("ordernm_hessians *")
        self.room = self.ffi.from_buffer("double[]", np.zeros(self.library.ordernm_hessians_room(c)))
        self.curvature = self.library.ordernm_hessians_begin(c, g, self.room)
        self.stages = int(self.library.ordernm_hessians_stages(self.curvature))
        self.record = int(self.library.ordernm_hessians_record(self.curvature))
        self.records = np.zeros((len(times), self.record))
        self.kept = [self._pointer(times), self._pointer(self.records)]
        g.ntimes, (g.times, g.states) = len(times), self.kept
        self.kinds = self.ffi.unpack(system.switch_kind, system.nswitches) if system.nswitches else []
        self.plain, self.segment = plain, segment
        self.part, self.steps = -1, np.zeros(0)  # the part whose steps are available
        self.changed = np.zeros(0)  # all coordinates and speeds at the end, if the independent ones change there

    def forwards(self, memory: int) -> None:
        """Repeats the steps with tangents; keeps the tangents of all stages if they fit into `memory` bytes."""
        segment, times = self.segment, self.times
        head = int(self.library.ordernm_head_size(self.plain))
        given = zip(segment.steps, segment.heads, strict=True)
        heads = [rows[:, :head] if less is None else less for rows, less in given]
        steps = np.concatenate(heads)
        self.modes = np.split(lasting_modes(steps, self.kinds), np.cumsum([len(rows) for rows in heads])[:-1])
        needs = len(self.along.integrals) > 0 and not self.functions.compiled
        passed = check_switches(segment, self.functions.functions.opened.manifest, steps, self.kinds, times, needs)
        self.passed = self._pointer(np.zeros((passed, self.record + len(self.kinds))))
        self.g.passed = self.passed
        source = (1 + self.r) * (len(self.free) + self.functions.np + self.along.inputs.at(0.0).size)
        every = 8 * self.stages * (self.record + (source if self.along.integrals else 0))
        most = len(steps) if len(steps) * every <= memory else max(1, memory // (2 * every))
        self.pieces = [
            _Piece(part, slice(first, first + most))
            for part, of in enumerate(heads)
            for first in range(0, len(of), most)
        ]
        starts = [heads[piece.part][piece.rows][0, 0] for piece in self.pieces]
        for piece, until in zip(self.pieces, [*starts[1:], math.inf], strict=True):
            piece.until = float(until)
            piece.before = np.zeros(2 + len(self.kinds) + (1 + self.r) * len(self.free))
            self.library.ordernm_hessians_keep(self.curvature, self._pointer(piece.before))
            repeated = self._repeat(piece)
            piece.kept = repeated if most == len(steps) else None
        steps = steps[steps[:, 1] > 0.0]
        self.within = _middles(steps)[np.maximum(np.searchsorted(steps[:, 0], times) - 1, 0)]
        self.states = (
            self.functions.states(self.records, times, self.within, not self.functions.compiled)
            if len(times)
            else np.zeros(0)
        )
        self.end, self.middle = float(steps[-1, :2].sum()), float(_middles(steps[-1:])[0])

    def _rows(self, part: int) -> Array:
        """The steps of a part, computed again if only their heads were kept."""
        if part != self.part:
            of = self.segment
            rows, known, heads = of.steps[part], of.known[part], of.heads[part]
            rows = rows if heads is None else made_again(self.library, self.ffi, self.plain, rows, known, heads)
            modes = self.modes[part]
            if (rows[:, HEAD : HEAD + modes.shape[1]] != modes).any():
                rows = rows.copy()
                rows[:, HEAD : HEAD + modes.shape[1]] = modes
            self.steps = rows
            self.part = part
        return self.steps

    def _repeat(self, piece: _Piece) -> tuple[Array, Array, Array]:
        """Steps, the records of their stages, and times and weights of integrands at the stages."""
        rows = self._rows(piece.part)[piece.rows]
        # empty, not zeros: most steps leave the memory of the interpolant's stages untouched
        tape, nodes = np.empty((len(rows), self.stages, self.record)), np.zeros((len(rows), self.stages, 2))
        tape[rows[:, 1] <= 0.0] = 0.0
        status = self.library.ordernm_tangents(
            self.curvature, self._pointer(rows), len(rows), piece.until, self._pointer(tape), self._pointer(nodes)
        )
        if status:
            raise RuntimeError(f"tangents of a motion cannot use one of its states ({status})")
        return rows, tape, nodes

    def at_end(self, t: float) -> Array:
        """All coordinates and speeds (1 + r, nq + nu) at the end of the segment; dependent speeds are zero."""
        record = np.zeros(self.record)
        status = self.library.ordernm_hessians_state(self.curvature, t, self._pointer(record))
        if status:
            raise RuntimeError(
                f"tangents of a motion cannot use the state at a change of independent coordinates ({status})"
            )
        found: Array = self.functions.states(record[None], np.array([t]), np.array([self.middle]), True)[0]
        return found

    def _pointer(self, x: Array) -> Any:
        return self.ffi.from_buffer("double[]", np.ascontiguousarray(x, float)) if x.size else self.ffi.NULL

    def back(self, sources: Array, weights: Array, finish: Array) -> tuple[Array, Array, Array]:
        """Gradients of a functional with respect to the start's independent entries, parameters and inputs; and their changes.

        Parameters
        ----------
        sources : array
            Result of `AtStates.outputs` for outputs at times.
        weights : array (noutputs,)
            Weights of integrals of outputs.
        finish : array (1 + r, free)
            Gradients with respect to the independent entries at the end, and their changes.
        """
        g, rows = self.g, 1 + self.r
        found = [
            np.zeros((rows, len(self.free))),
            np.zeros((rows, len(self.along.p))),
            np.zeros((rows, *self.along.inputs.values.shape)),
        ]
        held = [self._pointer(x) for x in (sources, finish, weights, *found)]
        g.sources, g.finish, g.weights, g.start, g.p, g.inputs = held
        self.library.ordernm_hessians_turn(self.curvature)
        for piece in reversed(self.pieces):
            if piece.kept is None:
                self.library.ordernm_hessians_take(self.curvature, self._pointer(piece.before))
            steps, tape, nodes = piece.kept or self._repeat(piece)
            integrands = self._integrands(steps, tape, nodes, weights) if weights.any() else np.zeros(0)
            given = [self._pointer(x) for x in (steps, tape, integrands)]
            status = self.library.ordernm_hessians_backwards(self.curvature, given[0], len(steps), *given[1:])
            if status:
                raise RuntimeError(f"Hessian products cannot use a state of the motion ({status})")
        self.library.ordernm_hessians_end(self.curvature)
        if g.refused:
            reason = REFUSED[g.refused - 1].format(
                switch_words(self.functions.functions.opened.manifest, g.refused_switch)
            )
            raise ValueError(f"hessian: {reason}. Gradients are available without hessian")
        return found[0], found[1], found[2]

    def _integrands(self, steps: Array, tape: Array, nodes: Array, weights: Array) -> Array:
        """Gradients of weighted outputs at the stages of steps, and their changes: (count, stages, 1 + r, n)."""
        count, stages, record = tape.shape
        if self.functions.compiled:
            sources = np.zeros(
                (count, stages, 1 + self.r, len(self.free) + self.functions.np + self.along.inputs.at(0.0).size)
            )
            given = [self._pointer(x) for x in (steps, tape, nodes, sources)]
            status = self.library.ordernm_hessians_integrands(self.curvature, given[0], count, *given[1:])
            if status:
                raise RuntimeError(f"Hessian products cannot use a state of the motion ({status})")
            return sources
        used = np.flatnonzero((nodes[:, :, 1] != 0.0).any(axis=0))
        t = nodes[:, used, 0]
        within = np.broadcast_to(_middles(steps)[:, None], t.shape).ravel()
        records = tape[:, used].reshape(-1, record)
        states = self.functions.states(records, t.ravel(), within, not self.functions.compiled)
        of = np.broadcast_to(weights, (len(states), len(weights)))
        changes = np.zeros((*of.shape, self.r))
        found = self.functions.outputs(states, t.ravel(), within, of, changes)[..., :-1]
        whole = np.zeros((count, stages, *found.shape[1:]))
        whole[:, used] = found.reshape(count, len(used), *found.shape[1:])
        return whole


@dataclass(slots=True)
class Motion:
    """A motion whose steps were kept, with the functions of each segment.

    Attributes
    ----------
    segments : list of Segment
    functions : list of SecondDerivatives
    opened : list of (library, ffi, system)
    """

    segments: list[Segment]
    functions: list[SecondDerivatives]
    opened: list[tuple[Any, Any, Any]]


@dataclass(slots=True)
class Wanted:
    """Functionals, and derivatives with respect to outputs (m, nt, noutputs) at times (nt,), and to integrals (m, nintegrals).

    `crossed` has the event of each functional, or None.
    """

    functionals: Sequence[Functional]
    times: Array
    by_output: Array
    by_integral: Array
    output_names: Sequence[str]
    crossed: Sequence[Crossed | None]


def curvature_of(motion: Motion, along: Problem, wanted: Wanted, memory: int) -> Curvature:
    """Gradients of m functionals and their changes along the directions of `along`."""
    # least squares have curvature also at samples without error, where their gradient is zero
    samples = [np.asarray(f.times, float) for f in wanted.functionals if isinstance(f, LeastSquares)]
    used = wanted.by_output.any(axis=(0, 2)) | np.isin(wanted.times, np.concatenate([*samples, []]))
    wanted = replace(wanted, times=np.ascontiguousarray(wanted.times[used]), by_output=wanted.by_output[:, used])
    chunks: list[tuple[Array, Array, Array]] = []
    count = 0
    for first in range(0, len(along.dp), TOGETHER):
        part = slice(first, first + TOGETHER)
        dinputs = None if along.dinputs is None else along.dinputs[part]
        some = replace(along, dq=along.dq[part], du=along.du[part], dp=along.dp[part], dinputs=dinputs, kept=[])
        tangents = _forwards(motion, some, wanted.times, memory)
        results = [_backwards(tangents, wanted, i) for i in range(len(wanted.functionals))]
        chunks.append(tuple(np.array([one[k] for one in results]) for k in range(3)))  # type: ignore[arg-type]
        count += sum(int(of.g.products) for of in tangents)
    # each chunk begins with the same gradients
    state, p, inputs = (np.concatenate([chunks[0][i][:, :1], *(c[i][:, 1:] for c in chunks)], axis=1) for i in range(3))
    return Curvature(state, p, inputs, count)


def _forwards(motion: Motion, along: Problem, times: Array, memory: int) -> list[_Tangents]:
    """Segments with tangents; each begins with the tangents at the end of the previous segment."""
    found: list[_Tangents] = []
    dq, du = along.dq, along.du
    for number, (segment, functions, opened) in enumerate(
        zip(motion.segments, motion.functions, motion.opened, strict=True)
    ):
        start, end = segment.problem.start if number else -math.inf, segment.t
        here = np.ascontiguousarray(times[(times > start) & (times <= end)])
        problem = replace(segment.problem, dq=dq, du=du, dp=along.dp, dinputs=along.dinputs, kept=[])
        of = _Tangents(opened, functions, segment, problem, here)
        of.forwards(memory // len(motion.segments))
        found.append(of)
        if segment is motion.segments[-1]:
            break
        nq, at, within = len(along.q), np.array([end]), np.array([of.middle])
        state = of.at_end(end)
        full = of.functions.along("completion_sensitivities", state[None], at, within)
        dq, du = full["dfull_q"][:, 0], full["dfull_u"][:, 0]
        of.changed = np.concatenate([state[:, :nq], np.concatenate([state[:1, nq:], du])], axis=1)
    return found


def _backwards(tangents: list[_Tangents], wanted: Wanted, number: int) -> tuple[Array, Array, Array]:
    """Gradients of a functional with respect to initial state, parameters and inputs; and their changes."""
    f, by_output, names = wanted.functionals[number], wanted.by_output[number], wanted.output_names
    weights = np.zeros(len(names))
    np.add.at(weights, list(tangents[0].along.integrals), wanted.by_integral[number])
    total: tuple[Array, Array] | None = None
    later: Array | None = None
    for of in reversed(tangents):
        finish = np.zeros(0)
        if later is not None:
            finish, *completed = _changed(of, later)
        here = np.isin(wanted.times, of.times)
        changes = np.zeros((len(of.times), len(names), of.r))
        if isinstance(f, LeastSquares) and len(of.times):
            changes = of_squares(f, of, names)
        event, moved = wanted.crossed[number], None
        if event and event.t in of.times:
            row = int(np.searchsorted(of.times, event.t))
            moved = of_event(event, of, row, by_output[here][row])
            changes[row] = moved.weights
        sources = np.zeros(0)
        if len(of.times):
            sources = of.functions.outputs(of.states, of.times, of.within, by_output[here], changes)[..., :-1].copy()
        if moved:
            sources[row, 1:] += moved.source
        start, p, inputs = of.back(sources, weights, finish)
        if moved:
            inputs[1:] += moved.inputs
        if total is not None and later is not None:
            p, inputs = p + total[0] + completed[0], inputs + total[1] + completed[1]
        total = p, inputs
        later = np.zeros((1 + of.r, of.functions.nq + of.functions.nu))
        later[:, of.free] = start
    assert total is not None and later is not None
    return later, *total


def _changed(of: _Tangents, later: Array) -> tuple[Array, Array, Array]:
    """Gradients and their changes before a change of independent coordinates, from those after it (1 + r, nq + nu).

    The results are with respect to the independent entries (1 + r, free), the parameters and the inputs.
    """
    nq, free, n_p = of.functions.nq, len(of.free), of.functions.np
    by = {
        seed: (later[:1, part], later[1:, part].T[None])
        for seed, part in (("dfull_q", slice(0, nq)), ("dfull_u", slice(nq, None)))
    }
    t, within = np.array([of.end]), np.array([of.middle])
    found = of.functions.transposed("completion_sensitivities_transposed", of.changed[None], t, within, by)[0]
    state, p, inputs = found[:, :free], found[:, free : free + n_p], found[:, free + n_p : -1]
    return np.ascontiguousarray(state), p, by_control_points(of.along.inputs, t, within, inputs)


def _middles(steps: Array) -> Array:
    """Times in the middle of steps."""
    middles: Array = steps[:, 0] + 0.5 * steps[:, 1]
    return middles


__all__ = ["Curvature", "Motion", "Wanted", "check_joints", "check_supported", "curvature_of", "directions_of"]
