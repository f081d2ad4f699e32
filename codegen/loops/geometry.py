"""The geometry of a model as numbers: joints, loop joints and paths, for arithmetic on many configurations at once.

q is ``(S, nq)``, one row per configuration, and everything computed from it has S as its first axis. The ground counts as
the last body, with index `Geometry.ground`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence

import numpy as np

from ..model.chains import Chain, speeds_of, step
from ..model.expressions import Expression
from ..model.model import GROUND, Coupling, Kind, Model, Vector, coordinate_axis, least_along
from ..model.motions import Ball, Displacement
from ..model.quarter_turns import cosine_and_sine, quarter_turns
from ..model.vectors import Array, U, axis_rotation, cross, skew, turn, turned_quaternion, unit
from .algebraic import Coupled, Surfaced
from .ancestry import Ancestry
from .ears import Ear
from .speed_groups import speed_groups

LEAST_TOLERANCE = 1e-12
"""Smallest tolerance, well above rounding errors; smaller tolerances are replaced by it."""


def parameter_values(model: Model, p: Sequence[float] | Array | None) -> dict[str, float]:
    """Values of the parameters by name; None gives the defaults."""
    values = [x.value for x in model.parameters] if p is None else [float(x) for x in p]
    if len(values) != len(model.parameters):
        raise ValueError(f"p has {len(values)} values; the model has {len(model.parameters)} parameters")
    return dict(zip(model.parameter_names, values, strict=True))


def evaluator(values: dict[str, float]) -> Callable[[Iterable[Expression]], list[float]]:
    """A function that evaluates expressions; an expression that occurs several times is evaluated once."""
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


def axis_frame(axis: Vector, a: Array, defaults: dict[str, float]) -> tuple[int, Array]:
    """The frame of a loop joint's conditions, preceded by the number of the frame's column along the joint axis; see
    `closure_row_names`.

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
        Design parameters; the defaults if omitted.
    lengths : (L,) array, optional
        Characteristic lengths; those of the single loops if omitted.

    Attributes
    ----------
    ground : int
        Index of the ground, behind the bodies.
    parent, depth : list of int
        By body; the ground is its own parent, at depth 0.
    R0, at : (n, 3, 3), (n, 3) array
        Fixed rotation (joint frame into parent components) and origin (in the parent, m) of the joint frames.
    speeds : list of range
        Speeds of each body's joint.
    speed_body : (nu,) array
        The body of each speed's joint.
    whole : list of bool
        By body: whether its joint has a quaternion.
    coordinate : (nu,) array
        The coordinate whose rate each speed is; `nq` for the speeds of quaternion joints.
    moved : list of slice
        By speed, the coordinates that it changes: a single one; in quaternion joints the position or the quaternion.
    turning : (nu,) array
        Whether each speed is angular.
    kinds : list of type of JointType
        By body.
    chains : dict of type of JointType to Chain
        The motion of all joints of a type; `row (n,)` holds each body's position in it.
    screw_w, screw_v : (nu, 3) array
        Angular velocity of the body and velocity of its origin per unit speed, relative to the parent, child
        components. If later motions of the same joint rotate a motion, its rows omit this rotation, and those of
        `still_w`, `still_v` are zero.
    all_joints : Joints
    ancestry : Ancestry
    starts, ends : list of int
        The bodies of the loops' faces.
    face_R, face_at : (2, L, 3, 3), (2, L, 3) array
        Start and end faces in their bodies, m.
    linear, angular : (L, 3, 3) array
        Directions of the loops' conditions in the start face; rows of zeros where there are fewer than three.
    surfaces : dict of int to Surfaced
        By loop, its conditions on points.
    couplings : dict of int to Coupled
        By loop, its coupling; the condition is in the fourth row, the first angular one.
    rows, kept : list of list of int
        Rows of each loop among six (linear, then angular) that are conditions; and those of them that are not dropped.
    tolerance : float
        Residual within which a redundant condition counts as met.
    own_lengths, lengths : (L,) array
        Characteristic length of each loop, a power of two, m; and of its ear, by which linear conditions are divided.
    """

    def __init__(self, model: Model, p: Sequence[float] | Array | None = None, lengths: Array | None = None) -> None:
        self.model = model
        self.tolerance = max(model.loop_tolerance, LEAST_TOLERANCE)
        n = self.ground = len(model.bodies)
        self.nq, self.nu = model.nq, model.nu
        self._parameters = parameter_values(model, p)
        self._evaluate = evaluator(self._parameters)
        self.parent = [b.parent if b.parent != GROUND else n for b in model.bodies] + [n]
        self.depth = [0] * (n + 1)
        self._cycles: dict[int, tuple[list[int], list[int]]] = {}
        for k in model.outward:
            self.depth[k] = self.depth[self.parent[k]] + 1
        self.ancestry = Ancestry(self.parent, self.depth, model.outward, n)
        self._joints()
        self._loops()
        self.own_lengths = self._own_lengths() if lengths is None else lengths
        self.lengths = self.own_lengths.copy()

    # --- joints -------------------------------------------------------------------------------------------------------

    def _vectors(self, vectors: Iterable[Vector]) -> Array:
        return np.array([self._evaluate(v) for v in vectors]).reshape(-1, 3)

    def _rotation(self, rotations: tuple[tuple[Vector, Expression], ...]) -> Array:
        R = np.eye(3)
        for axis, angle in rotations:
            K = skew(unit(self._vectors([axis])[0]))
            quarters = quarter_turns(angle)
            if quarters is None:
                R = R @ axis_rotation(K, K @ K, np.array(self._evaluate([angle])[0]))
            else:
                cosine, sine = cosine_and_sine(quarters)
                R = R @ (U + sine * K + (1 - cosine) * (K @ K))
        return R

    def turned_behind(self, body: int, q: Array) -> Array | None:
        """Rotation ``(S, 3, 3)`` of a joint's first motion by its later motions; None if the later motions do not
        rotate."""
        known = self._behind.get(body)
        if known is None:
            chain = self.chains[self.kinds[body]].without_first()
            known = self._behind[body] = chain.of(self.row[[body]])
        R = known.transforms(q)[0]
        return None if R is None else R[:, 0]

    def _joints(self) -> None:
        bodies, n = self.model.bodies, self.ground
        zero = (Expression.number(0),) * 3
        self.at = self._vectors([b.joint.at for b in bodies])
        self.R0 = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
        for k, b in enumerate(bodies):
            if b.joint.rotation:
                self.R0[k] = self._rotation(b.joint.rotation)
        self.kinds = [b.joint.kind for b in bodies]
        self.whole = [bool(kind.quaternions) for kind in self.kinds] + [False]
        self.slices = self.model.coordinate_slices
        start, first = (np.array([x[i].start for x in self.slices], dtype=int) for i in (0, 1))
        self.speeds = [range(u.start, u.stop) for _, u in self.slices] + [range(0)]
        most = max(len(b.joint.axes) for b in bodies)
        axes = np.zeros((n, most, 3))
        for i in range(most):
            axes[:, i] = self._vectors(b.joint.axes[i] if len(b.joint.axes) > i else zero for b in bodies)
        length = np.linalg.norm(axes, axis=-1, keepdims=True)
        unit_axes = axes / np.where(length > 0, length, 1.0)
        given = [self._evaluate(b.joint.factors) for b in bodies]
        factors = np.zeros((n, max(map(len, given))))
        for k, row in enumerate(given):
            factors[k, : len(row)] = row

        self.speed_body = np.array(
            [k for k, (_, u) in enumerate(self.slices) for _ in range(u.start, u.stop)], dtype=int
        )
        self.coordinate = np.full(self.nu, self.nq)
        self.moved = []
        for group in speed_groups(self.model):
            self.moved += [group.coordinates] * len(group.speeds)
            if len(group.speeds) == 1:
                self.coordinate[group.speeds.start] = group.coordinates.start
        alike: dict[Kind, list[int]] = {}
        for k, kind in enumerate(self.kinds):
            if kind.motion:
                alike.setdefault(kind, []).append(k)
        self.chains: dict[Kind, Chain] = {}
        self.row = np.zeros(n, dtype=int)
        self.screw_w, self.screw_v, self.still_w, self.still_v = (np.zeros((self.nu, 3)) for _ in range(4))
        for kind, ks in alike.items():
            self.row[ks] = np.arange(len(ks))
            steps = [step(m, start[ks], unit_axes[ks], factors[ks]) for m in kind.motion]
            chain = self.chains[kind] = Chain(kind.motion, steps)
            speeds = first[ks][:, None] + np.arange(len(kind.speeds))
            self.screw_w[speeds], self.screw_v[speeds] = chain.unit_screws(range(len(steps)))
            self.still_w[speeds], self.still_v[speeds] = chain.unit_screws(set(range(len(steps))) - set(chain.altered))
        self.turning = np.any(self.screw_w != 0, axis=1)
        self._behind: dict[int, Chain] = {}
        self.all_joints = Joints(self, range(n))

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
            linear, angular = loop.closure
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
        self.couplings = {i: self._coupled(x) for i, x in enumerate(loops) if isinstance(x, Coupling)}
        parameters = {name: np.float64(value) for name, value in self._parameters.items()}
        self.surfaces = {i: Surfaced(x.surfaces, parameters) for i, x in enumerate(loops) if x.surfaces}
        by_angles = np.array([0 if x.is_coupling else x.closure.angular for x in loops], dtype=int)
        self.is_whole_turn, self.is_perpendicular = by_angles == 3, by_angles == 1

    def _coupled(self, of: Coupling) -> Coupled:
        """The coupling of a loop, with its factors and its offset as numbers."""
        places = [[s.start + t.index for s in self.slices[t.body]] for t in of.terms]
        q, u = (np.array([place[i] for place in places], dtype=int) for i in (0, 1))
        return Coupled(
            list(dict.fromkeys(t.body for t in of.terms)), u, q,
            np.array(self._evaluate(t.factor for t in of.terms)), self._evaluate([of.offset])[0],
        )  # fmt: skip

    def _own_lengths(self) -> Array:
        points = [self.at, *self.face_at, self._vectors(b.com for b in self.model.bodies)]
        self._extent = max(float(np.linalg.norm(x, axis=1).max(initial=0.0)) for x in points)
        found = np.array([self._length(i) for i in range(len(self.model.loops))])
        joined = [i for i in range(len(self.model.loops)) if i not in self.couplings]
        if joined:  # a coupling has no length; the smallest length of the loops is used
            found[list(self.couplings)] = found[joined].min()
        return found

    def _length(self, loop: int, window: int = 8) -> float:
        """Mean distance between neighbouring joints near the cut, rounded to a power of two, m.

        It depends only on dimensions of the bodies, not on the configuration. Distances below the tolerance times the model's
        largest dimension are ignored: such joints coincide.
        """
        ends = [self.starts[loop], self.ends[loop]]
        points = [self.face_at[0, loop], self.face_at[1, loop]]
        distances = []
        for _ in range(window):
            if ends[0] == ends[1]:
                distances.append(np.linalg.norm(points[0] - points[1]))
                break
            i = int(self.depth[ends[1]] > self.depth[ends[0]])
            distances.append(np.linalg.norm(points[i]))  # this joint is at the body's origin
            points[i], ends[i] = self.at[ends[i]], self.parent[ends[i]]
        distances = [d for d in distances if d > self.tolerance * self._extent]
        return float(2.0 ** np.round(np.log2(np.mean(distances)))) if distances else 1.0

    def turn_round(self, loops: Collection[int]) -> None:
        """Expresses the conditions of some loops along the axes of the ``to`` face."""
        kept, self.model = self.kept, self.model.with_turned(loops)
        self._cycles.clear()
        self._loops()
        self.kept = kept

    def follow(self, ear: Ear) -> None:
        """Copies the characteristic length and the dropped conditions of an ear."""
        self.lengths[list(ear.loops)] = ear.length
        for i in {i for i, _ in ear.dropped}:
            self.kept[i] = [r for n, r in enumerate(self.rows[i]) if (i, n) not in ear.dropped]

    def cycle(self, loop: int) -> tuple[list[int], list[int]]:
        """Bodies whose joints the loop passes, from the cut inward: on the start side, on the end side.

        A coupling passes the joints whose coordinates it couples, and none between them.
        """
        known = self._cycles.get(loop)
        if known is None and loop in self.couplings:
            known = self._cycles[loop] = ([], self.couplings[loop].bodies)
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

    def passed(self, loops: Iterable[int]) -> set[int]:
        """Bodies whose joints are on the cycles of some loops."""
        return {k for i in loops for side in self.cycle(i) for k in side}

    def passed_speeds(self, loops: Iterable[int]) -> set[int]:
        """Speeds of the joints on the cycles of some loops."""
        return {s for k in self.passed(loops) for s in self.speeds[k]}


class Joints:
    """The joints of some bodies, prepared for repeated evaluation.

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
        Position of each speed's body among the m bodies.
    """

    def __init__(self, geometry: Geometry, bodies: Iterable[int]) -> None:
        g, self.bodies = geometry, list(bodies)
        b = np.array(self.bodies, dtype=int)
        self.R0, self.at = g.R0[b], g.at[b]
        self.speeds = np.array([s for k in self.bodies for s in g.speeds[k]], dtype=int)
        self.place = np.array([i for i, k in enumerate(self.bodies) for _ in g.speeds[k]], dtype=int)
        self.still_w, self.still_v = g.still_w[self.speeds], g.still_v[self.speeds]
        alike: dict[Kind, list[int]] = {}
        for i, k in enumerate(self.bodies):
            alike.setdefault(g.kinds[k], []).append(i)
        self.chains: list[tuple[Array, Chain]] = []
        self.changing: list[tuple[Chain, list[Array]]] = []
        unturned: list[int] = []
        for kind, members in alike.items():
            if not kind.motion or not g.chains[kind].turns:
                unturned += members
            if not kind.motion:
                continue
            places = np.array(members)
            chain = g.chains[kind].of(g.row[b[places]])
            self.chains.append((places, chain))
            if chain.altered:
                first = np.searchsorted(self.place, places)  # the first speed of each joint
                columns = first[:, None] + np.arange(len(kind.speeds))
                self.changing.append((chain, [columns[:, chain.steps[i].speeds] for i in chain.altered]))
        self.unturned = np.array(unturned, dtype=int)

    def transforms(self, q: Array) -> tuple[Array, Array]:
        """Rotation from child components to parent components, and the child's origin in the parent.

        Parameters
        ----------
        q : (S, nq + 1) array
            Coordinates and a zero.

        Returns
        -------
        (S, m, 3, 3), (S, m, 3) or (m, 3) array
        """
        shape = (len(q), len(self.bodies), 3, 3)
        R = moved = None
        for places, chain in self.chains:
            turned, shifted = chain.transforms(q)
            if len(places) == len(self.bodies):
                R, moved = turned, shifted
                break
            if turned is not None:
                if R is None:
                    R = np.empty(shape)
                    R[:, self.unturned] = U
                R[:, places] = turned
            if shifted is not None:
                moved = np.zeros(shape[:3]) if moved is None else moved
                moved[:, places] = shifted
        R = np.broadcast_to(self.R0, shape) if R is None else self.R0 @ R
        return R, self.at if moved is None else self.at + turn(self.R0, moved)

    def screws(self, q: Array) -> tuple[Array, Array]:
        """Unit screws of the speeds about their bodies' origins, child components, each ``(f, 3)`` or ``(S, f, 3)``.

        An earlier motion of a joint is rotated by the later ones.
        """
        if not self.changing:
            return self.still_w, self.still_v
        w, v = self.still_w, self.still_v
        for chain, columns in self.changing:
            for of_step, (w_own, v_own) in zip(columns, chain.screws(q), strict=True):
                if w_own is not None:
                    w = np.repeat(w[None], len(q), axis=0) if w.ndim == 2 else w
                    w[:, of_step] += w_own
                if v_own is not None:
                    v = np.repeat(v[None], len(q), axis=0) if v.ndim == 2 else v
                    v[:, of_step] += v_own
        return w, v


def padded(q: Sequence[float] | Array) -> Array:
    """Coordinates ``(nq,)`` or ``(S, nq)`` as ``(S, nq + 1)``; bodies without a coordinate read the zero at the end."""
    q = np.atleast_2d(np.asarray(q, dtype=float))
    return np.concatenate([q, np.zeros((len(q), 1))], axis=1)


def advance(geometry: Geometry, q: Array, speeds: Sequence[int] | Array, step: Array) -> Array:
    """Coordinates after a displacement along some speeds.

    Parameters
    ----------
    q : (S, nq + 1) array
    speeds : (f,)
        Some or all of a quaternion joint's; if one of them is angular, the quaternion is normalized.
    step : (S, f) array
        rad and m. In quaternion joints: rotation vector and displacement in child components, zero along speeds that are
        not listed.
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
        place, motion = g.slices[k][0], g.kinds[k].motion
        which = speeds[of_body] - g.speeds[k].start
        moved = np.zeros((len(q), len(g.speeds[k])))
        moved[:, which] = step[:, of_body]
        for m in motion:  # displacements first, because the ball joint rotates their axes
            own = speeds_of(m)
            if not np.any((which >= own.start) & (which < own.stop)):
                continue
            if isinstance(m, Displacement):
                behind = g.turned_behind(k, q)
                along = moved[:, own] if behind is None else turn(behind, moved[:, own])
                q[:, place.start + m.coordinate : place.start + m.coordinate + 3] += along
            elif isinstance(m, Ball):
                e = q[:, place.start + m.coordinate : place.start + m.coordinate + 4]
                e[:] = turned_quaternion(e, moved[:, own])
    return q
