"""Warnings about a partition: poorly conditioned or large ears, changed initial values, blocked motions.

A motion can violate a condition by much less than motions usually do. It is blocked all the same: the mechanism has one
degree of freedom less, and the joint forces there are large. If the violation exceeds the model's tolerance, this may
be intended. The cause may also be an axis that is given with three digits, where exact components would permit the
motion.
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
"""Condition number of a closure matrix above which another choice is sought and a warning names the loops."""

LARGE_CLUSTER = 5
"""Number of loops above which a warning reports a cluster."""

FAR_ANGLE = 1.6
"""Change of an initial value by closing the loops, in rad, above which it is reported."""

SMALL = 1e-2
"""Ratio to the largest singular value below which the loops nearly permit a motion."""

PART = 0.2
"""A warning names the joints of a nearly permitted motion whose component exceeds this fraction of the largest one."""


def moved_far(model: Model, guess: Array, q: Array) -> Iterator[str]:
    """Warnings about initial angles of the model that closing the loops has changed by more than a quarter turn."""
    for i, (name, unit) in enumerate(zip(model.coordinate_names, model.coordinate_units, strict=True)):
        if unit == "rad" and name in model.initial_q and abs(q[0, i] - guess[0, i]) > FAR_ANGLE:
            yield (
                f"closing the loops has moved {name} from its initial value {guess[0, i]:.4g} to {q[0, i]:.4g} rad, more than a "
                f"quarter turn. You may intend another configuration: give better values under `initial`"
            )


def ignored_speeds(model: Model, found: Partition) -> Iterator[str]:
    """Warnings about initial values of dependent speeds that are replaced when the loops are closed."""
    named = [s for s in found.dependent if model.speed_names[s] in model.initial_u]
    if not named:
        return
    given = initial_configuration(model)[1]
    u = complete_speeds(model, found, found.q, given)
    ignored = [s for s in named if abs(u[s] - given[s]) > 1e-6 * max(1.0, float(np.abs(u).max()))]
    if ignored:
        text = listed([f"{model.speed_names[s]} from {given[s]:.4g} to {u[s]:.4g}" for s in ignored])
        yield f"initial values u of dependent speeds do not close the loops and were changed: {text}"


def doubts_of(model: Model, geometry: Geometry, draft: Draft, held: set[int]) -> Iterator[str]:
    """Warnings about the conditioning and the size of an ear."""
    loops = loops_named(model, draft.loops)
    spare = draft.rows > len(draft.dependent)
    if draft.condition > POOR_CONDITION:
        yield (
            f"{loops}: the closure matrix of the dependent speeds has condition number {draft.condition:.1e} at the initial "
            f"configuration, which is at or near a singular one; start from another configuration"
            + (", or give a larger loop_tolerance if the loops should not hold these speeds" if spare else "")
        )
    if len(draft.loops) > LARGE_CLUSTER:
        has_hints = bool(held & geometry.passed_speeds(draft.loops))
        yield (
            f"{loops} close only together, in one dense system of rank {len(draft.dependent)}; other coordinates "
            f"under `independent`{', or none,' * has_hints} may do better"
        )


def stopped(geometry: Geometry, draft: Draft, q: Array) -> list[tuple[float, Array, list[int]]]:
    """Motions that the loops of an ear nearly permit: relative singular value, components, speeds."""
    closure = Motion(geometry, q, np.zeros((1, geometry.nu, 1))).closure(draft.loops)
    E = closure.scaled(geometry, float(geometry.lengths[draft.loops[0]]))[0]
    _, s, V = np.linalg.svd(E, full_matrices=False)
    speeds = [int(x) for x in closure.speeds]
    return [
        (float(x / s[0]), v, speeds) for x, v in zip(s, V, strict=True) if geometry.tolerance * s[0] < x < SMALL * s[0]
    ]


def nearly_locked(geometry: Geometry, drafts: Sequence[Draft], configurations: Sequence[Array]) -> list[str]:
    """Warnings about motions nearly permitted at all configurations; one configuration alone may just be singular."""
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
            f"{loops}: a motion of {listed(names)} is blocked by only {ratio:.1e} of the largest singular value; if the loop "
            f"should permit this motion, give its axes and lengths with all digits, or a larger loop_tolerance"
        )
    return lines
