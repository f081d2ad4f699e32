"""How many choices of independent coordinates a motion needs: one, until it meets a dead point."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .runtime import Solver, Trajectory

PARTITIONS = (2, 4)
"""Numbers of choices of independent coordinates that are generated when a motion meets a dead point with fewer."""


def more_choices(solver: Solver, trajectory: Trajectory, held: int) -> int | None:
    """The number of choices that may take a motion further; None where it has not ended at a dead point, or there are no more.

    Parameters
    ----------
    solver : Solver
        Generated with `held` choices.
    trajectory : Trajectory
        What it has simulated.
    """
    if not _met_dead_point(trajectory) or len(solver.partitions) < held:
        return None
    return next((n for n in PARTITIONS if n > held), None)


def _met_dead_point(trajectory: Trajectory) -> bool:
    """Whether the motion has ended where another choice of independent coordinates may serve."""
    from .runtime.standalone.motion.reasons import DEAD_POINT
    from .runtime.standalone.trajectory.trajectory import FINISHED, INTERRUPTED

    over = trajectory.ended in (FINISHED, INTERRUPTED, "event")
    return not over and DEAD_POINT in trajectory.ended
