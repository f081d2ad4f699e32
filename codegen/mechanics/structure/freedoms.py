"""Facts about joints: how many freedoms and coordinates each has, and what its freedoms move along."""

from __future__ import annotations

FREEDOMS = {"revolute": 1, "prismatic": 1, "spherical": 3, "free": 6}
COORDINATE_COUNT = {"revolute": 1, "prismatic": 1, "spherical": 4, "free": 7}
COORDINATE_START = {"spherical": 0, "free": 3}
"""Where the quaternion begins among a joint's coordinates."""


def freedom_axes(joint: str, axis: int) -> list[int]:
    """Which unit column of the six each freedom moves along: 0-2 angular, 3-5 linear."""
    return {"revolute": [axis], "prismatic": [3 + axis], "spherical": [0, 1, 2], "free": [0, 1, 2, 3, 4, 5]}[joint]
