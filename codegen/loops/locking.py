"""Motions that loops stop by little: what numbers of few digits lock, where exact ones would let go.

A condition that a motion breaks by much less than others do stops it all the same: the mechanism has a freedom less, and the
joints' forces there are large. Above the tolerance of the model this may be meant; it may also be that an axis is given with
three digits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .geometry import Geometry
from .ordering import Draft
from .vectors import Array
from .velocities import Motion
from .wording import listed, loops_named

SMALL = 1e-2
"""Singular values below this part of the largest stop motions by little."""

PART = 0.2
"""Joints whose share in such a motion is less than this part of the largest are not named."""


def stopped(geometry: Geometry, draft: Draft, q: Array) -> list[tuple[float, Array, list[int]]]:
    """Motions of an ear's joints that its loops stop by little: parts of the largest singular value, shares, speeds."""
    closure = Motion(geometry, q, np.zeros((1, geometry.nu, 1))).closure(draft.loops)
    E = closure.scaled(geometry, float(geometry.lengths[draft.loops[0]]))[0]
    _, s, V = np.linalg.svd(E, full_matrices=False)
    speeds = [int(x) for x in closure.speeds]
    return [
        (float(x / s[0]), v, speeds) for x, v in zip(s, V, strict=True) if geometry.tolerance * s[0] < x < SMALL * s[0]
    ]


def nearly_locked(geometry: Geometry, drafts: Sequence[Draft], configurations: Sequence[Array]) -> list[str]:
    """What to say of motions that are stopped by little at all of some configurations: one alone may be near a dead point."""
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
