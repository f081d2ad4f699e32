"""Messages that explain why a motion ended early."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.non_finite import culprit
from ..calls.targets import partitions_of
from ..errors import SingularJointError
from ..files.manifest import ALLOWED
from .problem import Problem
from .results import Run
from .run import MotionRun
from .switches import switch_words

DEAD_POINT = "as at a dead point"
"""Words in a message about dead points, where other independent coordinates may help."""

HARDLY_DETERMINED = 1e6
"""Condition number of loops above which the message mentions the choice of independent coordinates."""

BEHIND = np.logspace(-12, -3, 10)
"""Distances after the end of a motion at which forces are tested for undefined values: in s, or relative to times above
1 s."""


class Reasons(MotionRun):
    """Runs motions, and explains why they end early."""

    def _state_of(self, row: Array, problem: Problem) -> dict[str, Any]:
        """Arguments of functions at the state in a row of results."""
        t = float(row[0])
        q, u = self._of_rows(row, 1), self._of_rows(row, 2)
        return {"q": q, "u": u, "p": problem.p, "inputs": problem.inputs.at(t), "t": t}

    def _why_it_ended(self, problem: Problem, run: Run) -> str:
        """The reason for an early end in words, with time and cause."""
        condition = run.counts.get("condition", 0.0)
        if condition < HARDLY_DETERMINED and run.reason != "undetermined":
            return self._cause(problem, run)
        if not self.independent_speed_names:  # no choice of coordinates would help
            return (
                f"{self._cause(problem, run)}. The loops could hardly be closed there (condition number {condition:.2g}): the "
                f"prescribed motion comes to the end of their reach; check the lengths"
            )
        choices = len(partitions_of(self._manifest))
        way = (
            "a package with two partitions (generate with --partitions 2) can change to other independent coordinates before"
            if choices == 1
            else f"none of the package's {choices} choices of independent coordinates is suitable there"
        )
        return (
            f"{self._cause(problem, run)}. The dependent coordinates were poorly determined there (condition number "
            f"{condition:.2g}), {DEAD_POINT}: {way}"
        )

    def _what_is_infinite(self, problem: Problem, run: Run) -> str:
        """The force without a finite value or derivative at the end of a motion, or just after it; empty if there is none."""
        last = run.last if len(run.last) else run.rows[-1] if len(run.rows) else None
        if last is None:
            last = np.concatenate([[problem.start], problem.q, problem.u])
        state = self._state_of(last, problem)
        t, q, u = state["t"], state["q"], state["u"]
        # after a singular joint or force element, infinite forces and motions are consequences, not the cause
        elements = run.reason != "singular"
        if found := culprit(run.opened, state, along=elements and bool(len(problem.dq)), elements=elements):
            return found
        try:
            qdot, udot = self._call("state_rates", tuple(state.values()))
        except SingularJointError:
            return ""
        for h in BEHIND * (1.0 + abs(t)):
            behind = {
                "q": q + h * qdot,
                "u": u + h * udot,
                "p": problem.p,
                "inputs": problem.inputs.at(t + h),
                "t": t + h,
            }
            if found := culprit(run.opened, behind, along=False, elements=elements):
                return f"just after this time, {found}"
        return ""

    def _cause(self, problem: Problem, run: Run) -> str:
        """The reason, without advice about the choice of independent coordinates."""
        at = f"at t = {run.counts['t']:.9g} s"
        manifest = run.opened.manifest
        names = self._entries(problem)
        entry = names[min(run.component, len(names) - 1)] if names else "nothing"
        match run.reason:
            case "singular":
                error = self._in_c(run.opened).singular(run.singular, f" {at}")
                found = self._what_is_infinite(problem, run)
                found = found and f"a result is not finite: {found}"
                return f"the motion ends {at}: {found or error}"
            case "open loop":
                return (
                    f"the motion ends {at}: Newton's method no longer closes the loops; they may be at the end of their "
                    f"reach, or at a configuration where the dependent coordinates are not determined"
                )
            case "step collapsed":
                found = self._what_is_infinite(problem, run)
                return f"the motion ends {at}: steps have become too small, because of {entry}; " + (
                    f"a result is not finite: {found}"
                    if found
                    else "it may be unbounded or jump there, or rounding errors exceed rtol and atol"
                )
            case "undetermined":
                constant = problem.fixed or problem.method == "rk4"
                allowing = "steps of this size" if constant else "rounding, rtol and atol"
                return (
                    f"the motion ends {at}: there, or just after, small errors of the independent speeds, as {allowing} "
                    f"allow, become large errors of dependent speeds"
                )
            case "apart":
                return f"the motion ends {at}: {self._why_apart(run)}"
            case "not finite":
                return f"the motion ends {at}: the time derivative of {entry} is not finite" + (
                    f": {found}" if (found := self._what_is_infinite(problem, run)) else ""
                )
            case "too many steps":
                made = run.counts["steps"] + run.counts["rejected"]
                if problem.fixed or problem.method == "rk4":
                    return f"the motion ends {at} after {made} constant steps; allow more with most_steps, or a larger step"
                return (
                    f"the motion ends {at} after {made} steps, kept small by {entry}; "
                    f"allow more with most_steps, or loosen rtol and atol; method='radau' serves stiff models"
                )
            case "sliding":
                return (
                    f"the motion ends {at}: where {switch_words(manifest, run.component)} changes its branch, forces on both "
                    f"sides push the motion back, so that it sticks or slides there, which neither branch describes; smooth the "
                    f"change, as by tanh or step(x, from, to)"
                )
            case "accumulated":
                return (
                    f"the motion ends {at}: {switch_words(manifest, run.component)} changes its branch faster and faster; "
                    f"smooth the change, as by tanh or step(x, from, to)"
                )
            case "refused":
                return f"the motion ends {at}: the state that the controller samples there could not be computed"
            case _:
                return run.reason

    def _why_apart(self, run: Run) -> str:
        """Names the dropped condition that would open, and gives remedies."""
        manifest = run.opened.manifest
        condition = self.closure_names[run.component]
        loop = condition.rpartition(".")[0]
        allowed = ALLOWED * manifest["loop_tolerance"]
        return (
            f"after it, condition {condition} would be open by more than {allowed:g}. It was dropped because "
            f"it was redundant within loop_tolerance in the initial state, but it is not redundant there: the "
            f"motion would continue as that of another mechanism. Make the lengths of loop {loop} fit exactly, exchange its "
            f"`from` and `to` (conditions use their axes), or generate from an initial state after this pose"
        )
