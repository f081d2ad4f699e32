"""What a user should know of a partition: ears in poor condition or large, initial values that closing has changed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..model.model import Model
from .assembling import initial_configuration
from .ears import Partition
from .geometry import Geometry
from .ordering import Draft
from .vectors import Array
from .velocities import complete_speeds
from .wording import listed, loops_named

POOR_CONDITION = 1e4
"""Of a closure matrix: beyond this another choice is sought, and a warning names the loops."""

LARGE_CLUSTER = 5
"""Loops; larger clusters are reported."""

FAR_ANGLE = 1.6
"""rad: initial values that closing changes by more than about a quarter turn are reported."""


def moved_far(model: Model, guess: Array, q: Array) -> Iterator[str]:
    """What to say of angles that the model gives and closing has changed by more than a quarter turn."""
    for i, (name, unit) in enumerate(zip(model.coordinate_names, model.coordinate_units, strict=True)):
        if unit == "rad" and name in model.initial_q and abs(q[0, i] - guess[0, i]) > FAR_ANGLE:
            yield (
                f"closing the loops has moved {name} from its initial value {guess[0, i]:.4g} to {q[0, i]:.4g} rad, more than a "
                f"quarter turn: another branch may be meant; give nearer values under `initial`"
            )


def ignored_speeds(model: Model, found: Partition) -> Iterator[str]:
    """Initial values of dependent speeds that closure replaces by others."""
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
    """What a user should know about an ear."""
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
