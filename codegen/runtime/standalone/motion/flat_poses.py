"""Directions without derivatives after a motion has passed a pose at which a loop loses rank (a flat pose).

At a flat pose, a combination n of a loop's conditions does not depend on the speeds: ``n E = 0``. If ``n dg/dp`` is not
zero, no closed state exists near the pose for one sign of the change dp, or the motion enters another branch. Then
there is no derivative with respect to p. At a distance d from the pose, derivatives of dependent coordinates with respect
to such a parameter grow like 1/d. Derivatives along a direction that keeps the loop closed through the pose remain bounded;
an example is a common scale of all lengths of a parallelogram.
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
from .results import Run, Segment

GROWN = 4.0
"""Ratio of the motions of dependent coordinates near the pose and farther away. A direction with a larger ratio has no
derivative after the pose. Such ratios are about 16, all others about 1."""

ROUNDING = 1e-8
"""Motions of dependent coordinates below this fraction of those caused by single parameters count as rounding
errors."""

MOVED = 1e-6
"""Smallest motion near a pose that counts, rad or characteristic lengths, for a relative change of 1 of the parameters."""


@dataclass(frozen=True, slots=True)
class Lost:
    """Directions that have no derivative after a time.

    Attributes
    ----------
    t : float
    directions : (k,) array of bool
    """

    t: float
    directions: NDArray[np.bool_]


def lost_directions(run: Run, dp: Array) -> list[Lost]:
    """The directions dp (k, np) that have no derivative after flat poses which the motion has passed."""
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
    """Derivatives (parameters, nq) of scaled coordinates with respect to some parameters, at fixed independent coordinates."""
    problem = segment.problem
    f = segment.opened.functions["completion_sensitivities"]
    given = {"q": q.copy(), "u": np.zeros_like(problem.u), "p": problem.p, "inputs": problem.inputs.at(t), "t": t}
    units = np.eye(len(problem.p))[moving]
    results = segment.opened.target.compute(f, given, (), Seeds({"dp": units}, len(units)))
    moved: Array = results[f.results.index("dfull_q")].reshape(len(units), -1)
    return moved / scale_of(segment.opened.manifest)


def what_is_lost(lost: Sequence[Lost], names: Sequence[str]) -> str:
    """The warning for lost directions."""
    first: dict[str, float] = {}
    for of in lost:
        for k in np.flatnonzero(of.directions):
            first.setdefault(names[int(k)], of.t)
    by = ", ".join(first)
    which = "such a parameter" if len(first) > 1 else "this parameter"
    return (
        f"derivatives with respect to {by} do not exist after t = {min(first.values()):.9g} s and are NaN: a loop loses rank "
        f"there (for example, its links are in one line), and if {which} changes alone, the loop cannot be closed there, or it "
        f"changes its branch. Use one parameter for lengths that must agree for the mechanism to pass"
    )
