"""Small motions of a mechanism: as many numbers as there are independent speeds, whatever its coordinates are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Indices


class TangentSpace:
    """The directions in which a mechanism can move, one for each independent speed.

    A small motion w (n,) changes the coordinates by ``N w``, where ``qdot = N u``, u being the independent speeds: so w has
    angles of joints, displacements, and for quaternions small rotations about the axes of the speeds. Dependent coordinates
    are part of N. A joint that is split has w along its independent speeds only.

    Attributes
    ----------
    speeds : (n,) array of int
        The independent speeds.
    names : tuple of str
        Of the entries of w: ``q.crank`` where speed and coordinate have a name in common, else ``rotation.ball.wx`` about,
        and ``displacement.bus.vx`` along, the axis of a speed.
    """

    def __init__(self, manifest: Mapping[str, Any]):
        q, u = manifest["coordinate_names"], manifest["speed_names"]
        own = manifest.get("independent_speed_names", u)
        self.speeds: Indices = np.array([u.index(name) for name in own], int)
        self.coordinates: Indices = np.array([q.index(name) for name in manifest.get("independent_names", q)], int)
        self.speed_names = tuple(own)
        self.names = tuple(_name(speed, q) for speed in own)
        self.units = np.zeros((len(own), len(u)))
        self.units[np.arange(len(own)), self.speeds] = 1.0

    @property
    def n(self) -> int:
        """Number of directions."""
        return len(self.speeds)

    def components(self, tangents: Array, motions: Array) -> Array:
        """w (k, n) of changes of the coordinates (k, nq), which are along the tangents N^T (n, nq)."""
        # the rows of independent coordinates are enough, and better conditioned than all
        N, right = tangents[:, self.coordinates].T, motions[:, self.coordinates].T
        return np.asarray(np.linalg.lstsq(N, right, rcond=None)[0].T, np.float64)


def _name(speed: str, coordinates: list[str]) -> str:
    """What a small motion along a speed is called."""
    if speed in coordinates:
        return f"q.{speed}"
    return f"{'rotation' if speed.rpartition('.')[2].startswith('w') else 'displacement'}.{speed}"
