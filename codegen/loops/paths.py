"""Paths of loops through the tree, contracted across known joints.

A joint is known when its coordinates (or speeds) are given or have been found by an earlier loop. Bodies separated only
by known joints form one group. A loop then contains only the few joints that are still unknown, however long its cycle
is. Each body of a group stores a link to an inboard body, with its frame or twist relative to that body. Links are
shortened whenever they are followed (union-find). So the cost of all loops together grows little faster than the number
of joints.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..model.vectors import Array, turn
from .closure import Frames, shifted
from .geometry import Geometry, Joints


class Groups:
    """Bodies in groups, merged across known joints.

    Attributes
    ----------
    link : list of int
        An inboard body of the same group; a group's innermost body links to itself.
    """

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self.link = list(range(geometry.ground + 1))

    def join(self, bodies: Iterable[int]) -> None:
        """Mark the joints of some bodies as known."""
        for k in bodies:
            self.link[k] = self.geometry.parent[k]

    def find(self, body: int) -> int:
        """The innermost body of the group of a body; later searches take a shorter path."""
        link, path = self.link, []
        while link[body] != body:
            path.append(body)
            body = link[body]
        for k in reversed(path[:-1]):
            self._shorten(k, link[k])
            link[k] = body
        return body

    def is_known(self, body: int) -> bool:
        """Whether a body's joint is known."""
        return self.link[body] != body

    def _shorten(self, k: int, via: int) -> None:
        """Composes relative data of body k with those of `via`; afterwards they are relative to the body to which `via`
        links."""

    def unknown(self, loop: int) -> tuple[list[int], list[int]]:
        """Bodies with unknown joints on the cycle of a loop, from the cut inward: the start side, and the end side."""
        g = self.geometry
        sides: tuple[list[int], list[int]] = ([], [])
        if loop in g.couplings:
            return [], [k for k in g.couplings[loop].bodies if not self.is_known(k)]
        ends = [self.find(g.starts[loop]), self.find(g.ends[loop])]
        while ends[0] != ends[1]:
            i = int(g.depth[ends[1]] > g.depth[ends[0]])
            sides[i].append(ends[i])
            ends[i] = self.find(g.parent[ends[i]])
        return sides


class PoseGroups(Groups):
    """Groups whose bodies have frames relative to each other, from the coordinates of known joints.

    Attributes
    ----------
    R, o : (n + 1, S, 3, 3), (n + 1, S, 3) array
        Frame of each body in the body it links to, origins in m.
    """

    def __init__(self, geometry: Geometry, q: Array, known: Iterable[int]) -> None:
        super().__init__(geometry)
        n, S = geometry.ground, len(q)
        R, o = geometry.all_joints.transforms(q)
        self.R, self.o = np.empty((n + 1, S, 3, 3)), np.zeros((n + 1, S, 3))
        self.R[:] = np.eye(3)
        self.join(known)
        bodies = np.array([k for k in range(n) if self.link[k] != k], dtype=int)
        self.R[bodies] = np.swapaxes(R, 0, 1)[bodies]
        self.o[bodies] = np.swapaxes(np.broadcast_to(o, R.shape[:3]), 0, 1)[bodies]

    def _shorten(self, k: int, via: int) -> None:
        self.o[k] = self.o[via] + turn(self.R[via], self.o[k])
        self.R[k] = self.R[via] @ self.R[k]

    def found(self, joints: Joints, q: Array) -> None:
        """Mark the joints of some bodies as known, with the given coordinates."""
        R, o = joints.transforms(q)
        for i, k in enumerate(joints.bodies):
            self.R[k], self.o[k] = R[:, i], o[..., i, :]
        self.join(joints.bodies)


class TwistGroups(Groups):
    """Groups of bodies, with the relative twists of their bodies in K motions.

    The twists follow from the speeds of joints that are known, and from the additional motions `own`.

    Attributes
    ----------
    w, v : (n + 1, S, 3, K) array
        Angular velocity of each body and velocity of its origin relative to the body it links to, ground frame.
    """

    def __init__(
        self,
        geometry: Geometry,
        frames: Frames,
        screws: tuple[Array, Array],
        motions: int,
        own: tuple[Array, Array] | None = None,
    ) -> None:
        super().__init__(geometry)
        self.own = own
        self.origin, self.screws = np.swapaxes(frames[1], 0, 1), screws
        shape = (geometry.ground + 1, frames[1].shape[0], 3, motions)
        self.w, self.v = np.zeros(shape), np.zeros(shape)

    def _shorten(self, k: int, via: int) -> None:
        self.v[k] += shifted(self.w[via], self.v[via], self.origin[k] - self.origin[via])
        self.w[k] += self.w[via]

    def found(self, bodies: Iterable[int], u: Array) -> None:
        """Mark the joints of some bodies as known, with the given speeds ``(S, nu, K)``."""
        for k in bodies:
            if speeds := self.geometry.speeds[k]:
                s = slice(speeds.start, speeds.stop)
                for total, screw in ((self.w, self.screws[0]), (self.v, self.screws[1])):
                    total[k] = np.swapaxes(screw[:, s], -1, -2) @ u[:, s]
            if self.own is not None:
                self.w[k] += self.own[0][:, k]
                self.v[k] += self.own[1][:, k]
        self.join(bodies)

    def difference(self, loop: int, point: Array) -> tuple[Array, Array, Array, tuple[list[int], list[int]]]:
        """Relative motion of a loop's faces due to known speeds.

        Parameters
        ----------
        point : (S, 3) array
            Position of the cut, m.

        Returns
        -------
        w, v : (S, 3, K) array
            Relative twist at the cut.
        size : (S, K) array
            Sum of the magnitudes of the twists whose difference this is, a measure for rounding errors.
        unknown : tuple of two lists of int
            Bodies with unknown joints, as returned by `unknown`.
        """
        sides = self.unknown(loop)
        g = self.geometry
        w, v = np.zeros_like(self.w[0]), np.zeros_like(self.v[0])
        size = np.zeros(w.shape[::2])
        if loop in g.couplings:  # a coupling needs speeds, not motions of bodies
            return w, v, size, sides
        for body, side, sign in ((g.starts[loop], sides[0], -1), (g.ends[loop], sides[1], 1)):
            for part in (body, *(g.parent[k] for k in side)):
                if self.find(part) != part:
                    dw, dv = self.w[part], shifted(self.w[part], self.v[part], point - self.origin[part])
                    w, v = w + sign * dw, v + sign * dv
                    size += np.sum(np.abs(dw) + np.abs(dv), axis=1)
        return w, v, size, sides
