"""Small motions of a mechanism, with one component per independent speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Indices


class TangentSpace:
    """The tangent space of a mechanism's configurations, with one direction per independent speed.

    A small motion w (n,) changes the coordinates by ``N w``, where ``qdot = N u`` and u are the independent speeds. So w consists
    of joint angles, displacements, and, for quaternions, small rotations about the axes of the speeds. N includes dependent
    coordinates. If only some speeds of a joint are independent, w contains only these speeds' motions.

    Attributes
    ----------
    speeds : (n,) array of int
        The independent speeds.
    names : tuple of str
        Names of the entries of w: ``q.crank`` if speed and coordinate have the same name. Otherwise ``rotation.ball.wx`` about,
        or ``displacement.bus.vx`` along, the axis of a speed.
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
        """Number of directions of the tangent space."""
        return len(self.speeds)

    def components(self, tangents: Array, motions: Array) -> Array:
        """Components w (k, n) of changes of the coordinates (k, nq) along the tangents N^T (n, nq)."""
        # the rows of independent coordinates suffice, and are better conditioned
        N, right = tangents[:, self.coordinates].T, motions[:, self.coordinates].T
        return np.asarray(np.linalg.lstsq(N, right, rcond=None)[0].T, np.float64)


def _name(speed: str, coordinates: list[str]) -> str:
    """The name of a small motion along a speed."""
    if speed in coordinates:
        return f"q.{speed}"
    return f"{'rotation' if speed.rpartition('.')[2].startswith('w') else 'displacement'}.{speed}"
