"""Prescribed motion in closed loops: both engines, the same mechanism with a free crank, power, time."""

from __future__ import annotations

import warnings
from functools import partial
from pathlib import Path

import made_once
import numpy as np
import pytest
from comparison import error, function_errors, transposes, worst
from prescribed_models import bars, prescribed, with_prescribed_at
from random_mechanisms import Discarded, random_mechanism
from random_models import expression, random_seeds

import codegen
from codegen.loops.errors import PartitionError
from codegen.loops.partition import partition
from codegen.model import ModelError, parse_model
from codegen.reference import DenseEngine, RecursiveEngine

P, T = [0.9, 1.7, 0.4], 0.6


made = partial(made_once.made, target="numpy")


@pytest.mark.parametrize(("frame", "load"), [("ground", False), ("ground", True), ("cart", True)])
def test_a_driven_crank_is_that_of_both_engines(tmp_path: Path, frame: str, load: bool) -> None:
    model = bars(frame, load)
    solver = made(model, tmp_path / "bars", layout="kinds")
    assert solver.prescribed_names == ("crank",)
    rng = np.random.default_rng(2)
    q, u = solver.assemble(solver.initial[0], rng.normal(size=solver.nu), P, t=T)
    state = (q, u, P, None, T)
    seeds = random_seeds(rng, model, 3)
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        found = function_errors(solver, engine, state, seeds)
        assert max(found.values()) < 1e-13, found
    assert max(transposes(solver, state, rng).values()) < 1e-13
    assert np.abs(solver.closure(*state)).max() < 1e-14
    _, _, dq, du = solver.assemble_sensitivities(*state, **seeds)
    expected = engine.complete(*state, **seeds)
    assert worst(dq, expected[1]) < 1e-13
    assert worst(du, expected[2]) < 1e-13


@pytest.mark.parametrize("seed", [1, 4, 6])
def test_random_mechanisms_are_those_of_both_engines(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(np.random.default_rng(seed), bodies=(3, 4), loops=(1, 2))
    assert not isinstance(drawn, Discarded)
    drawn = with_prescribed_at(rng, drawn)
    solver = made(drawn.model, tmp_path / "mechanism", layout=["kinds", "unrolled"][seed % 2])
    seeds = random_seeds(rng, drawn.model, 2)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # of parameters that open redundant conditions; all have the same definition of these
        for engine in (DenseEngine(drawn.model), RecursiveEngine(drawn.model)):
            found = function_errors(solver, engine, drawn[1:], seeds)
            assert max(found.values()) < 1e-10, found


def test_the_driving_torque_is_that_of_the_free_mechanism_with_its_acceleration_imposed(tmp_path: Path) -> None:
    """With the torque as a joint force on a crank that is free, it accelerates as it was prescribed, and so do all others."""
    model = bars("cart", True)
    solver = made(model, tmp_path / "driven")
    q, u = solver.assemble(p=P, t=T)
    torque = solver.driving_forces(q, u, P, t=T)[0]
    at = {"a": P[2], "w": P[1], "t": T}
    angle, rate, acceleration = (float(e.evaluate(at)) for e in model.prescribed[0].values)
    pushed = bars("cart", True, "inputs: [torque]", "torque - 0.3*u.crank")
    engine = DenseEngine(pushed)
    place = pushed.coordinate_names.index("crank")
    whole_q, whole_u = np.insert(q, place, angle), np.insert(u, place, rate)
    udot = engine.accelerations(whole_q, whole_u, P, [torque], T)
    assert error(udot, np.insert(solver.accelerations(q, u, P, t=T), place, acceleration)) < 1e-12


def test_loops_transmit_what_the_dense_method_has_and_more_digits_agree(tmp_path: Path) -> None:
    model = bars("cart", True)
    solver = made(model, tmp_path / "bars", reactions=True)
    q, u = solver.assemble(p=P, t=T)
    state = (q, u, P, None, T)
    assert error(solver.reactions(*state)[1], DenseEngine(model).reactions(*state)) < 1e-13
    more = solver.in_precision(30)
    assert error(solver.driving_forces(*state), more.driving_forces(*state)) < 1e-14
    assert np.abs(more.closure(*more.assemble(*state), P, t=T)[0]).max() < 1e-27


def test_energy_changes_by_the_power_of_all_forces(tmp_path: Path) -> None:
    solver = made(bars("cart", True), tmp_path / "driven")
    model = bars("cart", True)
    rng = np.random.default_rng(3)
    q, u = solver.assemble(solver.initial[0], rng.normal(size=solver.nu), P, t=T)
    udot = solver.accelerations(q, u, P, t=T)
    (_, _), (dT, dV) = solver.energy_sensitivities(q, u, P, t=T, dq=u, du=udot, dt=1.0)
    rate = float(model.prescribed[0].values[1].evaluate({"a": P[2], "w": P[1], "t": T}))
    rocker = u[solver.speed_names.index("rocker")]
    power = solver.driving_forces(q, u, P, t=T)[0] * rate - 0.3 * rate**2 + (-0.3 * rocker + 0.1 * T) * rocker
    assert abs(dT[0] + dV[0] - power) < 1e-12 * (abs(dT[0]) + abs(dV[0]))


def test_a_mechanism_that_is_driven_altogether_follows_its_crank(tmp_path: Path) -> None:
    model = bars()
    solver = made(model, tmp_path / "driven")
    assert solver.independent_names == ()
    q, u = solver.assemble(p=P, t=T)
    h = 1e-6  # a coarse witness of speeds and accelerations that close the loop
    (later, fast), (sooner, slow) = (solver.assemble(q, u, P, t=T + s) for s in (h, -h))
    assert error((later - sooner) / (2 * h), u) < 1e-8
    assert error((fast - slow) / (2 * h), solver.accelerations(q, u, P, t=T)) < 1e-8
    run = solver.simulate([T, T + 0.4], p=P)  # from one time to the next, where one guess for all may lead elsewhere
    end, fast = solver.assemble(run.q[-1], run.u[-1], P, t=T + 0.4)
    assert error(run.q[-1], end) < 1e-12 and error(run.u[-1], fast) < 1e-12


def test_a_motion_has_derivatives_by_what_the_crank_does(tmp_path: Path) -> None:
    codegen.generate(bars("ground", True), tmp_path / "bars", functions="simulate")
    solver = codegen.load(tmp_path / "bars")
    found = solver.simulate([0, 0.7], sensitivities=["a", "length"], rtol=1e-11, atol=1e-11)
    assert found.closure.max() < 1e-13
    for k, name in enumerate(("a", "length")):
        i, h = solver.parameter_names.index(name), 1e-5
        ends = [
            solver.simulate([0, 0.7], p=solver.parameters + s * np.eye(3)[i], rtol=1e-12, atol=1e-12).q[-1]
            for s in (h, -h)
        ]
        assert error(found.dq[k, -1], (ends[0] - ends[1]) / (2 * h)) < 1e-8


def test_more_than_a_loop_leaves_free_cannot_be_prescribed() -> None:
    with pytest.raises(
        PartitionError, match="loop foot: crank, rocker cannot be prescribed together, because the loops"
    ):
        partition(prescribed(bars(motion=""), {"crank": expression("0.3"), "rocker": expression("1.8 + t")}))


SOME = (
    "{arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {yy: 1}}, "
    "ball: {parent: arm, joint: {type: spherical}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}, "
    "hand: {parent: arm, joint: {type: universal, axes: [x, y]}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}}"
)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("motion: {amr: t}", "unknown joint or coordinate 'amr'; allowed are arm, hand, .*did you mean 'arm'"),
        ("motion: {arm: 2*q.arm}", "'q.arm', which changes with the motion, is not allowed here; only numbers, constants, "),
        ("motion: {ball: t}", "the spherical joint 'ball' has a quaternion, which cannot be prescribed; replace the joint"),
        ("motion: {hand: t}", "1 value; joint 'hand' has 2: hand.1, hand.2; give a list of values"),
        ("motion: {arm: log(t)}", r"log\(t\) has no finite value at t = 0, the default parameters"),
        ("motion: {arm: sqrt(t)}", r"sqrt\(t\) has no finite rate at t = 0"),
        ("motion: {hand.1: t, hand: [t, t]}", "coordinate 'hand.1' is already prescribed"),
        ("motion: {arm: t}\ninitial: {q: {arm: 1}}", "coordinate 'arm' is prescribed under `motion`, which sets its initial"),
        ("motion: {arm: t}\nindependent: [arm]", "'arm' is prescribed under `motion`, so it is not a free coordinate"),
        ("outputs: {f: {driving_force: arm}}", "'arm' is not a coordinate with prescribed motion; nothing is prescribed"),
        ("motion: {hand: [t, t]}\noutputs: {f: {driving_force: hand}}", "prescribed are hand.1, hand.2; write one of hand.1"),
        ("motion: [arm]", "a list of 1; a mapping of names is needed"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_motion_is_said(more: str, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        parse_model(f"model: m\nbodies: {SOME}\n{more}\n")
