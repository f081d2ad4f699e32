"""Rings of joints that close loops. Poses are relative to known bodies; damped Newton steps close the rings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ..model.vectors import Array, turn
from ..records import dataclass
from .closure import Cuts
from .geometry import Joints, advance
from .paths import PoseGroups

ROUNDING = 5e-16
"""Residual below which Newton's method ends, per unit of the distance from the base in characteristic lengths."""

CLOSED = 1e-10
"""Largest residual of a closed ring, per unit of distance from the base; it exceeds rounding errors."""

SETTLED = 1e-3
"""Relative change of the residual below which the iteration ends."""

MAX_STEPS = 60

PATIENCE = 6
"""Number of steps within which the residual must decrease by a third."""

LARGEST_STEP = 0.7
"""Largest step, rad or characteristic lengths; a linearisation is not valid far beyond half a radian."""

LEAST_STEP = 1e-5
"""Length of a step below which the iteration fails."""

LEAST_PIVOT = 1e-9
"""Fraction of the largest singular value of the closure matrix below which a singular value counts as zero."""


class Ring:
    """The unknown joints of some loops, with all known joints in between rigid: closes the loops numerically.

    Parameters
    ----------
    groups : PoseGroups
    loops : sequence of int
    bodies : iterable of int
        Bodies whose joints move.

    Attributes
    ----------
    joints : Joints
        The moving joints, outward.
    length : float
        The largest characteristic length of the loops, m.
    """

    def __init__(self, groups: PoseGroups, loops: Sequence[int], bodies: Iterable[int]) -> None:
        g = groups.geometry
        self.geometry = g
        self.joints = Joints(g, sorted(bodies, key=lambda k: (g.depth[k], k)))
        self.cuts = Cuts(g, loops)
        self.length = float(np.max(g.lengths[self.cuts.loops]))
        place = {k: i for i, k in enumerate(self.joints.bodies)}
        fixed = len(place)  # index for bodies that no moving joint carries
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
        """The moving joint that carries a body, the body's frame relative to that joint's body, and the innermost body
        of its group."""
        base = groups.find(body)
        if body == base:
            R, o = np.broadcast_to(np.eye(3), groups.R[body].shape), np.zeros_like(groups.o[body])
        else:
            R, o = groups.R[body], groups.o[body]
        return place.get(base, len(place)), R, o, base

    def evaluate(self, q: Array) -> tuple[Array, Array]:
        """Position residuals ``(S, rows)``, and closure matrix ``(S, rows, f)`` of the moving joints' speeds."""
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
        residual = self.cuts.place((faces[0], faces[1], faces[2], faces[3]), q)
        w, v = joints.screws(q)
        C = R[:, joints.place]
        w = turn(C, w)
        at_cut = self.cuts.at_cut(w, turn(C, v), o[:, joints.place])
        E = self.cuts.matrix(w, at_cut, self.sign[:, joints.place], joints.speeds)
        return self.cuts.kept(residual), E

    def reach(self) -> float:
        """Distance of the cuts from the base in characteristic lengths, to which rounding errors are proportional."""
        lengths = self.geometry.lengths[self.cuts.loops]
        return float(np.max(np.linalg.norm(self.cuts.point, axis=-1) / lengths))


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of closing a ring.

    Attributes
    ----------
    q : (1, nq + 1) array
    rows : (rows,) array
        Scaled position residuals.
    closed : bool
    settled : bool
        Whether no joint of the ring, movable or not, can reduce the residual further: what remains is in nearly
        redundant conditions.
    """

    q: Array
    rows: Array
    closed: bool
    settled: bool = False

    @property
    def residual(self) -> float:
        """The largest scaled residual of the ring."""
        return float(np.max(np.abs(self.rows), initial=0.0))


def is_closed_as_given(ring: Ring, q: Array) -> bool:
    """Whether a ring is closed to rounding at the given coordinates, so that `close` need not change them."""
    rows, _ = ring.evaluate(q)
    return float(np.linalg.norm(rows)) <= ROUNDING * (1 + ring.reach())


def close(ring: Ring, q: Array, movable: Array, pivot: float = LEAST_PIVOT) -> Outcome:
    """Close the loops of a ring by minimum-norm least-squares Newton steps within a trust region.

    A step beyond the range of the linearisation is not shortened but damped (Levenberg-Marquardt). Near a singular pose the
    regular joints then continue to move, and only the singular one is held back. Angles count in rad, displacements in
    characteristic lengths.

    Parameters
    ----------
    q : (1, nq + 1) array
        Guess.
    movable : (f,) array of bool
        Which speeds of the ring's joints may be nonzero.
    pivot : float
        Singular values of the closure matrix below this fraction of the largest count as zero.
    """
    g, speeds = ring.geometry, ring.joints.speeds[movable]
    scale = np.where(g.turning[speeds], 1.0, ring.length)
    rows, E = ring.evaluate(q)
    norm = float(np.linalg.norm(rows))
    unit = 1 + ring.reach()
    radius, progress = LARGEST_STEP, norm
    for count in range(MAX_STEPS if len(speeds) else 0):
        if norm <= ROUNDING * unit or radius < LEAST_STEP:
            break
        if count % PATIENCE == PATIENCE - 1:
            if norm > 0.7 * progress:
                break
            progress = norm
        scaled = E[0][:, movable] * scale
        y = _step(scaled, rows[0], radius, pivot)
        q_new = advance(g, q, speeds, (scale * y)[None])
        rows_new, E_new = ring.evaluate(q_new)
        norm_new = float(np.linalg.norm(rows_new))
        expected = norm - float(np.linalg.norm(rows[0] + scaled @ y))
        rounding = norm < CLOSED * unit and norm_new > 0.5 * norm
        if norm_new < norm:
            gain = norm - norm_new
            q, rows, E, norm = q_new, rows_new, E_new, norm_new
        else:
            gain = 0.0
        if rounding:
            break
        if gain < 0.25 * expected:
            radius = float(np.abs(y).max()) / 3
        elif gain > 0.7 * expected:
            radius = min(2 * radius, LARGEST_STEP)
    settled = pivot > LEAST_PIVOT and _is_settled(ring, rows[0], E[0], pivot)
    return Outcome(q, rows[0], bool(np.abs(rows).max(initial=0.0) < CLOSED * unit), settled)


def is_settled(ring: Ring, q: Array, pivot: float) -> bool:
    """Whether no joint of a ring can reduce the residual further at coordinates ``(1, nq + 1)``; `pivot` as for `close`."""
    rows, E = ring.evaluate(q)
    return _is_settled(ring, rows[0], E[0], pivot)


def _is_settled(ring: Ring, rows: Array, E: Array, pivot: float) -> bool:
    if not E.shape[1]:
        return True
    scale = np.where(ring.geometry.turning[ring.joints.speeds], 1.0, ring.length)
    y = _step(E * scale, rows, LARGEST_STEP, pivot)
    allowed = max(SETTLED * float(np.linalg.norm(rows)), CLOSED * (1 + ring.reach()))
    return bool(np.abs(y).max(initial=0.0) < allowed)


def _step(E: Array, rows: Array, radius: float, pivot: float) -> Array:
    """The step ``(f,)``, damped until no component exceeds the radius."""
    U, s, Vt = np.linalg.svd(E, full_matrices=False)
    k = int(np.sum(s > pivot * max(s[0], 1e-300)))
    s, against = s[:k], U[:, :k].T @ rows
    step: Array = np.zeros(E.shape[1])
    damping = 0.0
    while k:
        step = -Vt[:k].T @ (s / (s * s + damping) * against)
        if np.abs(step).max() <= radius:
            break
        damping = 4 * damping or (0.03 * s[-1]) ** 2
    return step
