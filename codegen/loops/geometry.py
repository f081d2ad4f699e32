"""The geometry of a model as floats: joints, loop joints and paths, ready for arithmetic on many of them at once.

Configurations come in batches: q is ``(S, nq)``, one row a configuration, and everything computed from it has S as its
first axis. The ground is a body too, the last one: index `Geometry.ground`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from ..model.expressions import Expression
from ..model.model import CLOSURE_ROWS, GROUND, Model, Vector, coordinate_axis, least_along
from .ears import Ear
from .speed_groups import QUATERNION, speed_groups

Array = np.ndarray

U = np.eye(3)

LEAST_TOLERANCE = 1e-12
"""Well above rounding: less than this cannot be told from nothing."""


def cross(a: Array, b: Array) -> Array:
    """a x b over the last axis; the others broadcast."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    result = np.empty((*x.shape, 3))
    result[..., 0] = x
    result[..., 1] = az * bx - ax * bz
    result[..., 2] = ax * by - ay * bx
    return result


def turn(R: Array, v: Array) -> Array:
    """R v over the last axes: ``(..., 3, 3)`` and ``(..., 3)``."""
    return (R @ v[..., None])[..., 0]


def skew(a: Array) -> Array:
    """The matrix of a x, ``(..., 3, 3)``."""
    K = np.zeros((*a.shape, 3))
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = a[..., 0], a[..., 1], a[..., 2]
    return K - np.swapaxes(K, -1, -2)


def axis_rotation(K: Array, KK: Array, angle: Array) -> Array:
    """Rotation about unit axes by angles ``(...)``: U + sin K + (1 - cos) K K, K the matrices of the axes."""
    angle = angle[..., None, None]
    return U + np.sin(angle) * K + (1 - np.cos(angle)) * KK


def quaternion_rotation(e: Array) -> Array:
    """Rotation of e/abs(e), e = (w, v) over the last axis, ``(..., 3, 3)``."""
    K = skew(e[..., 1:])
    two = 2 / np.sum(e * e, axis=-1)
    return U + two[..., None, None] * (e[..., 0, None, None] * K + K @ K)


def parameter_values(model: Model, p: Sequence[float] | Array | None) -> dict[str, float]:
    """Parameters by name; None: the defaults."""
    values = [x.value for x in model.parameters] if p is None else [float(x) for x in p]
    if len(values) != len(model.parameters):
        raise ValueError(f"p has {len(values)} values; the model has {len(model.parameters)} parameters")
    return dict(zip(model.parameter_names, values, strict=True))


def evaluator(values: dict[str, float]) -> Callable[[Iterable[Expression]], list[float]]:
    """Values of expressions, each object evaluated once: what a model repeats, it shares."""
    known: dict[int, float] = {}

    def evaluate(expressions: Iterable[Expression]) -> list[float]:
        result = []
        for e in expressions:
            value = known.get(id(e))
            if value is None:
                value = known[id(e)] = float(e.value if e.is_number else e.evaluate(values))
            result.append(value)
        return result

    return evaluate


def unit(a: Array) -> Array:
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def axis_frame(axis: Vector, a: Array, defaults: dict[str, float]) -> tuple[int, Array]:
    """The frame of a loop joint's conditions, see `closure_row_names`: which of its columns is the axis, and the columns.

    Parameters
    ----------
    a : (3,) array
        The unit vector along the axis.
    """
    along = coordinate_axis(axis)
    if along is not None:
        i, sign = along
        turned = np.ones(3)
        if sign < 0:
            turned[[i, (i + 2) % 3]] = -1
        return i, np.diag(turned)
    first = unit(cross(np.eye(3)[least_along(axis, defaults)], a))
    return 2, np.column_stack([first, cross(a, first), a])


class Geometry:
    """Joints and loop joints of a model at given parameters.

    Parameters
    ----------
    model : Model
    p : sequence of float, optional
        Design parameters; the defaults if left out.

    Attributes
    ----------
    ground : int
        Index of the ground, behind the bodies.
    parent, depth : list of int
        By body; ground's parent is itself, its depth 0.
    R0, at : (n, 3, 3), (n, 3) array
        Fixed rotation (joint frame into parent components) and origin (in the parent, m) of the joint frames.
    speeds : list of range
        Speeds of each body's joint.
    speed_body : (nu,) array
        The body whose joint a speed belongs to.
    whole : list of bool
        By body: its joint has a quaternion.
    coordinate : (nu,) array
        The coordinate that a speed is the rate of; `nq` for the speeds of quaternion joints.
    moved : list of slice
        By speed, the coordinates that it moves: a single one; of quaternion joints the position, or the quaternion.
    turning : (nu,) array
        Whether a speed is an angular one.
    screw_w, screw_v : (nu, 3) array
        Angular velocity and velocity of the body's origin, relative to the parent in child components, of a unit
        speed. Of a universal joint's first freedom: the axis in the joint frame, which the second angle turns.
    starts, ends : list of int
        The bodies of the loops' faces.
    face_R, face_at : (2, L, 3, 3), (2, L, 3) array
        Start and end faces in their bodies, m.
    linear, angular : (L, 3, 3) array
        Directions of the loops' conditions in the start face; rows of zeros where there are fewer than three.
    rows, kept : list of list of int
        Which of the six (linear, then angular) are conditions of a loop; and those of them that have not been dropped.
    tolerance : float
        Part of a condition that may be missing where it follows from others.
    own_lengths, lengths : (L,) array
        Characteristic length of each loop, a power of two, m; and that of its ear, by which linear conditions are divided.
    """

    def __init__(self, model: Model, p: Sequence[float] | Array | None = None) -> None:
        self.model = model
        self.tolerance = max(model.loop_tolerance, LEAST_TOLERANCE)
        n = self.ground = len(model.bodies)
        self.nq, self.nu = model.nq, model.nu
        self._evaluate = evaluator(parameter_values(model, p))
        self.parent = [b.parent if b.parent != GROUND else n for b in model.bodies] + [n]
        self.depth = [0] * (n + 1)
        self._cycles: dict[int, tuple[list[int], list[int]]] = {}
        for k in model.outward:
            self.depth[k] = self.depth[self.parent[k]] + 1
        self._joints()
        self._loops()
        points = [self.at, *self.face_at, self._vectors(b.com for b in model.bodies)]
        self._extent = max(float(np.linalg.norm(x, axis=1).max(initial=0.0)) for x in points)
        self.own_lengths = np.array([self._length(i) for i in range(len(model.loops))])
        self.lengths = self.own_lengths.copy()
        self.all_joints = Joints(self, range(n))

    # --- joints -------------------------------------------------------------------------------------------------------

    def _vectors(self, vectors: Iterable[Vector]) -> Array:
        return np.array([self._evaluate(v) for v in vectors]).reshape(-1, 3)

    def _rotation(self, rotations: tuple[tuple[Vector, Expression], ...]) -> Array:
        R = np.eye(3)
        for axis, angle in rotations:
            K = skew(unit(self._vectors([axis])[0]))
            R = R @ axis_rotation(K, K @ K, np.array(self._evaluate([angle])[0]))
        return R

    def _joints(self) -> None:
        bodies, n = self.model.bodies, self.ground
        zero = (Expression.number(0),) * 3
        self.at = self._vectors([b.joint.at for b in bodies])
        self.R0 = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
        for k, b in enumerate(bodies):
            if b.joint.rotation:
                self.R0[k] = self._rotation(b.joint.rotation)
        axes = [self._vectors([b.joint.axes[i] if len(b.joint.axes) > i else zero for b in bodies]) for i in (0, 1)]
        first, second = (a / np.where((s := np.linalg.norm(a, axis=1)) > 0, s, 1.0)[:, None] for a in axes)
        self.types = [b.joint.type for b in bodies]
        self.whole = [t in QUATERNION for t in self.types] + [False]
        self.slices = self.model.coordinate_slices
        self.speeds = [range(u.start, u.stop) for _, u in self.slices] + [range(0)]

        # Where each body finds its angles, its displacement and its quaternion in q; nq (a zero) if it has none.
        nowhere = self.nq
        self.angle1, self.angle2, self.slide = (np.full(n, nowhere) for _ in range(3))
        self.speed_body = np.zeros(self.nu, dtype=int)
        self.coordinate = np.full(self.nu, nowhere)
        self.moved = [group.coordinates for group in speed_groups(self.model) for _ in group.speeds]
        self.screw_w, self.screw_v = np.zeros((self.nu, 3)), np.zeros((self.nu, 3))
        for k, (q, u) in enumerate(self.slices):
            self.speed_body[u] = k
            match self.types[k]:
                case "revolute":
                    self.angle1[k], self.screw_w[u] = q.start, first[k]
                    self.coordinate[u] = q.start
                case "prismatic":
                    self.slide[k], self.screw_v[u] = q.start, first[k]
                    self.coordinate[u] = q.start
                case "universal":
                    self.angle1[k], self.angle2[k] = q.start, q.start + 1
                    self.screw_w[u] = first[k], second[k]
                    self.coordinate[u] = range(q.start, q.stop)
                case "spherical":
                    self.screw_w[u] = np.eye(3)
                case "free":
                    self.screw_w[u.start : u.start + 3] = np.eye(3)
                    self.screw_v[u.start + 3 : u.stop] = np.eye(3)
        self.turning = np.any(self.screw_w != 0, axis=1)
        sliding = self.slide != nowhere
        self.slide_axis = np.where(sliding[:, None], first, 0.0)
        self.K1 = np.where((self.angle1 != nowhere)[:, None, None], skew(first), 0.0)
        self.K2 = np.where((self.angle2 != nowhere)[:, None, None], skew(second), 0.0)

    # --- loop joints --------------------------------------------------------------------------------------------------

    def _loops(self) -> None:
        loops, n = self.model.loops, self.ground
        self.starts = [x.start.body if x.start.body != GROUND else n for x in loops]
        self.ends = [x.end.body if x.end.body != GROUND else n for x in loops]
        faces = [[x.start for x in loops], [x.end for x in loops]]
        self.face_at = np.array([self._vectors(f.at for f in side) for side in faces])
        self.face_R = np.array([[self._rotation(f.rotation) for f in side] for side in faces]).reshape(2, -1, 3, 3)
        self.linear, self.angular = np.zeros((len(loops), 3, 3)), np.zeros((len(loops), 3, 3))
        self.axis, self.end_axis = np.zeros((len(loops), 3)), np.zeros((len(loops), 3))
        self.rows = []
        for i, loop in enumerate(loops):
            linear, angular = CLOSURE_ROWS[loop.type]
            self.rows.append([*range(linear), *range(3, 3 + angular)])
            k, frame = 2, np.eye(3)
            if loop.axes:
                a, b = self._vectors(loop.axes)[[0, -1]]
                self.axis[i], self.end_axis[i] = unit(a), unit(b)
                k, frame = axis_frame(loop.axes[0], self.axis[i], self.model.defaults)
            across = frame[:, [(k + 1) % 3, (k + 2) % 3]].T
            if linear == 3:
                self.linear[i] = frame.T
            elif linear == 2:
                self.linear[i, :2] = across
            else:
                self.linear[i, 0] = self.axis[i]
            if angular == 3:
                self.angular[i] = frame.T
            elif angular == 2:
                self.angular[i, :2] = across
        self.kept = [list(rows) for rows in self.rows]
        types = [x.type for x in loops]
        self.turned_whole = np.array([t in ("fixed", "prismatic") for t in types], dtype=bool)
        self.is_universal = np.array([t == "universal" for t in types], dtype=bool)

    def _length(self, loop: int, window: int = 8) -> float:
        """The mean distance between neighbouring joints near the cut, rounded to a power of two, m.

        It uses what is fixed in the bodies and so does not depend on the configuration. Distances within the tolerance of
        the model's largest are not meant: joints stand in one place.
        """
        ends = [self.starts[loop], self.ends[loop]]
        points = [self.face_at[0, loop], self.face_at[1, loop]]
        distances = []
        for _ in range(window):
            if ends[0] == ends[1]:
                distances.append(np.linalg.norm(points[0] - points[1]))
                break
            i = int(self.depth[ends[1]] > self.depth[ends[0]])
            distances.append(np.linalg.norm(points[i]))  # a body's origin is on its joint
            points[i], ends[i] = self.at[ends[i]], self.parent[ends[i]]
        distances = [d for d in distances if d > self.tolerance * self._extent]
        return float(2.0 ** np.round(np.log2(np.mean(distances)))) if distances else 1.0

    def follow(self, ear: Ear) -> None:
        """Take the characteristic length of an ear, and drop the conditions that it drops."""
        self.lengths[list(ear.loops)] = ear.length
        for i in {i for i, _ in ear.dropped}:
            self.kept[i] = [r for n, r in enumerate(self.rows[i]) if (i, n) not in ear.dropped]

    def cycle(self, loop: int) -> tuple[list[int], list[int]]:
        """Bodies whose joints the loop passes, from the cut inward: on the start side, on the end side."""
        known = self._cycles.get(loop)
        if known is None:
            start, end = [], []
            depth, parent = self.depth, self.parent
            a, b = self.starts[loop], self.ends[loop]
            while a != b:
                if depth[b] > depth[a]:
                    end.append(b)
                    b = parent[b]
                else:
                    start.append(a)
                    a = parent[a]
            known = self._cycles[loop] = (start, end)
        return known


class Joints:
    """The joints of some bodies, for repeated evaluation.

    Parameters
    ----------
    geometry : Geometry
    bodies : iterable of int
        m bodies.

    Attributes
    ----------
    speeds : (f,) array
        The speeds of these joints, body by body.
    place : (f,) array
        Which of the m bodies a speed belongs to.
    """

    def __init__(self, geometry: Geometry, bodies: Iterable[int]) -> None:
        g, self.bodies = geometry, list(bodies)
        b = np.array(self.bodies, dtype=int)
        self.R0, self.at = g.R0[b], g.at[b]
        self.angle1, self.angle2, self.slide = g.angle1[b], g.angle2[b], g.slide[b]
        self.K1 = g.K1[b]
        self.KK1 = self.K1 @ self.K1
        self.slide_axis = g.slide_axis[b]
        self.sliding = bool(np.any(self.slide != g.nq))
        self.universal = np.flatnonzero(self.angle2 != g.nq)
        self.K2 = g.K2[b[self.universal]]
        self.KK2 = self.K2 @ self.K2
        self.quaternions = [(i, g.slices[k][0]) for i, k in enumerate(self.bodies) if g.whole[k]]
        self.speeds = np.array([s for k in self.bodies for s in g.speeds[k]], dtype=int)
        self.place = np.array([i for i, k in enumerate(self.bodies) for _ in g.speeds[k]], dtype=int)
        self.screw_w, self.screw_v = g.screw_w[self.speeds], g.screw_v[self.speeds]
        start = {int(s): i for i, s in enumerate(self.speeds)}
        self.first_axes = np.array([start[g.speeds[self.bodies[i]].start] for i in self.universal], dtype=int)

    def transforms(self, q: Array) -> tuple[Array, Array]:
        """Child components into parent components and the child's origin in the parent.

        Parameters
        ----------
        q : (S, nq + 1) array
            Coordinates and a zero.

        Returns
        -------
        (S, m, 3, 3), (S, m, 3) or (m, 3) array
        """
        R = axis_rotation(self.K1, self.KK1, q[:, self.angle1])
        if len(self.universal):
            R[:, self.universal] = R[:, self.universal] @ axis_rotation(
                self.K2, self.KK2, q[:, self.angle2[self.universal]]
            )
        d = self.at
        moved = None
        if self.sliding:
            moved = q[:, self.slide, None] * self.slide_axis
        for i, place in self.quaternions:
            R[:, i] = quaternion_rotation(q[:, place.stop - 4 : place.stop])
            if place.stop - place.start == 7:
                if moved is None:
                    moved = np.zeros((*R.shape[:2], 3))
                moved[:, i] = q[:, place.start : place.start + 3]
        if moved is not None:
            d = d + turn(self.R0, moved)
        return self.R0 @ R, d

    def screws(self, q: Array) -> tuple[Array, Array]:
        """Unit screws of the speeds about their bodies' origins, child components, each ``(f, 3)`` or ``(S, f, 3)``.

        The first axis of a universal joint is seen through the second angle.
        """
        if not len(self.universal):
            return self.screw_w, self.screw_v
        w = np.broadcast_to(self.screw_w, (len(q), *self.screw_w.shape)).copy()
        second = axis_rotation(self.K2, self.KK2, -q[:, self.angle2[self.universal]])
        w[:, self.first_axes] = turn(second, w[:, self.first_axes])
        return w, self.screw_v


def padded(q: Sequence[float] | Array) -> Array:
    """Coordinates ``(nq,)`` or ``(S, nq)`` as ``(S, nq + 1)`` with a zero behind, where bodies without an angle look."""
    q = np.atleast_2d(np.asarray(q, dtype=float))
    return np.concatenate([q, np.zeros((len(q), 1))], axis=1)


def advance(geometry: Geometry, q: Array, speeds: Sequence[int] | Array, step: Array) -> Array:
    """Coordinates after a displacement along some speeds.

    Parameters
    ----------
    q : (S, nq + 1) array
    speeds : (f,)
        Of a quaternion joint some or all; where one of them turns, the quaternion gets unit length.
    step : (S, f) array
        rad and m; of quaternion joints the rotation vector and displacement in child components, zero along speeds that
        are not listed.
    """
    g = geometry
    q = q.copy()
    speeds = np.asarray(speeds, dtype=int)
    where = g.coordinate[speeds]
    scalar = where != g.nq
    q[:, where[scalar]] += step[:, scalar]
    columns: dict[int, list[int]] = {}
    for i in np.flatnonzero(~scalar):
        columns.setdefault(int(g.speed_body[speeds[i]]), []).append(int(i))
    for k, of_body in columns.items():
        place, which = g.slices[k][0], speeds[of_body] - g.speeds[k].start
        moved = np.zeros((len(q), 6))
        moved[:, which] = step[:, of_body]
        e = q[:, place.stop - 4 : place.stop]
        if np.any(which >= 3):
            q[:, place.start : place.start + 3] += turn(quaternion_rotation(e), moved[:, 3:])
        if np.any(which < 3):
            q[:, place.stop - 4 : place.stop] = _turned_quaternion(e, moved[:, :3])
    return q


def _turned_quaternion(e: Array, rotation: Array) -> Array:
    """e times the quaternion of a rotation vector, both over the last axis, of unit length."""
    half = np.linalg.norm(rotation, axis=-1, keepdims=True) / 2
    v = rotation / 2 * np.sinc(half / np.pi)
    w = np.cos(half)
    e0, ev = e[..., :1], e[..., 1:]
    product = np.concatenate([e0 * w - np.sum(ev * v, axis=-1, keepdims=True), e0 * v + w * ev + cross(ev, v)], axis=-1)
    return unit(product)
