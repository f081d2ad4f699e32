"""Runs a motion in slices of time, between which it handles Ctrl-C, full memory, and changes of independent coordinates."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from ..arrays import Array
from ..assembly.partitions import conditions
from ..assembly.states import States
from ..calls.arguments import Seeds
from ..calls.package import Package
from ..calls.room import Room
from ..calls.targets import Opened, partitions_of
from ..errors import CompileError, NoCompilerError, SingularLoopError
from ..files.compiling import seconds_waited
from ..warning import warn
from .controllers import Sampling
from .library import four_lanes, motion_library, precise_functions
from .problem import REASONS, Problem
from .results import Run, Segment
from .switches import event_order_matters, not_held, order_matters, passed_late, touched

SLICE = 0.1
"""Seconds of integration between two checks for Ctrl-C."""

POOR = 30.0
"""Condition number of loops above which other independent coordinates are considered."""

POOR_OF_CONSTANT_STEPS = 10.0
"""Like `POOR`, for constant steps, which cannot become smaller near a poorly conditioned pose."""

BETTER = 4.0
"""A motion changes to other independent coordinates if these reduce the condition number by at least this factor."""

COARSE = 3e-6
"""Sum of errors of constant steps, relative to the state, above which there is a warning."""

COARSE_ALONG = 1e-5
"""Sum of errors of derivatives along the motion, relative to its rates, above which there is a warning."""

COUNTS = {
    "t": "t", "steps": "accepted", "rejected": "rejected", "evaluations": "evaluations",
    "closing_steps": "closing_steps", "condition": "condition", "jacobians": "jacobians",
    "factorizations": "factorizations", "stiffness": "stiffness",
}  # fmt: skip
"""Members of ``ordernm_results`` with the counts of a motion."""

Progress = Callable[[float, float], None]


class MotionRun(Room):
    """Runs motions by the integrators."""

    def __init__(self, package: Package, states: States):
        super().__init__(package)
        self.states = states
        self._known_systems: dict[int, tuple[Any, Any, Any]] = {}

    def prepare(self, member: str) -> None:
        """Compiles the code that `simulate` or `judge` needs; see `Solver.prepare`."""
        opened = self._opened
        system = self._motion(opened)[2]
        if member == "judge" and "sensitivities_transposed" in opened.functions:
            self._in_c(opened).run_backwards(system)
        name = opened.manifest["name"]
        if (opened.folder / f"{name}_four.c").is_file():
            _four(opened)
        if (opened.folder / f"{name}_precise.c").is_file():
            _precise(opened)

    def _motion(self, opened: Opened) -> tuple[Any, Any, Any]:
        """The library of integrators, its cffi interface, and the partition's ``ordernm_system``; integrators need compiled
        code."""
        if opened.number not in self._known_systems:
            try:
                address = self._in_c(opened).motion_system()
                library, ffi = motion_library(self.folder)
            except NoCompilerError as error:
                raise NoCompilerError(f"motions are integrated in compiled code, and {error}") from None
            self._known_systems[opened.number] = library, ffi, ffi.cast("ordernm_system *", address)
        library, ffi, system = self._known_systems[opened.number]
        return library, ffi, ffi.new("ordernm_system *", system[0])

    def _run(
        self, problem: Problem, progress: Progress | None = None, keep_steps: bool = False, memory: int = 2**62
    ) -> Run:
        """Runs a motion to its end; `memory` limits the bytes of kept steps."""
        self._ask_for_functions(problem, keep_steps)
        opened, began, waited = self._opened, time.perf_counter(), seconds_waited()
        several = len(partitions_of(self._manifest)) > 1
        rows: list[Array] = []
        segments: list[Segment] = []
        events: list[tuple[int, Array]] = []
        constant = problem.fixed or problem.method == "rk4"
        left = replace(problem, poor=POOR_OF_CONSTANT_STEPS if constant else POOR) if several else problem
        before: Array | None = None
        tried: set[int] = set()
        while True:
            segment, found, last = self._segment(opened, left, progress, keep_steps, memory)
            if before is not None:
                self._carry_integrals(left, before, [found, *(row[None] for _, row in segment.events)], last)
            if segment.events:
                events += _new_events(events, segment)
            rows.append(found[1:] if before is not None and not len(left.times) else found)
            segments.append(segment)
            if "switches" in self._manifest:
                self._warn_of(segment, bool(len(problem.dp)) or keep_steps)
            if segment.reason != "poor" and not (several and segment.reason == "undetermined"):
                break
            tried = {opened.number} if segment.t > left.start else tried | {opened.number}
            other, left = self._go_on(opened, left, segment, last, tried)
            if other is opened and segment.reason != "poor":
                break
            opened, before = other, last
        if constant:
            self._warn_of_coarse(problem, segments)
        waited = seconds_waited() - waited
        times = {"seconds": time.perf_counter() - began - waited} | ({"compiling": waited} if waited else {})
        counts = self._counts(problem, segments, times)
        reason = problem.kink if segment.reason == "end" and problem.kink else segment.reason
        whole = np.concatenate(rows) if len(rows) > 1 else rows[0]
        return Run(whole, reason, counts, segment.r.singular, segment.r.component, events, segments, last)

    def _warn_of(self, segment: Segment, along: bool) -> None:
        """Warns of switches that affect derivatives or were passed late; `along`: the motion has derivatives."""
        r, manifest = segment.r, segment.opened.manifest
        if r.grazed:
            warn(touched(manifest, r.grazed - 1))
        if r.not_held and along:
            warn(not_held(manifest, r.not_held - 1))
        if segment.late:
            warn(passed_late(manifest, *segment.late))
        if r.ordered and segment.together:
            warn(order_matters(manifest, *segment.together))
        if r.event_ordered and segment.together:
            output, level, *_ = segment.problem.events[r.event_together - 1]
            event = f"{self.output_names[output]} = {level:g}"
            warn(event_order_matters(manifest, *segment.together[:2], event))

    def _entries(self, problem: Problem) -> list[str]:
        """Names of the integrated variables, in order."""
        manifest = self._opened.manifest
        names = [f"q.{n}" for n in manifest["independent_names"]]
        names += [f"u.{n}" for n in manifest["independent_speed_names"]]
        names += [f"integral {i}" for i in range(len(problem.integrals))]
        if not self.independent_speed_names:  # without independent speeds, dependent coordinates are integrated
            names += [f"q.{n}" for n in self.coordinate_names]
        return names

    def _warn_of_coarse(self, problem: Problem, segments: list[Segment]) -> None:
        """Warns of constant steps that do not resolve the motion, or its derivatives."""
        found = [s.r for s in segments]
        values, along = math.fsum(r.coarse for r in found), math.fsum(r.coarse_along for r in found)
        if not (values > COARSE or along > COARSE_ALONG):
            return
        worst = max(found, key=lambda r: r.coarsest if values > COARSE else r.coarsest_along)
        t = worst.coarse_at if values > COARSE else worst.coarse_along_at
        steep = f"a force or an integrated output changes steeply, most likely with {self._entries(problem)[worst.coarse_entry]}"
        loops = "loops may come near a loss of rank"
        places = ([loops] if self.closure_names else []) + ([steep] if along or not self.closure_names else [])
        errors = [f"errors of steps add up to about {values:.1g} of the state"] if values > COARSE else []
        errors += [f"errors of derivatives add up to about {along:.1g} of the rates"] if along > COARSE_ALONG else []
        warn(
            f"steps of {problem.step:g} s do not resolve the motion, least of all at t = {t:.9g} s, where {' or '.join(places)}: "
            f"{', '.join(errors)}; take smaller ones, or method='dop853'"
        )

    def _counts(self, problem: Problem, segments: list[Segment], times: dict[str, float]) -> dict[str, Any]:
        """Counts and times of all segments that apply to this method and model."""
        names = _counted(bool(self.closure_names), problem.method, problem.fixed)
        counts = {name: getattr(segments[-1].r, COUNTS[name]) for name in names}
        if len(segments) > 1:
            for name in names[1:]:
                of_all = max if name in ("condition", "stiffness") else sum
                counts[name] = of_all(getattr(s.r, COUNTS[name]) for s in segments)
        if len(partitions_of(self._manifest)) > 1:
            counts["partitions_changed"] = len(segments) - 1
        return counts | times

    def _ask_for_functions(self, problem: Problem, backwards: bool) -> None:
        """Raises AttributeError if the package lacks a function that the motion needs, because the C code cannot report this."""
        if "left_out" not in self._manifest:
            return
        along, outputs = len(problem.dp) > 0, bool(problem.events or problem.integrals)
        several = len(partitions_of(self._manifest)) > 1
        jacobian = problem.method == "radau"
        wanted = {
            "state_rates": True, "closing_step": bool(self.closure_names), "outputs": outputs,
            "state_rate_sensitivities": along or jacobian,
            "completion_sensitivities": (along or several) and bool(self.closure_names),
            "output_sensitivities": (along and self._gives_outputs) or bool(problem.events),
            "coordinate_rates": bool(problem.events),
            "sensitivities_transposed": backwards, "output_sensitivities_transposed": backwards,
            "coordinate_rate_sensitivities_transposed": backwards and self.coordinate_names != self.speed_names,
            "completion_sensitivities_transposed": backwards and bool(self.closure_names),
        }  # fmt: skip
        for name, needed in wanted.items():
            if needed:
                self._find(self._opened, name)

    @property
    def _gives_outputs(self) -> bool:
        """Whether rows of results contain outputs; a package of selected functions may lack the function for
        outputs."""
        return bool(self.output_names) and "outputs" in self._functions

    # -- other independent coordinates ---------------------------------------------------------------------------------

    def _go_on(
        self, opened: Opened, problem: Problem, segment: Segment, last: Array, tried: set[int]
    ) -> tuple[Opened, Problem]:
        """The partition with which a motion continues, and the remaining motion.

        Partitions in `tried`, including the one in use, were already used at this time and are not used again. If
        constant steps are inaccurate with every partition, the last one is used.
        """
        k = len(problem.dp)
        q, u = (self._of_rows(last, i).copy() for i in (1, 2))
        dq, du = (self._derivatives_of_rows(last, problem, k, i).copy() for i in (1, 2))
        choices = conditions(self.package, q, problem.p, problem.inputs.at(float(last[0])), float(last[0]))
        choices[list(tried)] = math.inf
        other = int(np.argmin(choices))
        here, there = segment.condition, float(choices[other])
        t, r = segment.t, segment.r
        better = there * BETTER < here
        if not better and there < here * BETTER:  # a loop loses rank with any choice of independent coordinates
            growth = [
                math.inf if k in tried - {opened.number} else self._growth(self._open(k), q, problem.p)
                for k in range(len(choices))
            ]
            other = int(np.argmin(growth))
            better = growth[other] * BETTER < growth[opened.number]
        if better:
            opened = self._open(other)
        left = replace(
            problem, start=t, q=q, u=u, dq=dq, du=du, times=problem.times[problem.times > t],
            looked_at=0.0 if better else here, kept=[],
            step=problem.step if problem.fixed or problem.method == "rk4" else r.next_step,
            most_steps=max(problem.most_steps - r.accepted - r.rejected, 1),
        )  # fmt: skip
        return opened, left

    def _growth(self, opened: Opened, q: Array, p: Array) -> float:
        """The largest speed caused by a unit independent speed; infinite if a loop has lost rank."""
        f = self._find(opened, "completion_sensitivities")
        free = [self.speed_names.index(n) for n in opened.manifest["independent_speed_names"]]
        units = np.eye(self.nu)[free]
        try:
            *_, du = opened.target.compute(
                f, {"q": q, "u": np.zeros(self.nu), "p": p}, (), Seeds({"du": units}, len(free))
            )
        except SingularLoopError:
            return math.inf
        return float(np.abs(du).max())

    def _carry_integrals(self, problem: Problem, before: Array, rows: list[Array], last: Array) -> None:
        """Adds the integrals at the end of the previous segment to those of this segment, which start at zero."""
        if not problem.integrals:
            return
        k = len(problem.dp)
        for part in (*rows, last):
            self._of_rows(part, 4, problem)[...] += self._of_rows(before, 4, problem)
            self._derivatives_of_rows(part, problem, k, 4)[...] += self._derivatives_of_rows(before, problem, k, 4)

    # -- rows of results -----------------------------------------------------------------------------------------------

    def _of_rows(self, rows: Array, part: int, problem: Problem | None = None) -> Array:
        """A part of rows (..., row): values (..., n) of t, q, u, outputs or integrals."""
        integrals = len(problem.integrals) if problem else 0
        start, size, _ = places_in_rows(self.nq, self.nu, self.noutputs, integrals)[part]
        return rows[..., start : start + size]

    def _derivatives_of_rows(self, rows: Array, problem: Problem, k: int, part: int) -> Array:
        """Derivatives of a part of rows, (..., k, n), as a view."""
        parts = places_in_rows(self.nq, self.nu, self.noutputs, len(problem.integrals))
        values = parts[-1][0] + parts[-1][1]
        _, size, before = parts[part]
        start = values + k * before
        return rows[..., start : start + k * size].reshape(*rows.shape[:-1], k, size)

    # -- one partition -------------------------------------------------------------------------------------------------

    def _segment(
        self, opened: Opened, problem: Problem, progress: Progress | None, keep_steps: bool, memory: int
    ) -> tuple[Segment, Array, Array]:
        """Runs a motion with one partition; returns the segment, rows of results, and a row for the state at its end."""
        library, ffi, system = self._motion(opened)
        left = len(problem.dp) % 8
        if 1 < left <= 4 and problem.method != "radau" and (address := _four(opened)):
            ffi.cast("void (*)(ordernm_system *)", address)(system)
        c = problem.in_c(ffi, system)
        room = ffi.from_buffer("double[]", np.empty(library.ordernm_room(c)))
        motion = library.ordernm_begin(c, room)
        segment = Segment(library, ffi, c, opened, problem, self.nq if self.closure_names else 0, keep_steps, memory)
        if problem.sampling:
            self._sample(problem, problem.sampling, library, ffi, c, segment)
        r, shown = segment.r, time.perf_counter()
        while True:
            try:
                reason = REASONS[library.ordernm_go(motion, r, SLICE)]
                if progress is not None and (reason == "end" or time.perf_counter() - shown >= 0.9 * SLICE):
                    shown = time.perf_counter()
                    progress(r.t, problem.end)
            except KeyboardInterrupt:
                reason = "interrupted"
            if reason == "imprecise":
                segment.precise = _precise(opened)
                r.as_is = not segment.precise
                system.precise = ffi.cast("const ordernm_precise *", segment.precise)
            elif reason == "full":
                segment.grow()
            elif reason != "paused":
                break
        if reason == "refused" and problem.sampling and problem.sampling.failure:
            if not isinstance(problem.sampling.failure, KeyboardInterrupt):
                raise problem.sampling.failure
            reason = "interrupted"
        rows = segment.end(reason)
        return segment, rows, rows[:0] if reason in ("end", "event", "interrupted") else segment.row_here(motion)

    def _sample(self, problem: Problem, sampling: Sampling, library: Any, ffi: Any, c: Any, segment: Segment) -> None:
        """Sets the C callback that the integrator calls at knots of the inputs; it calls the controller."""
        k, doubles = len(problem.dp), ffi.typeof("double[]")
        shown = (self.nq, self.nu, self.noutputs if self._gives_outputs else 0)
        none = [np.empty((0, size)) for size in shown]

        def at_knot(_: Any, motion: Any, t: float) -> int:
            if not sampling.is_due(t):
                return 0
            row = np.empty(segment.size)  # the sample keeps this array
            if library.ordernm_row(motion, segment.r, ffi.from_buffer(doubles, row)):
                return 1
            values = [self._of_rows(row, i)[:size] for i, size in enumerate(shown, 1)]
            derivatives = none
            if k:
                derivatives = [self._derivatives_of_rows(row, problem, k, i)[:, :n] for i, n in enumerate(shown, 1)]
            try:
                sampling.take(t, values, derivatives)
            except BaseException as error:
                sampling.failure = error
                return 1
            return 0

        callback = ffi.callback("int(void *, ordernm_motion *, ordernm_scalar)", at_knot)
        problem.kept.append(callback)  # the C struct does not keep it alive
        c.at_knot = callback


@lru_cache(64)
def _counted(loops: bool, method: str, fixed: bool) -> tuple[str, ...]:
    """Names of the counts that apply to a method and a model with or without loops; the first is the time reached."""
    names = ["t", "steps", "rejected", "evaluations"]
    if loops:
        names += ["closing_steps", "condition"]
    if method == "radau":
        names += ["jacobians", "factorizations"]
    elif method == "dop853" and not fixed:
        names += ["stiffness"]
    return tuple(names)


@lru_cache(64)
def places_in_rows(nq: int, nu: int, noutputs: int, integrals: int) -> tuple[tuple[int, int, int], ...]:
    """For t, q, u, outputs and integrals in a row of results: where each starts, how many entries it has, and how many
    derivatives per direction precede its own."""
    sizes = (1, nq, nu, noutputs, integrals)
    return tuple((sum(sizes[:i]), size, sum(sizes[1:i])) for i, size in enumerate(sizes))


def _new_events(before: list[tuple[int, Array]], segment: Segment) -> list[tuple[int, Array]]:
    """Events of a segment, without repetitions of events at the end of the previous segment, which rounding may cause."""
    start = segment.problem.start
    met = {which for which, row in before if row[0] >= start}
    beyond = start + 1e-12 * (1.0 + abs(start))
    return [(which, row) for which, row in segment.events if which not in met or row[0] > beyond]


def _precise(opened: Opened) -> int:
    """The address of the functions in long double, compiled at the first use; 0 if this fails."""
    name = opened.manifest["name"]
    try:
        return precise_functions(opened.folder, name, opened.package.get("seal", ""))
    except (CompileError, NoCompilerError) as error:
        warn(f"{name}: loops are closed with less accuracy near a pose where they lose rank: {error}")
        return 0


def _four(opened: Opened) -> int:
    """The address of the function for four directions at once; 0 if it cannot be compiled, and eight are used."""
    try:
        return four_lanes(opened.folder, opened.manifest["name"], opened.package.get("seal", ""))
    except (CompileError, NoCompilerError) as error:
        warn(f"{opened.manifest['name']}: motions with two to four directions take as long as with eight: {error}")
        return 0
