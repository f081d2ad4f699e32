"""One motion of a work-precision diagram, and its cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..measure import motions as measured
from ..measure.core import Core, Turn
from ..measure.motions import simulated
from ..measure.operations import operations
from ..runtime.standalone.errors import AssemblyError, SimulationError, SingularJointError, SingularLoopError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from ..runtime import Solver, Trajectory

    Array = NDArray[np.float64]

COSTLIEST = 5e8
"""Most operations for one motion of a diagram, about a quarter of a second; a method gets no tighter settings beyond that. The
limit counts operations instead of seconds, so another run of the same report computes the same motions."""

PROBED, ALLOWED = 90, 12
"""Multiples of `COSTLIEST`: for the first motion, which determines the final time, and for all others."""

FIXED = [2**i for i in range(5, 15)]
"""Numbers of steps for the method with constant steps."""

FIXED_TOLERANCE = 1e-9
"""Tolerance of closures for the method with constant steps."""

ROUNDS, SHORT = 5, 0.005
"""Maximum number of repetitions of a motion in a process, and total seconds after which no repetition begins."""


@dataclass(frozen=True)
class Setting:
    """A motion of a work-precision diagram.

    Attributes
    ----------
    end : float
    names : sequence of str
        Parameters of the derivatives.
    method : str
    tolerance : float
    steps : int or None
        Number of steps, for the method with constant steps.
    """

    end: float
    names: Sequence[str]
    method: str
    tolerance: float
    steps: int | None = None


def motion(solver: Solver, s: Setting, times: Array | None = None, allowed: float = ALLOWED) -> Trajectory | str:
    """A motion, as far as it could be integrated, or the reason why it could not be."""
    tolerance = s.tolerance
    try:
        return simulated(
            solver, [0.0, s.end] if times is None else times, sensitivities=s.names, method=s.method, rtol=tolerance,
            atol=tolerance, step=None if s.steps is None else s.end / s.steps,
            atol_sensitivities=tolerance if s.names and s.steps is None else None,
            most_steps=_most_steps(solver, s.names, allowed),
        )  # fmt: skip
    except (SimulationError, AssemblyError, SingularLoopError, SingularJointError, ValueError) as error:
        return str(error)


def timed(solver: Solver, setting: Setting, core: Core) -> tuple[Trajectory | str, Turn]:
    """A motion, and the integrator's time without interruptions by other processes."""
    found: list[Trajectory | str] = []

    def run() -> float:
        x, seconds = measured.timed(lambda: motion(solver, setting))
        found.append(x)
        return seconds

    turn = core.turn(run)
    return found[0], turn


def turns(solver: Solver, setting: Setting, core: Core) -> list[Turn]:
    """Times of repeated computations of the motion."""
    taken: list[Turn] = []
    while len(taken) < ROUNDS and sum(t.seconds for t in taken) < SHORT:
        taken.append(timed(solver, setting, core)[1])
    return taken


def _most_steps(solver: Solver, names: Sequence[str], allowed: float) -> int:
    """Number of steps of Dormand and Prince's method, with twelve evaluations each, that costs a multiple of
    `COSTLIEST`."""
    affordable = int(allowed * COSTLIEST / (12 * evaluation(solver, names)))
    return min(max(2 * max(FIXED), affordable), 1_000_000)


def evaluation(solver: Solver, names: Sequence[str]) -> int:
    """Operations for the accelerations and their derivatives; 1 if the accelerations are constant."""
    return max(1, operations(solver, "sensitivities", len(names)) if names else operations(solver, "accelerations"))
