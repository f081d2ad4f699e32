"""Warnings about a partition: ears that are poorly conditioned or large, changed initial values, motions that are blocked.

A condition that a motion breaks by much less than others do stops it all the same: the mechanism has a freedom less, and the
joints' forces there are large. Above the tolerance of the model this may be meant; it may also be that an axis is given with
three digits, where exact ones would let go.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..model.model import Model
from ..model.vectors import Array
from .assembling import initial_configuration
from .ears import Partition
from .errors import listed, loops_named
from .geometry import Geometry
from .ordering import Draft
from .velocities import Motion, complete_speeds

POOR_CONDITION = 1e4
"""Condition of a closure matrix above which another choice is sought and a warning names the loops."""

LARGE_CLUSTER = 5
"""Number of loops above which a cluster is reported."""

FAR_ANGLE = 1.6
"""Changes of initial values by closing, in rad, above which they are reported."""

SMALL = 1e-2
"""Motions whose singular value is below this part of the largest are nearly free."""

PART = 0.2
"""Joints whose share in such a motion is less than this part of the largest are not named."""


def moved_far(model: Model, guess: Array, q: Array) -> Iterator[str]:
    """Warnings about angles of the model that closing has changed by more than a quarter turn."""
    for i, (name, unit) in enumerate(zip(model.coordinate_names, model.coordinate_units, strict=True)):
        if unit == "rad" and name in model.initial_q and abs(q[0, i] - guess[0, i]) > FAR_ANGLE:
            yield (
                f"closing the loops has moved {name} from its initial value {guess[0, i]:.4g} to {q[0, i]:.4g} rad, more than a "
                f"quarter turn: another branch may be meant; give nearer values under `initial`"
            )


def ignored_speeds(model: Model, found: Partition) -> Iterator[str]:
    """Initial values of dependent speeds that closure replaces."""
    named = [s for s in found.dependent if model.speed_names[s] in model.initial_u]
    if not named:
        return
    given = initial_configuration(model)[1]
    u = complete_speeds(model, found, found.q, given)
    ignored = [s for s in named if abs(u[s] - given[s]) > 1e-6 * max(1.0, float(np.abs(u).max()))]
    if ignored:
        text = listed([f"{model.speed_names[s]} from {given[s]:.4g} to {u[s]:.4g}" for s in ignored])
        yield f"initial u of dependent speeds do not close the loops; they are changed, {text}"


def doubts_of(model: Model, geometry: Geometry, draft: Draft, held: set[int]) -> Iterator[str]:
    """Warnings about an ear."""
    loops = loops_named(model, draft.loops)
    spare = draft.rows > len(draft.dependent)
    if draft.condition > POOR_CONDITION:
        yield (
            f"{loops}: the closure matrix of the dependent speeds has condition {draft.condition:.1e} at the initial "
            f"configuration, which is at or near a singular one; start from another configuration"
            + (", or give a larger loop_tolerance where loops should not hold these speeds" if spare else "")
        )
    if len(draft.loops) > LARGE_CLUSTER:
        asked = bool(held & geometry.passed_speeds(draft.loops))
        yield (
            f"{loops} close only all together, in one dense system of rank {len(draft.dependent)}; other coordinates "
            f"under `independent`{', or none,' * asked} may do better"
        )


def stopped(geometry: Geometry, draft: Draft, q: Array) -> list[tuple[float, Array, list[int]]]:
    """Motions of an ear's joints that its loops nearly permit: parts of the largest singular value, shares, speeds."""
    closure = Motion(geometry, q, np.zeros((1, geometry.nu, 1))).closure(draft.loops)
    E = closure.scaled(geometry, float(geometry.lengths[draft.loops[0]]))[0]
    _, s, V = np.linalg.svd(E, full_matrices=False)
    speeds = [int(x) for x in closure.speeds]
    return [
        (float(x / s[0]), v, speeds) for x, v in zip(s, V, strict=True) if geometry.tolerance * s[0] < x < SMALL * s[0]
    ]


def nearly_locked(geometry: Geometry, drafts: Sequence[Draft], configurations: Sequence[Array]) -> list[str]:
    """Warnings about motions that are nearly permitted at all configurations; a single one may be near a dead point."""
    lines = []
    for draft in drafts:
        first, *others = (stopped(geometry, draft, q) for q in configurations)
        if not first or not all(others):
            continue
        ratio = max(min(part for part, _, _ in found) for found in (first, *others))
        _, shares, speeds = min(first, key=lambda found: found[0])
        order = np.argsort(-np.abs(shares), kind="stable")
        names = [geometry.model.speed_names[speeds[i]] for i in order if abs(shares[i]) > PART * abs(shares[order[0]])]
        loops = loops_named(geometry.model, draft.loops)
        lines.append(
            f"{loops}: a motion of {listed(names)} is stopped by {ratio:.1e} of the largest "
            f"singular value only; if the loop should move that way, give its axes and lengths with all digits, or a larger "
            f"loop_tolerance"
        )
    return lines
