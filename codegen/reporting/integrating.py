"""One motion of a work-precision diagram, and what it takes."""

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
"""Operations that one motion of a diagram may take, a quarter of a second or so; a method goes no further then. Operations and
not seconds, so that another run of the same report makes the same motions."""

PROBED, ALLOWED = 90, 12
"""Multiples of `COSTLIEST` that the first motion may cost, which finds how far motions go, and that a later one may cost."""

FIXED = [2**i for i in range(5, 15)]
"""Numbers of steps of the method with constant ones."""

FIXED_TOLERANCE = 1e-9
"""Where the method with constant steps solves closures."""

ROUNDS, SHORT = 5, 0.005
"""Times that a process runs a motion, at most, and seconds after which it stops."""


@dataclass(frozen=True)
class Setting:
    """A motion of a diagram.

    Attributes
    ----------
    end : float
    names : sequence of str
        Of parameters that it is differentiated by.
    method : str
    tolerance : float
    steps : int or None
        Of the method with constant ones.
    """

    end: float
    names: Sequence[str]
    method: str
    tolerance: float
    steps: int | None = None


def motion(solver: Solver, s: Setting, times: Array | None = None, allowed: float = ALLOWED) -> Trajectory | str:
    """A motion as far as it comes, or why there is none."""
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
    """A motion, and what the integrator takes for it but for what others have of the core meanwhile."""
    found: list[Trajectory | str] = []

    def run() -> float:
        x, seconds = measured.timed(lambda: motion(solver, setting))
        found.append(x)
        return seconds

    turn = core.turn(run)
    return found[0], turn


def turns(solver: Solver, setting: Setting, core: Core) -> list[Turn]:
    """Of the motion again and again."""
    taken: list[Turn] = []
    while len(taken) < ROUNDS and sum(t.seconds for t in taken) < SHORT:
        taken.append(timed(solver, setting, core)[1])
    return taken


def _most_steps(solver: Solver, names: Sequence[str], allowed: float) -> int:
    """Steps of Dormand and Prince's method, twelve evaluations each, that cost a multiple of `COSTLIEST`."""
    affordable = int(allowed * COSTLIEST / (12 * evaluation(solver, names)))
    return min(max(2 * max(FIXED), affordable), 1_000_000)


def evaluation(solver: Solver, names: Sequence[str]) -> int:
    """Operations of the accelerations and their derivatives; one where these are constants."""
    return max(1, operations(solver, "sensitivities", len(names)) if names else operations(solver, "accelerations"))
