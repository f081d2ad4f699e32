"""Functionals of motions and their gradients, by forward sensitivities or by the discrete adjoint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..assembly.states import States
from ..calls.arguments import some
from ..calls.non_finite import outputs_without
from ..calls.package import Package
from ..calls.targets import Opened
from ..errors import SimulationError
from ..statics.jets import Jet
from ..statics.second_derivatives import SecondDerivatives
from ..trajectory.events import BY_STATE, Crossing, Event, crossing_speed
from ..trajectory.events import DIRECTIONS as CROSSINGS
from ..warning import warn
from .adjoint import Adjoint, segment_backwards
from .directions import Directions
from .flat_poses import lost_directions, what_is_lost
from .functionals import (
    At,
    AtEvent,
    Final,
    Functional,
    Integral,
    Judged,
    LeastSquares,
    WeightedResults,
    check_functionals,
)
from .hessians import Motion, Wanted, check_joints, check_supported, curvature_of, directions_of
from .problem import Problem
from .results import Run
from .settings import Settings, Start
from .simulation import MEANINGLESS, Simulation, meaningless
from .weights_along import Crossed

GRADIENTS = ("auto", "forward", "adjoint")

MEMORY = 256 * 2**20
"""Bytes for the kept steps of a motion. Further steps are computed again for the adjoint."""

COSTS = {False: (0.0, 3.0, 4.4, 9.0), True: (1.3, 0.8, 2.5, 3.5)}
"""Costs of gradients, relative to a motion without derivatives, for explicit methods (False) and the implicit one
(True). The first two are for forward differentiation: a constant cost, and the cost of every eight directions. The last
two are for the adjoint: the cost with one functional, and with two to eight."""


@dataclass(slots=True, eq=False)
class Weights:
    """Derivatives of functionals with respect to outputs (m, nt, noutputs) at times (nt,), and to integrals (m, nintegrals).

    `states` contains derivatives with respect to coordinates and speeds at these times (m, nt, nq + nu); (m, nt, 0) if all
    are zero. `behind` contains the times (n,) of events at which outputs jump, and derivatives with respect to outputs after
    the jumps (m, n, noutputs) and to the times of jumps that a switch causes (m, n).
    """

    times: Array
    outputs: Array
    states: Array
    behind: tuple[Array, Array, Array]
    integrals: Array

    def after(self, t: float) -> Any:
        """Whether functionals (m,) depend on results after time t."""
        later = self.times > t
        times, of_outputs, of_times = self.behind
        parts = (self.outputs[:, later], self.states[:, later], of_outputs[:, times > t], of_times[:, times > t, None])
        return np.any([(x != 0.0).any(axis=(1, 2)) for x in parts], axis=0) | (self.integrals != 0.0).any(axis=1)


class FunctionalGradients(Simulation):
    """Computes functionals of motions, their gradients and Hessian products."""

    def __init__(self, package: Package, states: States):
        super().__init__(package, states)
        self._on_duals: dict[int, SecondDerivatives] = {}

    def judge(
        self,
        t: Any,
        functionals: Functional | Sequence[Functional],
        first: Start,
        method: str,
        settings: Settings,
        memory: int,
        hessian: Any = None,
    ) -> Judged:
        """See `Solver.judge`."""
        if method not in GRADIENTS:
            raise ValueError(f"method is {method!r}; allowed are {', '.join(map(repr, GRADIENTS))}")
        ends = np.atleast_1d(np.asarray(t, float))
        if ends.shape not in ((1,), (2,)):
            raise ValueError(f"t is {t!r}, expected the end of the motion, or its start and end, s")
        start, end = (0.0, float(ends[0])) if len(ends) == 1 else (float(ends[0]), float(ends[1]))
        if not start < end:
            raise ValueError(f"t is {t!r}: the end must be later than the start, {start:g} s")
        self._find(self._opened, "outputs")
        wanted = check_functionals(functionals, self.output_names, start, end)
        times = {start, end}
        for f in wanted:
            times.update(
                [f.t]
                if isinstance(f, At)
                else np.asarray(f.times, float).tolist()
                if isinstance(f, (LeastSquares, WeightedResults))
                else ()
            )
        events = list(dict.fromkeys(f.event for f in wanted if isinstance(f, AtEvent)))
        integrals = list(dict.fromkeys(self.output_names.index(f.output) for f in wanted if isinstance(f, Integral)))
        problem, directions = self._problem(sorted(times), first, settings)
        problem.integrals = tuple(integrals)
        problem.atol = np.append(problem.atol, np.full(len(integrals), np.min(settings.atol)))
        problem.events = tuple(
            (self.output_names.index(e.output), e.level, CROSSINGS[e.direction], e.stop) for e in events
        )
        along = directions_of(hessian, directions.names)
        if along is not None:
            return self._with_hessian(wanted, events, problem, directions, along, first, memory)
        way = self._way(method, len(wanted), directions.k, settings.method)
        found = None if way != "adjoint" else self._by_adjoint(wanted, events, problem, directions, memory)
        if (
            found is None
        ):  # the method is forward, or the adjoint found that derivatives along some directions may not exist
            way = "forward" if directions.k else "none"
            found = self._by_directions(wanted, events, problem, directions)
        return Judged(*found[:2], directions.names, way, found[2])

    def _by_directions(
        self, wanted: list[Functional], events: list[Event], problem: Problem, directions: Directions
    ) -> tuple[Array, Array, dict[str, Any]]:
        """Values, gradients and counts of a motion with forward sensitivities."""
        run, k = self._run(problem), directions.k
        crossings, values, weights = self._values(wanted, events, problem, run, directions)
        if not k:
            return values, np.zeros((len(wanted), 0)), run.counts
        gradients = self._forward(wanted, problem, run, crossings, weights, k)
        lost = self._warn_of_lost(run, problem, directions.names)
        self._check(gradients, weights, directions, problem, run, lost)
        return values, gradients, run.counts

    def _by_adjoint(
        self, wanted: list[Functional], events: list[Event], along: Problem, directions: Directions, memory: int
    ) -> tuple[Array, Array, dict[str, Any]] | None:
        """Values and gradients by the adjoint method; None if a derivative may not exist along some direction."""
        problem = replace(along, dq=along.dq[:0], du=along.du[:0], dp=along.dp[:0], dinputs=None, kept=[])
        run = self._run(problem, keep_steps=True, memory=memory)
        if any(s.together or s.lost for s in run.segments):
            return None
        nothing = Directions((), directions.dq, directions.du, directions.dp, None, True)
        _, values, weights = self._values(wanted, events, problem, run, nothing)
        back = self._backwards(run, weights)
        gradients = back.q @ along.dq.T + back.u @ along.du.T + back.p @ directions.dp.T
        if along.dinputs is not None:
            gradients = gradients + np.einsum("mci,kci->mk", back.inputs, along.dinputs)
        if not np.isfinite(gradients).all():
            return None
        self._check(gradients, weights, directions, problem, run, set())
        return values, gradients, run.counts | {f"adjoint_{name}": n for name, n in back.counts.items()}

    def _with_hessian(
        self,
        wanted: list[Functional],
        events: list[Event],
        along: Problem,
        directions: Directions,
        factors: Array,
        first: Start,
        memory: int,
    ) -> Judged:
        """Values, gradients and Hessian products along combinations (r, k) of the directions."""
        check_joints(self.name, self._motion(self._opened)[2])
        check_supported(self, wanted)
        problem = replace(along, dq=along.dq[:0], du=along.du[:0], dp=along.dp[:0], dinputs=None, kept=[])
        run = self._run(problem, keep_steps=True, memory=memory)
        nothing = Directions((), directions.dq, directions.du, directions.dp, None, True)
        crossings, values, weights = self._values(wanted, events, problem, run, nothing)
        crossed = [self._crossed(crossings[f.event]) if isinstance(f, AtEvent) else None for f in wanted]
        dinputs = None if along.dinputs is None else np.einsum("rk,kci->rci", factors, along.dinputs)
        combined = replace(
            along, dq=factors @ along.dq, du=factors @ along.du, dp=factors @ along.dp, dinputs=dinputs, kept=[]
        )
        motion = Motion(run.segments, [self._dual(s.opened) for s in run.segments], [])
        for s in run.segments:
            motion.opened.append(self._motion(s.opened))
            check_joints(self.name, motion.opened[-1][2])
            self._in_c(s.opened).run_backwards(motion.opened[-1][2])
        asked = Wanted(wanted, weights.times, weights.outputs, weights.integrals, self.output_names, crossed)
        found = curvature_of(motion, combined, asked, memory)
        changes = found.state @ np.concatenate([along.dq, along.du], axis=1).T + found.p @ directions.dp.T
        if along.dinputs is not None:
            changes = changes + np.einsum("mrci,kci->mrk", found.inputs, along.dinputs)
        gradients, products = changes[:, 0].copy(), changes[:, 1:].copy()
        if not directions.given:
            products += self._of_first_state(found.state[:, 0], directions.dp, factors, first, problem)
        self._check(gradients, weights, directions, problem, run, set())
        for i, lost in enumerate(~np.isfinite(gradients)):  # without a first derivative there is no second one
            products[i][:, lost] = np.nan
            products[i][(factors[:, lost] != 0.0).any(axis=1)] = np.nan
        if not np.isfinite(products).all():
            warn(
                f"{self.name}: Hessian products of judge are not finite: second derivatives do not exist in this motion"
            )
        counts = run.counts | {"hessian_products": found.products}
        return Judged(values, gradients, directions.names, "adjoint", counts, products)

    def _crossed(self, c: Crossing) -> Crossed:
        """The data of an event that second derivatives need; raises ValueError if its output jumps over the level."""
        if c.pace < 0.0:
            raise ValueError(
                f"hessian: {c.event.output} jumps over the level {c.event.level:g} of an event at t = {c.t:.9g} s, but hessian "
                "needs outputs that are continuous at their events. Gradients are available without hessian"
            )
        index = self.output_names.index(c.event.output)
        return Crossed(c.t, index, crossing_speed(c.rates, c.pace, index))

    def _dual(self, opened: Opened) -> SecondDerivatives:
        """The functions of a partition on dual numbers; loaded once."""
        if opened.number not in self._on_duals:
            self._on_duals[opened.number] = SecondDerivatives(opened)
        return self._on_duals[opened.number]

    def _of_first_state(self, by_state: Array, dp: Array, factors: Array, first: Start, problem: Problem) -> Array:
        """Contribution (m, r, k) of second derivatives of the model's initial state, a function of the parameters."""
        omitted = np.concatenate([self._arguments.omitted("q", first.q), self._arguments.omitted("u", first.u)])
        total = np.zeros((len(by_state), len(factors), len(dp)))
        if "initial_at_rest" in self._manifest and omitted.any():
            raise ValueError(
                "hessian: the model's initial state is an equilibrium that depends on parameters, but hessian "
                "needs numbers or formulas as initial values. Give q and u of that equilibrium, which then count as constant"
            )
        if not omitted.any() or not self.package._has("initial_sensitivities"):
            return total
        slope = np.concatenate(list(self.initial_curvature(problem.p, dp, factors @ dp).values()), axis=1)
        total += np.einsum("mi,kir->mrk", by_state * omitted, slope)
        return total

    def initial_curvature(self, p: Array, dp: Array, along: Array | None = None) -> dict[str, Array]:
        """Second derivatives of initial values that are formulas of p, along dp (k, np) and `along` (r, np): q (k, nq, r) and
        u (k, nu, r)."""
        functions = self._dual(self._opened)
        jet = Jet(p, (dp if along is None else along).T)
        found = functions.along("initial_sensitivities", {"p": jet}, {"dp": dp})
        by_name = dict(zip(functions.functions["initial_sensitivities"].results, found, strict=True))
        return {"q": by_name["dq"].slope, "u": by_name["du"].slope}

    def _values(
        self, wanted: list[Functional], events: list[Event], problem: Problem, run: Run, directions: Directions
    ) -> tuple[dict[Event, Crossing], Array, Weights]:
        """First occurrences of events, values of functionals, and their derivatives with respect to outputs."""
        if run.reason not in ("end", "event"):
            raise SimulationError(self._why_it_ended(problem, run), self._trajectory(problem, directions, run))
        crossings = self._first_crossings(events, problem, run, directions.k)
        return crossings, *self._weighed(wanted, problem, run, crossings)

    def _check(
        self, gradients: Array, weights: Weights, directions: Directions, problem: Problem, run: Run, lost: set[str]
    ) -> None:
        """Warns of gradients that are too large, or not finite without a known reason."""
        self._look_at_growth(gradients, weights, directions, problem, run)
        kept = [i for i, name in enumerate(directions.names) if name not in lost]
        self._look_for_infinite(gradients[:, kept], weights, [directions.names[i] for i in kept], problem, run)
        self._take_lost(gradients, weights, directions, run)

    def _take_lost(self, gradients: Array, weights: Weights, directions: Directions, run: Run) -> None:
        """Sets gradients to NaN, with a warning, along directions that have no derivative after a flat pose."""
        taken = []
        for of in lost_directions(run, directions.dp):
            behind = weights.after(of.t)
            if behind.any():
                gradients[np.ix_(behind, of.directions)] = np.nan
                taken.append(of)
        if taken:
            warn(what_is_lost(taken, directions.names))

    def _look_at_growth(
        self, gradients: Array, weights: Weights, directions: Directions, problem: Problem, run: Run
    ) -> None:
        """Warns of enormous relative gradients: relative change of outputs per relative change of a parameter."""
        q, u, outputs, integrals = (np.abs(self._of_rows(run.rows, i, problem)).max(axis=0) for i in (1, 2, 3, 4))
        outputs, integrals = (np.where(x == 0.0, 1.0, x) for x in (outputs, integrals))
        outputs[~weights.outputs.any(axis=(0, 1))] = 1.0  # no functional depends on these outputs
        by, q, u = self._sizes_of_directions(directions, q, u, problem)
        by_behind = np.abs(weights.behind[1]).sum(axis=1) @ outputs + np.abs(weights.behind[2]).sum(axis=1)
        whole = np.abs(weights.outputs).sum(axis=1) @ outputs + by_behind + np.abs(weights.integrals) @ integrals
        if weights.states.size:
            whole += np.abs(weights.states).sum(axis=1) @ np.concatenate([q, u])
        if (np.isfinite(gradients) & (np.abs(gradients) * by > MEANINGLESS * whole[:, None])).any():
            warn(meaningless("gradients have"))

    def _look_for_infinite(
        self, gradients: Array, weights: Weights, names: list[str], problem: Problem, run: Run
    ) -> None:
        """Warns of gradients that are not finite; if outputs are the cause, the warning names these."""
        bad = ~np.isfinite(gradients)
        if not bad.any():
            return
        by = some([names[j] for j in np.flatnonzero(bad.any(axis=0))])
        times, reason = np.searchsorted(weights.times, run.rows[:, 0]), ""
        for row, place in zip(run.rows, times, strict=True):
            asked = np.flatnonzero(weights.outputs[:, place].any(axis=0))
            state = self._state_of(row, problem)
            if len(asked) and (reason := outputs_without(run.opened, state, asked.tolist(), along=True, certain=True)):
                reason = f": at t = {state['t']:g} s {reason} is not finite"
                break
        warn(f"{self.name}: the gradients of judge with respect to {by} are not finite{reason}")

    def _weighed(
        self, wanted: list[Functional], problem: Problem, run: Run, crossings: dict[Event, Crossing]
    ) -> tuple[Array, Weights]:
        """Values of functionals, and their derivatives with respect to outputs and integrals."""
        m = len(wanted)
        t, outputs = run.rows[:, 0], self._of_rows(run.rows, 3)
        integrals = self._of_rows(run.rows, 4, problem)
        happened = sorted({c.t for c in crossings.values() if c.pace >= 0.0})
        behind = np.array(sorted({c.t for c in crossings.values() if c.pace < 0.0}))
        by_behind, by_time = np.zeros((m, len(behind), self.noutputs)), np.zeros((m, len(behind)))
        times = np.array(sorted({*t.tolist(), *happened}))
        places = np.searchsorted(times, t)
        values = np.zeros(m)
        by_output = np.zeros((m, len(times), self.noutputs))
        of_states = any(isinstance(f, WeightedResults) for f in wanted)
        by_state = np.zeros((m, len(times), self.nq + self.nu if of_states else 0))
        by_integral = np.zeros((m, len(problem.integrals)))
        ended = run.reason == "end"
        for i, f in enumerate(wanted):
            match f:
                case Final() | At():
                    at = problem.end if isinstance(f, Final) else f.t
                    row = _row_at(t, at, f.output, run)
                    o = self.output_names.index(f.output)
                    values[i] = outputs[row, o]
                    by_output[i, places[row], o] = 1.0
                case Integral():
                    if not ended:
                        raise SimulationError(
                            f"the integral of {f.output}: an event has ended the motion before t = {problem.end:g} s",
                            None,
                        )
                    n = problem.integrals.index(self.output_names.index(f.output))
                    values[i] = integrals[-1, n]
                    by_integral[i, n] = 1.0
                case AtEvent():
                    c = crossings[f.event]
                    of = None if f.output == "t" else self.output_names.index(f.output)
                    values[i] = c.t if of is None else c.outputs[of]
                    jumped = c.pace < 0.0
                    row = int(np.searchsorted(behind if jumped else times, c.t))
                    if of is not None:
                        (by_behind if jumped else by_output)[i, row, of] = 1.0
                    rate = 1.0 if of is None else c.rates[of]
                    if not jumped:
                        g = self.output_names.index(f.event.output)
                        by_output[i, row, g] -= rate / crossing_speed(c.rates, c.pace, g)
                    elif c.pace == BY_STATE:
                        by_time[i, row] = rate
                case LeastSquares():
                    rows = _rows_at(t, f.times, run)
                    error, weight = f.residuals(outputs[rows], self.output_names)
                    values[i] = 0.5 * float(np.sum(error * error))
                    by_output[i, places[rows]] += error * weight
                case WeightedResults():
                    rows = _rows_at(t, f.times, run)
                    states = run.rows[rows, 1 : 1 + self.nq + self.nu]
                    values[i] = np.sum(f.states * states) + np.sum(f.outputs * outputs[rows])
                    by_state[i, places[rows]], by_output[i, places[rows]] = f.states, f.outputs
        return values, Weights(times, by_output, by_state, (behind, by_behind, by_time), by_integral)

    def _forward(
        self,
        wanted: list[Functional],
        problem: Problem,
        run: Run,
        crossings: dict[Event, Crossing],
        weights: Weights,
        k: int,
    ) -> Array:
        """Gradients of functionals from forward sensitivities."""
        parts = (3, 1, 2) if weights.states.size else (3,)
        results = np.concatenate([self._derivatives_of_rows(run.rows, problem, k, i) for i in parts], axis=-1)
        dintegrals = self._derivatives_of_rows(run.rows, problem, k, 4)
        places = np.searchsorted(weights.times, run.rows[:, 0])
        found = np.zeros((len(wanted), k))
        for i, of in enumerate(np.concatenate([weights.outputs, weights.states], axis=-1)[:, places]):
            rows, which = np.nonzero(of)  # results without weight may be infinite
            found[i] = of[rows, which] @ results[rows, :, which]
            asked = np.flatnonzero(weights.integrals[i])
            found[i] += weights.integrals[i, asked] @ dintegrals[-1][:, asked].T
        for i, f in enumerate(wanted):
            if isinstance(f, AtEvent):
                c = crossings[f.event]
                found[i] = c.dt if f.output == "t" else c.doutputs[:, self.output_names.index(f.output)]
        return found

    def _backwards(self, run: Run, weights: Weights) -> Adjoint:
        """Gradients by the adjoint, segment by segment from the end."""
        m = len(weights.outputs)
        end_q, end_u = np.zeros((m, self.nq)), np.zeros((m, self.nu))
        total: Adjoint | None = None
        whole: tuple[Array, Array] | None = None
        for number, segment in reversed(list(enumerate(run.segments))):
            start, end = segment.problem.start if number else -math.inf, segment.t
            within = (weights.times > start) & (weights.times <= end)
            # events at the time between two segments belong to the later segment
            times, of_outputs, of_times = weights.behind
            begun = (times >= start) & ((times < end) | (number + 1 == len(run.segments)))
            behind = times[begun], of_outputs[:, begun], of_times[:, begun]
            motion = self._motion(segment.opened)
            self._in_c(segment.opened).run_backwards(motion[2])
            found = segment_backwards(
                motion, segment, weights.times[within], weights.outputs[:, within], weights.states[:, within],
                behind, weights.integrals, end_q, end_u, whole,
            )  # fmt: skip
            if total is not None:
                found.p += total.p
                found.inputs += total.inputs
                found.counts = {name: n + total.counts[name] for name, n in found.counts.items()}
            total = found
            # the previous segment completed this state with its own independent coordinates
            end_q, end_u, whole = found.q, found.u, (segment.problem.q, segment.problem.u)
        assert total is not None
        return total

    @staticmethod
    def _way(method: str, m: int, k: int, integrator: str) -> str:
        """The cheaper of the two methods, unless the user has chosen one."""
        if not k:
            return "none"
        if method != "auto":
            return method
        some, every_eight, one, up_to_eight = COSTS[integrator == "radau"]
        forward = some + every_eight * -(-k // 8)
        adjoint = one if m == 1 else up_to_eight * -(-m // 8)
        return "forward" if forward <= adjoint else "adjoint"

    def _first_crossings(self, events: list[Event], problem: Problem, run: Run, k: int) -> dict[Event, Crossing]:
        """The first occurrence of each event."""
        found: dict[Event, Crossing] = {}
        for i, row in run.events:
            if events[i] not in found:
                found[events[i]] = self._crossing(events[i], row, problem, k)
        for e in events:
            if e not in found:
                raise SimulationError(
                    f"the event {e.output} = {e.level:g} did not occur by t = {run.counts['t']:.9g} s", None
                )
        return found


def _rows_at(t: Array, times: Any, run: Run) -> Any:
    """The rows of the results at samples."""
    rows = np.searchsorted(t, np.asarray(times, float))
    if rows.size and rows[-1] == len(t):
        raise SimulationError(f"an event has ended the motion before the last sample, at {run.counts['t']:.9g} s", None)
    return rows


def _row_at(t: Array, at: float, output: str, run: Run) -> int:
    """The row of the results at the time `at`."""
    row = int(np.searchsorted(t, at))
    if row == len(t) or t[row] != at:
        raise SimulationError(
            f"{output} at t = {at:g} s is requested, but an event has ended the motion at {run.counts['t']:.9g} s; use AtEvent",
            None,
        )
    return row
