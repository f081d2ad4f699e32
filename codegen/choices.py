"""Finds the number of partitions that a motion needs: one, unless the motion meets a dead point."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .runtime import Solver, Trajectory

PARTITIONS = (2, 4)
"""Numbers of partitions that are generated in turn when a motion meets a dead point."""


def more_choices(solver: Solver, trajectory: Trajectory, held: int) -> int | None:
    """The number of partitions with which a motion may continue; None if the motion did not end at a dead point, or if
    no larger number is allowed.

    Parameters
    ----------
    solver : Solver
        A solver generated with `held` partitions.
    trajectory : Trajectory
        The motion that this solver computed.
    """
    if not _met_dead_point(trajectory) or len(solver.partitions) < held:
        return None
    return next((n for n in PARTITIONS if n > held), None)


def _met_dead_point(trajectory: Trajectory) -> bool:
    """Whether the motion ended where other independent coordinates may help."""
    from .runtime.standalone.motion.reasons import DEAD_POINT
    from .runtime.standalone.trajectory.trajectory import FINISHED, INTERRUPTED

    over = trajectory.ended in (FINISHED, INTERRUPTED, "event")
    return not over and DEAD_POINT in trajectory.ended
