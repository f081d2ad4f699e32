"""Integration over time with sensitivities: sets up the problem for ``motion.h``, runs it, and names the results."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, all_finite, is_finite, largest, normalise
from ..assembly.states import States
from ..calls.functions import STATE
from ..calls.non_finite import outputs_without
from ..calls.package import Package
from ..errors import SimulationError
from ..trajectory.events import DIRECTIONS as CROSSINGS
from ..trajectory.events import Crossing, Event, crossing, take_events
from ..trajectory.trajectory import FINISHED, INTERRUPTED, Trajectory
from ..warning import warn
from .controllers import Sampling, sampling_times, with_controlled
from .directions import Directions, take_sensitivities
from .flat_poses import lost_directions, what_is_lost
from .inputs import Inputs
from .lost import SAMPLED, lost_names, why_lost
from .problem import Problem
from .reasons import Reasons
from .results import Run
from .run import Progress, places_in_rows
from .settings import Settings, Start
from .signals import take_inputs

CLOSED = 1e-10
"""Scaled residual below which an initial state needs no assembly."""

STEPS_OF_PRESCRIBED = 100
"""Number of steps of a motion without degrees of freedom and integrals, in which no error limits the step size."""

MEANINGLESS = 1e10
"""Relative change of a result per relative change of a parameter above which a warning says that the motion is chaotic."""


ENDED = {"end": FINISHED, "interrupted": INTERRUPTED, "event": "event"}
"""Values of `Trajectory.ended` for motions that did not fail, by the reasons in `REASONS`."""


class Simulation(Reasons):
    """Integrates motions over time."""

    _names: Trajectory | None = None
    """A trajectory without times, with the names and units of the last motion."""

    def __init__(self, package: Package, states: States):
        super().__init__(package, states)
        self._kinks: dict[Any, tuple[float, str] | None] = {}

    def simulate(
        self, t: Any, first: Start, settings: Settings, events: Any, progress: Progress | None, on_failure: str
    ) -> Trajectory:
        """See `Solver.simulate`."""
        if on_failure not in ("raise", "return"):
            raise ValueError(f"on_failure is {on_failure!r}; allowed are 'raise' and 'return'")
        problem, directions = self._problem(t, first, settings)
        wanted = take_events(self.output_names, events) if events != () else ()
        if wanted:
            problem.events = tuple(
                (self.output_names.index(e.output), e.level, CROSSINGS[e.direction], e.stop) for e in wanted
            )
        run = self._run(problem, progress)
        trajectory = self._trajectory(problem, directions, run)
        self._without_lost(run, problem, directions, trajectory)
        if wanted:
            trajectory.events = tuple(self._crossing(wanted[i], row, problem, directions.k) for i, row in run.events)
        if run.reason == "end":
            for e in wanted:
                if e.stop:
                    warn(
                        f"the event {e.output} = {e.level:g} did not occur by t = {problem.end:g} s; the motion was not stopped"
                    )
        if run.reason not in ("end", "interrupted", "event"):
            message = self._why_it_ended(problem, run)
            if on_failure == "raise":
                raise SimulationError(message, trajectory)
            warn(message)
        if run.counts.get("stiffness", 0.0) > 0:
            warn(
                f"stability, not accuracy, kept the steps of the explicit method {problem.method!r} small (step times largest "
                f"eigenvalue: {run.counts['stiffness']:.1f}); method='radau' is for such models"
            )
        any_derivatives = directions.k and len(trajectory)
        if any_derivatives and self._largest_growth(trajectory, directions, problem, run.rows) > MEANINGLESS:
            warn(meaningless("sensitivities have"))
        if trajectory.views is not None:
            trajectory.views.again = lambda p: self.simulate(t, replace(first, p=p), settings, events, None, on_failure)
        return trajectory

    def _without_lost(self, run: Run, problem: Problem, directions: Directions, trajectory: Trajectory) -> None:
        """Sets derivatives that do not exist after a flat pose to NaN, with a warning."""
        lost = lost_directions(run, directions.dp) if directions.k else []
        for of in lost:
            behind = np.ix_(of.directions, trajectory.t > of.t)
            for derivatives in (trajectory.dq, trajectory.du, trajectory.doutputs):
                derivatives[behind] = np.nan
            for row in (row for _, row in run.events if row[0] > of.t):
                for part in (1, 2, 3, 4):
                    self._derivatives_of_rows(row, problem, directions.k, part)[of.directions] = np.nan
        if lost:
            warn(what_is_lost(lost, directions.names))

    def _warn_of_lost(self, run: Run, problem: Problem, names: tuple[str, ...]) -> set[str]:
        """Warns of directions along which the motion has no derivative after some time; returns the names of these
        directions."""
        lost: set[str] = set()
        for segment in run.segments:
            for row, why, which in segment.lost:
                derivatives = [self._derivatives_of_rows(row, problem, len(names), i) for i in (1, 2, 4)]
                gone = lost_names(np.concatenate(derivatives, axis=1), lost, names)
                lost.update(gone if why != SAMPLED else ())
                if gone:
                    state, entries = self._state_of(row, problem), self._entries(problem)
                    warn(f"{self.name}: {why_lost(segment, why, which, state, entries, gone)}")
        return lost

    def _largest_growth(self, trajectory: Trajectory, directions: Directions, problem: Problem, rows: Array) -> float:
        """The largest relative change of an independent entry per relative change of a parameter, or an upper bound.

        Changes are relative to the largest value in the motion of all entries with the same unit, so the growth does
        not depend on units. Dependent coordinates and speeds are excluded, because they have no derivatives where a
        loop loses rank.
        """
        sizes = np.abs(rows).max(axis=0)
        q, u = (self._of_rows(sizes, i) for i in (1, 2))
        bound = 0.0
        if not directions.given:
            start = 1 + self.nq + self.nu + self.noutputs
            changed = sizes[start : start + directions.k * (self.nq + self.nu)]
            bound = _bound_of_growth(largest(changed), problem, [*q.tolist(), *u.tolist()])
        if 0.0 < bound < MEANINGLESS:
            return bound
        by, q, u = self._sizes_of_directions(directions, q, u, problem)
        growth = 0.0
        for free, derivatives, size in (
            (places(self.independent_names, self.coordinate_names), trajectory.dq, q),
            (places(self.independent_speed_names, self.speed_names), trajectory.du, u),
        ):
            changes = np.abs(derivatives).max(axis=1)[:, free] * by[:, None] / size[free]
            growth = max(growth, float(changes.max(initial=0.0)))
        return growth

    def _sizes_of_directions(
        self, directions: Directions, q: Array, u: Array, problem: Problem
    ) -> tuple[Array, Array, Array]:
        """Steps along directions for a relative change of 1; then the sizes of the entries of q and of u. The size of
        an entry is the largest magnitude among entries of its unit."""
        q = largest_of_unit(q, self._manifest["coordinate_units"])
        u = largest_of_unit(u, self._manifest["speed_units"])
        return direction_sizes(directions, (q, u, problem.p, problem.inputs.values)), q, u

    # -- setting up ---------------------------------------------------------------------------------------------------

    def _problem(self, t: Any, given: Start, settings: Settings) -> tuple[Problem, Directions]:
        """Checks a user's arguments and sets up the motion."""
        if "state_rates" not in self._functions:
            raise AttributeError(self._why_not("simulate"))
        start, end, times = _interval(t)
        q, u, p = given.q, given.u, given.p
        p_all = self._arguments.defaults["p"] if p is None else self._arguments.take({"p": p}, self._left_out)[0]["p"]
        if p_all.ndim != 1:
            raise ValueError(
                f"p has shape {p_all.shape}, expected ({self.np},): one motion at a time; ordernm.simulate_many takes more"
            )
        if p is not None and self.package._masses is not None:
            self.package._masses.test(p_all)
        inputs, at = given.inputs, sampling_times(start, end, given.controller.period) if given.controller else None
        if at is not None:
            inputs, controlled = with_controlled(self.signal_names, inputs, self.moving_inputs, at)
        spline = take_inputs(self.signal_names, inputs, self.moving_inputs, (start, end))
        kink = ""
        if self.prescribed_names:
            spline.check_moving(self.signal_names, start, end)
            end, times, kink = self._before_kinks(start, end, times, p_all, spline)
        directions = take_sensitivities(self, given.sensitivities, given.dq0, given.du0, spline)
        dq, du, k = directions.dq, directions.du, directions.k
        of_model = None
        if k and not directions.given and not self.states.initial_is_fixed:
            along: tuple[Array, Array] | None
            if q is None or u is None:
                of_model = self.states.initial_sensitivities(p_all, directions.dp)
                along = of_model[2:]
            else:
                partly = isinstance(q, Mapping) or isinstance(u, Mapping)
                along = self.states.first_sensitivities(p_all, directions.dp) if partly else None
            if along:
                dq, du = (
                    x + of * self._arguments.omitted(n, given)
                    for x, of, n, given in zip((dq, du), along, "qu", (q, u), strict=True)
                )
        if of_model and q is None and u is None and not self.prescribed_names:
            q_all, u_all = of_model[:2]
        else:
            q_all, u_all = self._first_state(q, u, p_all, spline, start)
        allowed = settings.tolerances("atol", self.nq + self.nu)
        assert allowed is not None
        allowed_directions = None
        if settings.atol_sensitivities is not None:
            allowed_directions = settings.tolerances("atol_sensitivities", k)
        largest_step = settings.largest_step or (0.0 if self.nq + self.nu else (end - start) / STEPS_OF_PRESCRIBED)
        problem = Problem(
            start, end, q_all, u_all, p_all, spline, times, dq, du, directions.dp, directions.dinputs,
            float(settings.rtol), allowed, allowed_directions, settings.method, float(settings.step or 0.0),
            float(largest_step), int(settings.most_steps),
        )  # fmt: skip
        problem.kink = kink
        if given.controller and at is not None:
            problem.sampling = Sampling(given.controller, self.signal_names, controlled, at, spline, directions, p_all)
            problem.dinputs = directions.dinputs
        return problem, directions

    def _before_kinks(
        self, start: float, end: float, times: Array, p: Array, inputs: Inputs
    ) -> tuple[float, Array, str]:
        """End time and result times before the first kink of prescribed motion, and the reason for an earlier end, if
        there is a kink."""
        if "branching_motion" not in self._manifest:
            return end, times, ""
        from .prescribed_branches import before_kinks

        return before_kinks(self._manifest, self._kinks, start, end, times, p, inputs)

    def _first_state(self, q: Numbers, u: Numbers, p: Array, inputs: Inputs, t: float) -> tuple[Array, Array]:
        """A consistent initial state at these parameters, inputs and time."""
        if q is None and u is None and self.states.initial_is_fixed:
            q_all, u_all = self.package._initial
            q_all, u_all = q_all.copy(), u_all.copy()
            normalise(q_all, self._arguments.quaternions)
            return q_all, u_all
        if q is None and u is None and not self.prescribed_names:
            return self.states.initial_state(p)
        first = self.states.first_values(p) if q is None or u is None else (q, u)
        given = {
            "q": first[0] if q is None else q, "u": first[1] if u is None else u, "p": p, "inputs": inputs.at(t), "t": t
        }  # fmt: skip
        arrays, batch = self._arguments.take(given, self._left_out)
        if batch:
            raise ValueError(f"q, u have leading axes {batch}, expected (nq,) and (nu,): one motion at a time")
        if self.closure_names and isinstance(u, Mapping):
            from ..assembly.open_states import warn_of_dependent_speeds

            warn_of_dependent_speeds(self.package, u)
        at = tuple(arrays[name] for name in STATE)
        if self.closure_names and q is not None:
            gaps = np.abs(self._call("closure", at)[0])
            gap = float(np.delete(gaps, self._opened.manifest.get("dropped", [])).max(initial=0.0))
            if gap > CLOSED:
                closed = self.states.assemble(*at)
                # by name, dependent coordinates that are left out are guesses
                off = np.abs(closed[0] - arrays["q"])[np.logical_not(self._arguments.omitted("q", q))]
                if off.max(initial=0.0) > CLOSED:  # more than redundant conditions are open
                    warn(
                        f"the initial state does not close the loops (scaled residual {gap:.3g}); "
                        f"dependent coordinates have been changed"
                    )
                return closed
        q_all, u_all = self.states.assemble(*at)
        if self.closure_names and u is not None and q is not None:
            off = np.abs(u_all - arrays["u"])[np.logical_not(self._arguments.omitted("u", u))].max(initial=0.0)
            if off > 1e-6 * (1.0 + float(np.abs(u_all).max())):
                warn(
                    f"the initial speeds do not keep the loops closed; dependent ones have been changed, by up to {off:.3g}"
                )
        return q_all, u_all

    # -- results -------------------------------------------------------------------------------------------------------

    def _trajectory(self, problem: Problem, directions: Directions, run: Run) -> Trajectory:
        """The trajectory from rows of results."""
        rows, nt, k = run.rows, len(run.rows), directions.k
        (_, *parts, _), shown = places_in_rows(self.nq, self.nu, self.noutputs, 0), self._shown
        t = rows[:, 0].copy()
        q, u, outputs = [rows[:, start : start + size].copy() for start, size, _ in parts]
        if k:
            derivatives = [self._derivatives_of_rows(rows, problem, k, i).transpose(1, 0, 2).copy() for i in (1, 2, 3)]
        else:
            derivatives = list(_no_derivatives(nt, *[size for _, size, _ in parts]))
        lost = self._warn_of_lost(run, problem, directions.names) if k else set()
        if shown:
            kept = [i for i, name in enumerate(directions.names) if name not in lost]
            self._look_at_outputs(problem, run, outputs, derivatives[2][kept] if lost else derivatives[2])
        if shown < self.noutputs:
            outputs, derivatives[2] = outputs[:, :shown], derivatives[2][..., :shown]
        arrays = {
            "t": t, "q": q, "u": u, "dq": derivatives[0], "du": derivatives[1], "outputs": outputs,
            "doutputs": derivatives[2], "p": problem.p.copy(),
            "inputs": problem.inputs.values[0] if problem.inputs.knots is None else None,
        }  # fmt: skip
        later: dict[str, Any] = {"energy": None, "closure": None}
        if "energies" in self._functions and nt:
            later["energy"] = lambda: self._energies_over(t, q, u, problem)
        if self.closure_names and nt:
            later["closure"] = lambda: self._gaps_over(t, q, u, problem)
        ended = ENDED.get(run.reason) or self._why_it_ended(problem, run)
        stats = {"method": problem.method, "reason": ended, **run.counts}
        if self._names is None or self._names.sensitivity_names != directions.names:
            self._names = self._no_motion(directions.names)
        found = self._names.like_this(arrays, later, stats)
        if "display" in self._manifest:
            found.views = self._views_of_motions(lambda: self._inputs_over(t, problem))
        return found

    @cached_property
    def _views_of_motions(self) -> Callable[[Callable[[], Array]], Any]:
        """A function that makes the views of a motion from a function that returns its inputs."""
        from ..display.views import MotionViews, Views

        return partial(MotionViews, Views(self.package))

    @property
    def _shown(self) -> int:
        """Number of outputs that trajectories contain."""
        return self.noutputs if self._gives_outputs else 0

    def _no_motion(self, sensitivity_names: tuple[str, ...]) -> Trajectory:
        """A trajectory without times, with the names and units that all trajectories of this solver have."""
        manifest, shown, k = self._manifest, self._shown, len(sensitivity_names)
        q, u, outputs = (np.empty((0, n)) for n in (self.nq, self.nu, shown))
        dq, du, doutputs = (np.empty((k, *x.shape)) for x in (q, u, outputs))
        return Trajectory(
            self.name, [], q, u, dq, du, outputs, doutputs, coordinate_names=self.coordinate_names,
            speed_names=self.speed_names, output_names=self.output_names[:shown], parameter_names=self.parameter_names,
            input_names=self.signal_names, sensitivity_names=sensitivity_names,
            coordinate_units=manifest.get("coordinate_units", ()), speed_units=manifest.get("speed_units", ()),
            output_units=manifest.get("output_units", ())[:shown], parameter_units=manifest.get("parameter_units", ()),
        )  # fmt: skip

    def _crossing(self, event: Event, row: Array, problem: Problem, k: int) -> Crossing:
        """A crossing from its row of results."""
        values = [self._of_rows(row, i) for i in (1, 2, 3)]
        derivatives = [self._derivatives_of_rows(row, problem, k, i) for i in (1, 2, 3)]
        sizes = np.cumsum([self.nq, self.nu, self.noutputs, k])
        *rates, dt, (pace,) = np.split(row[len(row) - sizes[-1] - 1 :], sizes)
        index = self.output_names.index(event.output)
        return crossing(
            event, index, float(row[0]), values, derivatives, rates, float(pace), dt if pace < 0.0 else None
        )

    def _look_at_outputs(self, problem: Problem, run: Run, outputs: Array, doutputs: Array) -> None:
        """Warns of outputs without a finite value or derivative at a time of the results."""
        if all_finite(outputs) and (not doutputs.size or all_finite(doutputs)):
            return
        of = ~(np.isfinite(outputs) & np.isfinite(doutputs).all(axis=0))
        if not of.any():
            return
        row, among = int(np.argwhere(of)[0, 0]), np.flatnonzero(of.any(axis=0)).tolist()
        state = self._state_of(run.rows[row], problem)
        found = outputs_without(run.opened, state, among, along=bool(len(doutputs)))
        warn(f"{self.name}: outputs of simulate, or their derivatives, are not finite at t = {state['t']:g} s: {found}")

    def _energies_over(self, t: Array, q: Array, u: Array, problem: Problem) -> Array:
        """Kinetic and potential energy over time, (nt, 2)."""
        inputs = self._inputs_over(t, problem)
        return self._call("energies", (q, u, problem.p, inputs, t))[0]

    def _inputs_over(self, t: Array, problem: Problem) -> Array:
        return problem.inputs.at(t) if self.ninputs else np.zeros((len(t), 0))

    def _gaps_over(self, t: Array, q: Array, u: Array, problem: Problem) -> Array:
        """The largest scaled closure residual over time, (nt,), including dropped conditions."""
        gaps = self._call("closure", (q, u, problem.p, self._inputs_over(t, problem), t))[0]
        return np.abs(gaps).max(axis=1, initial=0.0)


@lru_cache(64)
def _no_derivatives(nt: int, *sizes: int) -> tuple[Array, ...]:
    """Empty arrays (0, nt, size), which trajectories may share."""
    return tuple([np.empty((0, nt, size)) for size in sizes])


def meaningless(what: str) -> str:
    """The warning for derivatives that are too large to be meaningful."""
    return (
        f"{what} grown beyond {MEANINGLESS:g}: the motion is chaotic or unstable, and derivatives apply "
        f"only to infinitesimal changes; shorten the time"
    )


def largest_of_unit(sizes: Array, units: Sequence[str]) -> Array:
    """For each entry, the largest magnitude of all entries with the same unit; 1 if all are zero."""
    largest: dict[str, float] = {}
    for size, unit in zip(sizes, units, strict=True):
        largest[unit] = max(largest.get(unit, 0.0), float(size))
    return np.array([largest[unit] or 1.0 for unit in units])


def _bound_of_growth(changed: float, problem: Problem, entries: list[float]) -> float:
    """A fast upper bound of the growth for unit directions of named variables; 0 if not known.

    `changed` is the largest derivative, and `entries` are the largest magnitudes of coordinates and speeds over time.
    """
    sizes = [x for x in entries if x > 0.0]
    most = max([1.0, *sizes, largest(problem.p), largest(problem.inputs.values)])
    return changed * most / min([1.0, *sizes])


def places(names: Sequence[str], among: Sequence[str]) -> list[int]:
    """Indices of some names in a list of names."""
    at = {name: i for i, name in enumerate(among)}
    return [at[name] for name in names]


def direction_sizes(directions: Directions, sizes: tuple[Array, Array, Array, Array]) -> Array:
    """(k,): the step along each direction that changes its variables by a relative amount of 1.

    `sizes` are the magnitudes of q, u, p and of the inputs' control points (count, nsignals); zeros are replaced by 1.
    """
    seeds = (directions.dq, directions.du, directions.dp, directions.dinputs)
    moved = np.zeros(directions.k)
    for seed, size in zip(seeds, sizes, strict=True):
        if seed is not None and seed.any():
            parts = np.abs(seed) / np.where(size == 0.0, 1.0, np.abs(size))
            moved = np.maximum(moved, parts.reshape(directions.k, -1).max(axis=1))
    return np.divide(1.0, moved, where=moved > 0.0, out=np.zeros(directions.k))


def _interval(t: Any) -> tuple[float, float, Array]:
    """Start and end of a motion, and the times of its results."""
    if type(t) is float and 0.0 < t < math.inf:
        return 0.0, t, np.empty(0)
    try:
        times = np.asarray(t, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"t: {error}; expected a number of seconds, or times (nt,)") from None
    if times.ndim > 1 or not times.size or not is_finite(times.reshape(-1)):
        raise ValueError(
            f"t has shape {times.shape}, or entries that are not finite; expected seconds, or increasing times (nt,)"
        )
    if times.ndim == 0:
        if times <= 0:
            raise ValueError(f"t is {float(times):g} s, expected a positive number, or times (nt,)")
        return 0.0, float(times), np.empty(0)
    if len(times) < 2 or not _rise(times):
        raise ValueError("t: times must increase, from the start of the motion to its end; at least two are needed")
    return float(times[0]), float(times[-1]), times


def _rise(times: Array) -> bool:
    """Whether times increase strictly."""
    return bool(times[1] > times[0]) if len(times) == 2 else bool((times[1:] > times[:-1]).all())
