"""Closing conditions of loop joints: their values for relative motions at the cut, in velocities, accelerations, positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numeric_scope import Numbers
from scipy.spatial.transform import Rotation

from codegen.mechanics import fields
from codegen.mechanics.ears.assembly import face_differences
from codegen.mechanics.ears.closing_accelerations import closing_accelerations
from codegen.mechanics.ears.conditions import Condition, components_along, counted_conditions, joint_conditions
from codegen.mechanics.ears.geometry import EarGeometry
from codegen.mechanics.ears.motions import Twist
from codegen.mechanics.stores import LOOP_CONSTANTS, ROOTS
from codegen.mechanics.structure.kinds import ClosureKind, EarKind
from codegen.model.joints import JOINTS, Closure
from codegen.program.algebra import Number

Array = np.ndarray[Any, Any]
CLOSURES = {name: joint.closure for name, joint in JOINTS.items() if joint.closure}
LENGTH = 2.5
"""Characteristic, m."""


@dataclass
class Jet:
    """A vector or a matrix as a polynomial of time, up to the second power: value, velocity, half the acceleration."""

    c: list[Array]

    def __matmul__(self, other: Jet) -> Jet:
        return Jet(
            [sum((self.c[i] @ other.c[n - i] for i in range(n + 1)), 0 * (self.c[0] @ other.c[0])) for n in range(3)]
        )

    def __add__(self, other: Jet) -> Jet:
        return Jet([a + b for a, b in zip(self.c, other.c, strict=True)])

    @property
    def T(self) -> Jet:
        return Jet([a.T for a in self.c])


def skew(v: Array) -> Array:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def vee(m: Array) -> Array:
    return np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]) / 2


def turning(axis: Array, angle: Array) -> Jet:
    """Rotation about a fixed axis by an angle that is a polynomial of time."""
    a, b, c = angle
    K, R = skew(axis), Rotation.from_rotvec(a * axis).as_matrix()
    return Jet([R, b * K @ R, (c * K + b * b / 2 * K @ K) @ R])


def rates(R: Jet) -> tuple[Array, Array]:
    """Angular velocity and acceleration: ``dR/dt = (omega x) R``."""
    return vee(R.c[1] @ R.c[0].T), vee(2 * R.c[2] @ R.c[0].T)


class Mechanism:
    """A loop joint between the base and a link, at a configuration and with a motion that the joint permits."""

    def __init__(self, name: str, gaps: bool = False, off: Array | None = None, seed: int = 0):
        self.holds: Closure = CLOSURES[name]
        self.rng = rng = np.random.default_rng((seed, *map(ord, name)))
        self.axis, self.end_axis = (0, 1) if self.holds.angular == 1 else (int(rng.integers(3)),) * 2
        F, r_start = Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3)
        e = np.eye(3)
        relative = Jet([np.eye(3), np.zeros((3, 3)), np.zeros((3, 3))])
        turns = {3: [], 2: [self.axis], 1: [0, 1], 0: [0, 1, 2]}[self.holds.angular]
        for i in turns:
            relative = relative @ turning(e[i], rng.normal(size=3))
        slides = {3: [], 2: [self.axis], 1: [(self.axis + 1) % 3, (self.axis + 2) % 3]}[self.holds.linear]
        way = [sum((rng.normal() * e[i] for i in slides), np.zeros(3)) for _ in range(3)]
        if off is not None:  # the end is turned away
            relative = relative @ Jet([Rotation.from_rotvec(off).as_matrix(), np.zeros((3, 3)), np.zeros((3, 3))])
        # of the base: any motion, here at its origin and in its axes
        spin = [turning(axis, [0, *rng.normal(size=2)]) for axis in Rotation.random(random_state=seed + 1).as_matrix()]
        self.R_base = spin[0] @ spin[1] @ spin[2]
        self.x_base = Jet([np.zeros(3), *rng.normal(size=(2, 3))])
        constant = Jet([F, np.zeros((3, 3)), np.zeros((3, 3))])
        self.R_face = constant @ relative  # in the base's axes
        self.x_face = constant @ Jet(way) + Jet([r_start, np.zeros(3), np.zeros(3)])
        W, o = Rotation.random(random_state=seed + 2).as_matrix(), rng.normal(size=3)
        self.r_end, self.F_end, self.o, self.W = W.T @ (self.x_face.c[0] - o), W.T @ self.R_face.c[0], o, W
        self.x = x = Numbers()
        x.store(ROOTS[0 + 1], fields.ear_attitude, W.tolist())
        x.store(ROOTS[1], fields.ear_position, o.tolist())
        for side, (r, axes) in zip("AB", ((r_start, F), (self.r_end, self.F_end)), strict=True):
            x.store(LOOP_CONSTANTS[0], fields.face_place(side), r.tolist())
            x.store(LOOP_CONSTANTS[0], fields.face_axes(side), axes.tolist())
        closure = ClosureKind(
            None, self.holds, self.axis, self.end_axis, ((), ()), (0, 1), (-1, -2), gaps, (),  # type: ignore[arg-type]
            gaps or self.holds.linear < 3,
        )  # fmt: skip
        scale = Number(1 / LENGTH)
        self.kind = EarKind(
            0, [], [], ["frame", "link"], [-1, -1], [True, True], [], [closure], [], [], 1, 1, True, True, scale, scale, True,
        )  # fmt: skip
        self.ear = EarGeometry(x, self.kind)
        self.start_axes, self.end_axes = F, self.R_face.c[0]
        self.free = [(F @ e[i], np.zeros(3)) for i in turns]
        if self.holds.angular == 1:
            self.free[1] = (self.end_axes[:, 1], np.zeros(3))
        self.free += [(np.zeros(3), F @ e[i]) for i in slides]

    def matrix(self, rows: list[Condition]) -> Array:
        """The values of the conditions for the six unit motions at the cut."""
        columns = [components_along(self.ear, rows, [Twist.of(unit)], "v", "test") for unit in np.eye(6).tolist()]
        return np.array(columns, float).T


ALL = [(name, gaps) for name in CLOSURES for gaps in (False, True)]


@pytest.mark.parametrize(("name", "gaps"), ALL)
def test_conditions_see_what_is_held_and_nothing_else(name, gaps):
    at = Mechanism(name, gaps)
    for rows in (counted_conditions(at.ear), joint_conditions(at.ear, 0)):
        E = at.matrix(rows)
        assert len(rows) == sum(at.holds) == np.linalg.matrix_rank(E, tol=1e-3)
        assert len(at.free) == 6 - len(rows)
        for angular, linear in at.free:
            assert np.abs(E @ [*angular, *linear]).max() < 1e-14


@pytest.mark.parametrize(("name", "gaps"), ALL)
def test_linear_conditions_are_divided_by_the_length(name, gaps):
    at = Mechanism(name, gaps)
    for row in [*counted_conditions(at.ear), *joint_conditions(at.ear, 0)]:
        if not row.angular:
            assert np.linalg.norm(np.array(row.n, float)) == pytest.approx(1 / LENGTH)


@pytest.mark.parametrize("name", CLOSURES)
def test_where_faces_may_be_apart_conditions_are_derivatives(name):
    """Sums of weight c . d change by n . w as c turns with the end, at any attitude; at the closed one they are zero."""
    for off in (None, np.array([0.4, -0.7, 0.2])):
        at = Mechanism(name, True, off)
        w = at.rng.normal(size=3)
        for row in counted_conditions(at.ear):
            if row.angular:
                change = sum(float(weight) * np.cross(w, c) @ np.array(d) for weight, c, d in row.turning)
                assert change == pytest.approx(np.dot(row.n, w))
                if off is None:
                    assert sum(float(weight) * np.dot(c, d) for weight, c, d in row.turning) == pytest.approx(
                        0, abs=1e-15
                    )


@pytest.mark.parametrize(("name", "gaps"), ALL)
def test_a_joint_that_moves_along_its_freedoms_stays_closed(name, gaps):
    """Accelerations of the faces on a base that moves anyhow, the joint moving as it may: no condition sees any. Eq. 31."""
    at = Mechanism(name, gaps)
    start, end = at.R_base @ Jet([at.start_axes, *np.zeros((2, 3, 3))]), at.R_base @ at.R_face
    r_start = Jet([np.array(at.x.load(LOOP_CONSTANTS[0], fields.face_place("A"))), *np.zeros((2, 3))])
    faces = [(*rates(R), 2 * (at.R_base @ r + at.x_base).c[2]) for R, r in ((start, r_start), (end, at.x_face))]
    w, _ = rates(at.R_face)
    # of the link's origin, against the base
    relative = Twist(w.tolist(), (at.x_face.c[1] + np.cross(w, at.o - at.x_face.c[0])).tolist())

    def face(c: int, side: int) -> Any:
        return tuple(v.tolist() for v in faces[side])

    rows = counted_conditions(at.ear)
    seen = closing_accelerations(at.x, at.ear, rows, face, [], "b", [Twist.zero(), relative])
    assert np.abs(np.array(seen, float)).max() < 1e-12
    assert max(np.abs(v).max() for v in faces[1]) > 0.1


@pytest.mark.parametrize("name", [n for n, holds in CLOSURES.items() if holds.angular >= 2])
@pytest.mark.parametrize("angle", [1e-9, 0.3, 2.0, 3.1])
def test_open_faces_are_measured_up_to_half_a_turn(name, angle):
    """Turned by t about u, which is across the joint's axis: 2 sin(t/2) u."""
    plain = Mechanism(name)
    across = np.eye(3)[(plain.axis + 1) % 3]
    at = Mechanism(name, off=angle * across)
    [found], [half] = face_differences(at.x, at.ear)
    assert half == 0
    u = plain.end_axes @ across
    assert found.angular == pytest.approx(2 * np.sin(angle / 2) * u, rel=1e-9, abs=1e-15)
    assert found.linear == pytest.approx(
        at.x_face.c[0] - np.array(at.x.load(LOOP_CONSTANTS[0], fields.face_place("A")))
    )
