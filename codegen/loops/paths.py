"""Paths of loops through the tree, with what is known already contracted.

A joint is known when its coordinates (or speeds) are given or have been found by an earlier loop. Bodies that only known
joints part are one group; a loop then sees the few joints that are still unknown, however long its cycle is. Groups are
kept as links to an inboard body with the relative frame or twist, shortened whenever they are followed (union-find), so
all loops together cost little more than the number of joints.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from .closure import Cuts, Frames, shifted
from .geometry import Array, Geometry, Joints, turn


class Groups:
    """Bodies merged across known joints.

    Attributes
    ----------
    link : list of int
        An inboard body of the same group; a group's innermost body links to itself.
    """

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self.link = list(range(geometry.ground + 1))

    def join(self, bodies: Iterable[int]) -> None:
        """The joints of these bodies have become known."""
        for k in bodies:
            self.link[k] = self.geometry.parent[k]

    def find(self, body: int) -> int:
        """The innermost body of the group; links on the way are shortened to it."""
        link, path = self.link, []
        while link[body] != body:
            path.append(body)
            body = link[body]
        for k in reversed(path[:-1]):
            self._shorten(k, link[k])
            link[k] = body
        return body

    def _shorten(self, k: int, via: int) -> None:
        """What body k has relative to `via` is given relative to what `via` has its own relative to."""

    def unknown(self, loop: int) -> tuple[list[int], list[int]]:
        """Bodies with unknown joints on a loop's cycle, from the cut inward, on the start side and on the end side."""
        g = self.geometry
        sides: tuple[list[int], list[int]] = ([], [])
        ends = [self.find(g.starts[loop]), self.find(g.ends[loop])]
        while ends[0] != ends[1]:
            i = int(g.depth[ends[1]] > g.depth[ends[0]])
            sides[i].append(ends[i])
            ends[i] = self.find(g.parent[ends[i]])
        return sides


class PoseGroups(Groups):
    """Groups with relative frames, from the coordinates of known joints.

    Attributes
    ----------
    R, o : (n + 1, S, 3, 3), (n + 1, S, 3) array
        Frame of each body in the body it links to; m.
    """

    def __init__(self, geometry: Geometry, q: Array, known: Iterable[int]) -> None:
        super().__init__(geometry)
        n, S = geometry.ground, len(q)
        R, o = geometry.all_joints.transforms(q)
        self.R, self.o = np.empty((n + 1, S, 3, 3)), np.zeros((n + 1, S, 3))
        self.R[:] = np.eye(3)
        self.join(known)
        bodies = np.array([k for k in range(n) if self.link[k] != k], dtype=int)
        self.R[bodies], self.o[bodies] = np.swapaxes(R, 0, 1)[bodies], np.swapaxes(o, 0, 1)[bodies]

    def _shorten(self, k: int, via: int) -> None:
        self.o[k] = self.o[via] + turn(self.R[via], self.o[k])
        self.R[k] = self.R[via] @ self.R[k]

    def found(self, joints: Joints, q: Array) -> None:
        """Coordinates of these joints have been found."""
        R, o = joints.transforms(q)
        for i, k in enumerate(joints.bodies):
            self.R[k], self.o[k] = R[:, i], o[:, i]
        self.join(joints.bodies)


class TwistGroups(Groups):
    """Groups with relative twists of K motions, from the speeds of known joints.

    Attributes
    ----------
    w, v : (n + 1, S, 3, K) array
        Angular velocity of each body and velocity of its origin relative to the body it links to, ground frame.
    """

    def __init__(self, geometry: Geometry, frames: Frames, screws: tuple[Array, Array], motions: int) -> None:
        super().__init__(geometry)
        self.origin, self.screws = np.swapaxes(frames[1], 0, 1), screws
        shape = (geometry.ground + 1, frames[1].shape[0], 3, motions)
        self.w, self.v = np.zeros(shape), np.zeros(shape)

    def _shorten(self, k: int, via: int) -> None:
        self.v[k] += shifted(self.w[via], self.v[via], self.origin[k] - self.origin[via])
        self.w[k] += self.w[via]

    def found(self, bodies: Iterable[int], u: Array) -> None:
        """Speeds ``(S, nu, K)`` of the joints of these bodies have been found."""
        for k in bodies:
            if speeds := self.geometry.speeds[k]:
                s = slice(speeds.start, speeds.stop)
                for total, screw in ((self.w, self.screws[0]), (self.v, self.screws[1])):
                    total[k] = np.swapaxes(screw[:, s], -1, -2) @ u[:, s]
        self.join(bodies)

    def at(self, body: int, point: Array) -> tuple[Array, Array]:
        """Motion ``(S, 3, K)`` of a body relative to its group's innermost one, velocity at a point ``(S, 3)``."""
        if self.find(body) == body:  # groups start at rest
            return np.zeros_like(self.w[body]), np.zeros_like(self.v[body])
        return self.w[body], shifted(self.w[body], self.v[body], point - self.origin[body])

    def difference(self, loop: int, point: Array) -> tuple[Array, Array, tuple[list[int], list[int]]]:
        """Relative twist ``(S, 3, K)`` of a loop's faces at its cut due to known speeds, and the unknown joints' bodies."""
        g = self.geometry
        sides: tuple[list[int], list[int]] = ([], [])
        ends = [g.starts[loop], g.ends[loop]]
        (w_s, v_s), (w_e, v_e) = self.at(ends[0], point), self.at(ends[1], point)
        w, v = w_e - w_s, v_e - v_s
        roots = [self.find(ends[0]), self.find(ends[1])]
        while roots[0] != roots[1]:
            i = int(g.depth[roots[1]] > g.depth[roots[0]])
            sides[i].append(roots[i])
            inboard = g.parent[roots[i]]
            dw, dv = self.at(inboard, point)
            w, v = (w + dw, v + dv) if i else (w - dw, v - dv)
            roots[i] = self.find(inboard)
        return w, v, sides


class Ring:
    """The unknown joints of some loops, everything known in between rigid: closes on floats.

    Parameters
    ----------
    groups : PoseGroups
    loops : sequence of int
    bodies : iterable of int
        Those whose joints move.

    Attributes
    ----------
    joints : Joints
        Outward.
    """

    def __init__(self, groups: PoseGroups, loops: Sequence[int], bodies: Iterable[int]) -> None:
        g = groups.geometry
        self.geometry = g
        self.joints = Joints(g, sorted(bodies, key=lambda k: (g.depth[k], k)))
        self.cuts = Cuts(g, loops)
        place = {k: i for i, k in enumerate(self.joints.bodies)}
        fixed = len(place)  # the place of what no moving joint carries
        inboard = [self._carrier(groups, place, g.parent[k]) for k in self.joints.bodies]
        self.inboard = [c for c, _, _, _ in inboard]
        self.R_in = np.stack([R for _, R, _, _ in inboard], axis=1) if inboard else np.zeros((1, 0, 3, 3))
        self.o_in = np.stack([o for _, _, o, _ in inboard], axis=1) if inboard else np.zeros((1, 0, 3))
        bases = [base for _, _, _, base in inboard]

        self.sign = np.zeros((len(self.cuts.loops), fixed + 1))
        self.face_carriers, self.face_R, self.face_o = [], [], []
        ends: list[list[int]] = []
        for side, sign, faces in ((0, -1, self.cuts.starts), (1, 1, self.cuts.ends)):
            carriers = [self._carrier(groups, place, int(body)) for body in faces]
            self.face_carriers.append([c for c, _, _, _ in carriers])
            R, o = (np.stack([x[i] for x in carriers], axis=1) for i in (1, 2))
            self.face_R.append(R @ self.cuts.face_R[side])
            self.face_o.append(o + turn(R, self.cuts.face_at[side]))
            ends.append([])
            for j, (carrier, _, _, base) in enumerate(carriers):
                while carrier != fixed:
                    self.sign[j, carrier] += sign
                    base = bases[carrier]
                    carrier = self.inboard[carrier]
                ends[-1].append(base)
        if ends[0] != ends[1]:
            names = ", ".join(g.model.loops[i].name for i in self.cuts.loops)
            raise RuntimeError(f"loops {names}: joints between their ends are not known yet; the ears are out of order")

    @staticmethod
    def _carrier(groups: PoseGroups, place: dict[int, int], body: int) -> tuple[int, Array, Array, int]:
        """The moving joint that carries a body, the body's frame in that joint's body, and the innermost body."""
        base = groups.find(body)
        if body == base:
            R, o = np.broadcast_to(np.eye(3), groups.R[body].shape), np.zeros_like(groups.o[body])
        else:
            R, o = groups.R[body], groups.o[body]
        return place.get(base, len(place)), R, o, base

    def evaluate(self, q: Array) -> tuple[Array, Array]:
        """Position residuals ``(S, rows)`` and closure matrix ``(S, rows, f)`` of all speeds of the moving joints."""
        joints, m = self.joints, len(self.joints.bodies)
        R_joint, d = joints.transforms(q)
        R, o = np.empty((len(q), m + 1, 3, 3)), np.empty((len(q), m + 1, 3))
        R[:, m], o[:, m] = np.eye(3), 0
        R[:, :m] = self.R_in @ R_joint
        o[:, :m] = self.o_in + turn(self.R_in, d)
        for i, carrier in enumerate(self.inboard):
            if carrier != m:
                o[:, i] = o[:, carrier] + turn(R[:, carrier], o[:, i])
                R[:, i] = R[:, carrier] @ R[:, i]
        faces = []
        for side in (0, 1):
            C = R[:, self.face_carriers[side]]
            faces += [C @ self.face_R[side], o[:, self.face_carriers[side]] + turn(C, self.face_o[side])]
        residual = self.cuts.place((faces[0], faces[1], faces[2], faces[3]))
        w, v = joints.screws(q)
        C = R[:, joints.place]
        E = self.cuts.matrix(turn(C, w), turn(C, v), o[:, joints.place], self.sign[:, joints.place])
        return self.cuts.kept(residual), E

    def reach(self) -> Array:
        """How far from the base the cuts are, in characteristic lengths, ``(S,)``: the measure of rounding."""
        lengths = self.geometry.lengths[self.cuts.loops]
        return np.max(np.linalg.norm(self.cuts.point, axis=-1) / lengths, axis=-1)
