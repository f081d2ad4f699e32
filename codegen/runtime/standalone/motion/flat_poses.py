"""Derivatives through poses at which a loop has lost rank: which directions have none.

At a flat pose a combination n of the conditions of a loop sees no speed, ``n E = 0``. A parameter that n sees, ``n dg/dp`` not
zero, leaves no closed state near the pose, or makes another branch of what is behind it: nothing can be differentiated. Beside
the pose, at a distance d, the dependent coordinates move by 1/d with such a parameter, and by a bounded amount with directions
that keep the loop closed through the pose, such as all lengths of a parallelogram together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..assembly.partitions import scale_of
from ..calls.arguments import Seeds
from ..errors import SingularJointError
from .problem import Run, Segment

GROWN = 4.0
"""How many times as far dependent coordinates must move beside a pose as farther away from it: 16 is expected, or else 1."""

ROUNDING = 1e-8
"""Part of what single parameters move that is left of directions which keep the loop closed, by rounding."""

MOVED = 1e-6
"""rad, or characteristic lengths: what coordinates must move by beside a pose where a parameter changes by all of itself."""


@dataclass(frozen=True, slots=True)
class Lost:
    """Directions that have no derivative from a time on.

    Attributes
    ----------
    t : float
    directions : (k,) array of bool
    """

    t: float
    directions: NDArray[np.bool_]


def lost_directions(run: Run, dp: Array) -> list[Lost]:
    """Which of the directions dp (k, np) have no derivative behind the poses that a motion has passed."""
    if not dp.any():
        return []
    moving = np.flatnonzero(dp.any(axis=0))
    found = []
    for segment in run.segments:
        for row in segment.flat:
            q = row[1:].reshape(2, -1)
            try:
                near, far = (_moved(segment, float(row[0]), of, moving) for of in q)
            except SingularJointError:
                continue
            seeds, sizes = dp[:, moving], np.abs(segment.problem.p[moving])
            beside, away = (np.abs(seeds @ x).max(axis=1, initial=0.0) for x in (near, far))
            single = np.abs(seeds) @ np.abs(near).max(axis=1, initial=0.0)
            changes = np.abs(seeds) @ (1.0 / np.where(sizes > 0.0, sizes, 1.0))
            lost = (beside > GROWN * away) & (beside > np.maximum(ROUNDING * single, MOVED * changes))
            if lost.any():
                found.append(Lost(float(row[0]), lost))
    return found


def _moved(segment: Segment, t: float, q: Array, moving: NDArray[np.intp]) -> Array:
    """By how much coordinates move with some parameters, independent ones held, (parameters, nq)."""
    problem = segment.problem
    f = segment.opened.functions["completion_sensitivities"]
    given = {"q": q.copy(), "u": np.zeros_like(problem.u), "p": problem.p, "inputs": problem.inputs.at(t), "t": t}
    units = np.eye(len(problem.p))[moving]
    results = segment.opened.target.compute(f, given, (), Seeds({"dp": units}, len(units)))
    moved: Array = results[f.results.index("dfull_q")].reshape(len(units), -1)
    return moved / scale_of(segment.opened.manifest)


def what_is_lost(lost: Sequence[Lost], names: Sequence[str]) -> str:
    """What is said of it."""
    first: dict[str, float] = {}
    for of in lost:
        for k in np.flatnonzero(of.directions):
            first.setdefault(names[int(k)], of.t)
    by = ", ".join(first)
    which = "such a parameter" if len(first) > 1 else "this parameter"
    return (
        f"derivatives by {by} do not exist behind t = {min(first.values()):.9g} s and are NaN: a loop loses rank there, as a "
        f"linkage does whose links are in one line, and with {which} changed alone it cannot be assembled there, or goes on in "
        f"another branch. Make lengths that have to agree for the mechanism to pass one parameter"
    )
