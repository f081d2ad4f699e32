"""Residuals of loops and the closure matrix, against each other and against kinematics derived by hand."""

import sys

import numpy as np
import pytest
from loop_closure import body_twists, closure, closure_matrix
from loops.mechanisms import (
    GROUND,
    ORIGIN,
    RandomMechanism,
    X,
    Y,
    Z,
    body,
    floats,
    four_bar,
    jacobian,
    ladder,
    loop,
    model,
    rotation_matrix,
    stewart,
)
from random_mechanisms import LOOP_JOINTS

from codegen.loops import initial_configuration
from codegen.loops.closure import body_frames
from codegen.loops.geometry import Geometry, advance, padded
from codegen.model.model import CLOSURE_ROWS

PARALLEL = ("revolute", "cylindrical", "planar")
UNTURNED = ("fixed", "prismatic")


def mechanisms(count=40):
    """Random mechanisms with closed configurations; together they contain every loop joint."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        types = [RandomMechanism.LOOPS[(seed + i) % 7] for i in range(1 + seed % 3)]
        yield rng, RandomMechanism(rng, int(rng.integers(4, 9)), types)


def by_hand(made, q):
    """Rotations and origins of all bodies, computed one after the other."""
    R, o = {GROUND: np.eye(3)}, {GROUND: np.zeros(3)}
    for k, (b, (place, _)) in enumerate(zip(made.bodies, made.coordinate_slices, strict=True)):
        x, d = q[place], np.zeros(3)
        axes = [np.array([e.value for e in a], dtype=float) for a in b.joint.axes]
        axes = [a / np.linalg.norm(a) for a in axes]
        turn = np.eye(3)
        if b.joint.type == "revolute":
            turn = rotation_matrix(axes[0] * x[0])
        elif b.joint.type == "prismatic":
            d = axes[0] * x[0]
        elif b.joint.type == "universal":
            turn = rotation_matrix(axes[0] * x[0]) @ rotation_matrix(axes[1] * x[1])
        elif b.joint.type in ("spherical", "free"):
            w, *v = x[-4:] / np.linalg.norm(x[-4:])
            angle = 2 * np.arctan2(np.linalg.norm(v), w)
            turn = rotation_matrix(np.array(v) / np.linalg.norm(v) * angle)
            d = x[:3] if b.joint.type == "free" else d
        fixed = np.eye(3)
        for axis, angle in b.joint.rotation:
            a = np.array([e.value for e in axis], dtype=float)
            fixed = fixed @ rotation_matrix(a / np.linalg.norm(a) * angle.value)
        at = np.array([e.value for e in b.joint.at], dtype=float)
        R[k] = R[b.parent] @ fixed @ turn
        o[k] = o[b.parent] + R[b.parent] @ (at + fixed @ d)
    return R, o


def test_frames_of_all_bodies_are_those_found_one_after_the_other():
    for _, mechanism in mechanisms():
        made, q = mechanism.model, mechanism.q
        R, o = body_frames(Geometry(made), padded(q))
        hand_R, hand_o = by_hand(made, q)
        for k in range(len(made.bodies)):
            assert np.abs(R[0, k] - hand_R[k]).max() < 1e-13
            assert np.abs(o[0, k] - hand_o[k]).max() < 1e-13


def test_many_configurations_at_once_are_each_on_its_own():
    made = stewart()
    q = np.random.default_rng(5).normal(size=(3, made.nq))
    together = body_frames(Geometry(made), padded(q))
    for s in range(3):
        alone = body_frames(Geometry(made), padded(q[s]))
        assert all(np.array_equal(x[s], y[0]) for x, y in zip(together, alone, strict=True))


def test_twists_of_all_bodies_are_derivatives_of_their_frames():
    for rng, mechanism in mechanisms(10):
        geometry, q = Geometry(mechanism.model), padded(mechanism.q)
        u, h = rng.normal(size=(1, geometry.nu)), 1e-6
        speeds = np.arange(geometry.nu)
        frames = body_frames(geometry, q)
        w, v = body_twists(geometry, q, frames, u[:, :, None])
        (R1, o1), (R0, o0) = (body_frames(geometry, advance(geometry, q, speeds, s * h * u)) for s in (1, -1))
        assert np.abs((o1 - o0) / (2 * h) - v[..., 0]).max() < 1e-7
        spin = (R1 - R0) @ np.swapaxes(frames[0], -1, -2) / (2 * h)
        assert np.abs(spin[..., [2, 0, 1], [1, 2, 0]] - w[..., 0]).max() < 1e-7


def test_a_mechanism_made_to_close_has_no_residual():
    for _, mechanism in mechanisms():
        position, _ = closure(mechanism.model, mechanism.q, np.zeros(mechanism.model.nu))
        assert len(position) == len(mechanism.model.closure_names)
        assert np.abs(position).max() < 1e-11


def test_the_velocity_residual_is_the_closure_matrix_times_the_speeds_closed_or_open():
    for rng, mechanism in mechanisms():
        made = mechanism.model
        for q in (mechanism.q, mechanism.q + 0.3 * rng.normal(size=made.nq)):
            u = rng.normal(size=made.nu)
            velocity = closure(made, q, u)[1]
            assert np.abs(velocity - jacobian(made, q) @ u).max() < 1e-12


@pytest.mark.parametrize("type", LOOP_JOINTS)
def test_the_closure_matrix_is_the_derivative_of_the_position_residual(type):
    for seed in range(6):
        rng = np.random.default_rng(seed)
        mechanism = RandomMechanism(rng, 6, [type])
        made, geometry, h = mechanism.model, Geometry(mechanism.model), 1e-6
        J, speeds = jacobian(made, mechanism.q), np.arange(made.nu)
        for s in speeds:
            step = h * np.eye(made.nu)[[s]]
            ends = [advance(geometry, padded(mechanism.q), speeds, sign * step)[0, :-1] for sign in (1, -1)]
            plus, minus = (closure(made, q, np.zeros(made.nu))[0] for q in ends)
            assert np.abs((plus - minus) / (2 * h) - J[:, s]).max() < 1e-8


def test_columns_run_outward_from_the_start_side_then_outward_on_the_end_side():
    bodies = [
        body(name, parent, "revolute", Y, at=(1, 0, 0)) for name, parent in zip("abcde", (-1, 0, 1, 0, 3), strict=True)
    ]
    made = model(bodies, [loop("x", "spherical", (4, ORIGIN), (2, ORIGIN))])
    speeds, E = closure_matrix(made, 0, np.zeros(5))
    assert [made.speed_names[s] for s in speeds] == ["d", "e", "b", "c"]
    assert E.shape == (3, 4)


@pytest.mark.parametrize("type", PARALLEL + UNTURNED)
def test_half_a_turn_is_no_closure_and_the_residual_grows_up_to_there(type):
    axis = np.array((0.3, -0.5, 0.8)) / np.linalg.norm((0.3, -0.5, 0.8))
    across = np.cross(axis, (1.0, 0, 0)) / np.linalg.norm(np.cross(axis, (1.0, 0, 0)))
    turns = {"parallel": [across], "unturned": [axis, across, np.array((1.0, 0, 0))]}
    axes = [floats(axis)] if CLOSURE_ROWS[type] != (3, 3) else []
    for turn in turns["parallel" if type in PARALLEL else "unturned"]:
        made = model(
            [body("arm", GROUND, "revolute", floats(turn))], [loop("x", type, (0, ORIGIN), (GROUND, ORIGIN), *axes)]
        )
        for angle in (0.0, 1e-8, 0.4, 1.5, 2.6, 3.0, np.pi - 1e-7, np.pi):
            residual = closure(made, [angle], [0.0])[0]
            assert np.linalg.norm(residual) == pytest.approx(2 * np.sin(angle / 2), abs=1e-9)


def test_a_revolute_joint_may_turn_and_a_cylindrical_one_slide_and_a_planar_one_do_both():
    for type, axis, free in (("revolute", Z, "r"), ("cylindrical", Z, "rp"), ("planar", Z, "r"), ("prismatic", Z, "p")):
        bodies = [body("turn", GROUND, "revolute", Z), body("slide", 0, "prismatic", Z)]
        made = model(bodies, [loop("x", type, (1, ORIGIN), (GROUND, ORIGIN), axis)])
        for q, kind in (((0.7, 0), "r"), ((0, 0.7), "p")):
            assert (np.abs(closure(made, q, (0, 0))[0]).max() < 1e-15) == (kind in free), (type, kind)


def test_a_universal_joint_is_closed_where_its_axes_are_perpendicular():
    made = model([body("arm", GROUND, "revolute", Z)], [loop("x", "universal", (0, ORIGIN), (GROUND, ORIGIN), X, Y)])
    for angle in (0.0, 0.3, np.pi):
        assert closure(made, [angle], [0.0])[0][3] == pytest.approx(np.sin(angle), abs=1e-15)


def test_linear_conditions_are_divided_by_the_characteristic_length():
    made = four_bar()
    q, u = np.array([1.0, -0.7, -1.2]), np.array([0.3, 0.4, 0.5])
    assert Geometry(made).lengths[0] == 2.0  # the mean of 1, 2, 1.5 and 2.2 m, to a power of two
    for one, two in zip(closure(made, q, u), closure(made, q, u, lengths=[16.0]), strict=True):
        assert np.allclose(one[:3], 8 * two[:3], rtol=1e-15, atol=0)
        assert np.array_equal(one[3:], two[3:])
    assert np.allclose(closure_matrix(made, 0, q)[1][:3], 8 * closure_matrix(made, 0, q, length=16.0)[1][:3])


def test_ten_times_as_many_loops_are_evaluated_in_ten_times_as_many_calls():
    calls = {}
    for loops in (100, 1000):
        made = ladder(loops)
        q, u = initial_configuration(made)
        count = 0

        def counted(_frame, event, _argument):
            nonlocal count
            count += event == "call"

        sys.setprofile(counted)
        try:
            position, _ = closure(made, q, u)
        finally:
            sys.setprofile(None)
        calls[loops] = count
        assert np.abs(position).max() < 1e-12
    assert calls[100] > 100 and calls[1000] < 10.5 * calls[100]
