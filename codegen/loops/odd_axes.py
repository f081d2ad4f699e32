"""The joint of a loop whose axis is not parallel to those of all other joints: the probable cause of a loop that cannot move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..model.vectors import Array
from .errors import listed
from .geometry import Geometry

PARALLEL = 1e-3
"""Sine of the angle between two axes below which they are parallel."""


def axes_to_check(geometry: Geometry, loops: Sequence[int]) -> str:
    """What to check where the joints of some loops do not move as requested: one axis, if all others are parallel."""
    odd = [text for i in loops if (text := _odd_axis(geometry, i))]
    return "; ".join(odd) or "check the axes and the places of the joints"


def _odd_axis(geometry: Geometry, loop: int) -> str:
    """The text about the only axis of a loop's joints that is not parallel to the others; empty if there is none.

    Axes are compared with all coordinates at zero: rotations about parallel axes keep them parallel.
    """
    axes = _axes(geometry, loop)
    for name, axis in axes:
        others = [x for x in axes if x[0] != name]
        if len(others) > 1 and all(_parallel(x, others[0][1]) for _, x in others) and not _parallel(axis, others[0][1]):
            return (
                f"check the axis of {name}: it is not parallel to those of {listed([x for x, _ in others])}, which are "
                f"parallel to each other"
            )
    return ""


def _axes(geometry: Geometry, loop: int) -> list[tuple[str, Array]]:
    """Names and axes, in the ground frame, of the joints of a loop, with its loop joint; empty if a joint has several
    axes."""
    g, model = geometry, geometry.model
    of = model.loops[loop]
    if of.is_coupling or of.closure.angular != 2:
        return []
    found = []
    for k in sorted(k for side in g.cycle(loop) for k in side):
        turning = [s for s in g.speeds[k] if g.turning[s]]
        if len(turning) > 1:
            return []
        found += [(f"joint {model.bodies[k].name}", _rotation(g, k) @ g.screw_w[s]) for s in turning]
    start = _rotation(g, g.starts[loop]) @ g.face_R[0, loop] @ g.axis[loop]
    end = _rotation(g, g.ends[loop]) @ g.face_R[1, loop] @ g.end_axis[loop]
    if _parallel(start, end):
        return [*found, (f"loop {of.name}", start)]
    return [*found, (f"loop {of.name} in `from`", start), (f"loop {of.name} in `to`", end)]


def _rotation(geometry: Geometry, body: int) -> Array:
    """Rotation of a body's axes into those of the ground, with all coordinates at zero."""
    R = np.eye(3)
    while body != geometry.ground:
        R = geometry.R0[body] @ R
        body = geometry.parent[body]
    return R


def _parallel(one: Array, other: Array) -> bool:
    return float(np.linalg.norm(np.cross(one, other))) < PARALLEL
