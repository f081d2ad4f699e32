"""Rotor inertias in trees: generated code against both engines, in more digits, and against their definition."""

from __future__ import annotations

import re
from pathlib import Path

import mpmath
import numpy as np
import pytest
from comparison import compare, error
from prescribed_models import with_prescribed
from random_elements import with_random_elements
from random_models import EVERY, random_seeds, random_state, random_tree
from rotor_models import with_rotors

import codegen
from codegen.model import Model, parse_model
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.runtime import Final

ARM = """
model: geared
gravity: [0, 0, -9.81]
parameters: {J: 0.02, n: 3.0, m: 1.5, h: 0.3}
inputs: [motor]
bodies:
  turn: {parent: ground, joint: {type: revolute, axis: y, armature: J*n**2}, mass: m, com: [0.2, 0.1, -0.5],
         inertia: {xx: 0.1, yy: 0.12, zz: 0.2}}
  nut: {parent: turn, joint: {type: screw, axis: [1, 0.2, h], pitch: 0.2*h, armature: 3*J, at: [0, 0.1, -0.4]}, mass: 1,
        com: [0.1, 0, -0.5], inertia: {xx: 0.1, yy: 0.1, zz: 0.15}}
  sleeve: {parent: nut, joint: {type: cylindrical, axis: z, at: [0.1, 0.2, 0.3], armature: [0.4*m, 0.07]}, mass: 1,
           com: [0.1, 0, -0.5], inertia: {xx: 0.1, yy: 0.1, zz: 0.15, xy: 0.01}}
  ball: {parent: sleeve, joint: {type: spherical, at: [0.1, 0.2, 0.3], armature: J*m}, mass: 1, com: [0.1, 0, -0.5],
         inertia: {xx: 0.1, yy: 0.1, zz: 0.15}}
  table: {parent: nut, joint: {type: planar, normal: z, at: [0.1, 0.2, 0.3], armature: [1.5, 0, 3*J]}, mass: m,
          com: [0.1, 0, -0.5], inertia: {xx: 0.1, yy: 0.1, zz: 0.15}}
  cross: {parent: table, joint: {type: universal, axes: [x, y], at: [0.1, 0, 0.3], armature: [0, J*n]}, mass: m,
          com: [0.1, 0, -0.2], inertia: {xx: 0.1, yy: 0.1, zz: 0.15}}
  rod: {parent: turn, joint: {type: prismatic, axis: [0, 0.6, 0.8], armature: m}, mass: 0.3*m, com: [0.1, 0, 0]}
forces:
  drive: {type: joint, joint: turn, value: motor - 0.1*u.turn}
outputs: {kinetic: kinetic_energy, potential: potential_energy, drift: {momentum: linear, axis: x}}
"""
"""Every joint that may have rotors; that on the ground, one behind it, and the last of a branch."""


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Model, Path]:
    folder = tmp_path_factory.mktemp("arm") / "arm"
    model = parse_model(ARM)
    codegen.generate(model, folder, target="both", compile="all", reactions=True)
    return model, folder


@pytest.mark.parametrize("target", ["numpy", "c"])
def test_every_function_is_that_of_both_engines(arm: tuple[Model, Path], target: str) -> None:
    model, folder = arm
    solver = codegen.load(folder, target)
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        found = compare(model, solver, engine, np.random.default_rng(3), transposed=isinstance(engine, DenseEngine))
        assert max(found.values()) < 1e-12, found
    q, _, p, *_ = random_state(np.random.default_rng(4), model)
    assert error(solver.inverse_mass_matrix(q, p) @ solver.mass_matrix(q, p), np.eye(model.nu)) < 1e-11


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_random_trees_are_those_of_both_engines(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = with_rotors(rng, random_tree(rng, int(rng.integers(2, 6)), EVERY))
    if seed % 2:
        model = with_random_elements(rng, model)
    if seed % 4 > 1:
        model = with_prescribed(rng, model)
    codegen.generate(model, tmp_path / "tree", target="numpy", layout=["kinds", "unrolled"][seed % 3 == 0])
    solver = codegen.load(tmp_path / "tree")
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        found = compare(model, solver, engine, np.random.default_rng(seed), transposed=isinstance(engine, DenseEngine))
        assert max(found.values()) < 1e-11, found


@pytest.mark.campaign
@pytest.mark.parametrize("target", ["numpy", "c"])
def test_campaign(tmp_path: Path, target: str) -> None:
    for seed in range(100, 160):
        rng = np.random.default_rng(seed)
        model = with_rotors(rng, random_tree(rng, int(rng.integers(1, 8)), EVERY))
        model = with_prescribed(rng, model) if seed % 3 == 0 else model
        if not model.nu:
            continue  # prescribed altogether
        codegen.generate(model, tmp_path / f"t{seed}", target=target, compile="all" if target == "c" else False)
        found = compare(model, codegen.load(tmp_path / f"t{seed}"), DenseEngine(model), np.random.default_rng(seed))
        assert max(found.values()) < 1e-11, (seed, found)


def test_it_is_the_diagonal_of_the_mass_matrix_and_half_of_it_the_energy(arm: tuple[Model, Path]) -> None:
    model, folder = arm
    bare = parse_model(_without_armature(ARM))
    codegen.generate(bare, folder.parent / "bare", target="numpy")
    solver, without = codegen.load(folder, "numpy"), codegen.load(folder.parent / "bare")
    q, u, p, *_ = random_state(np.random.default_rng(7), model)
    J, n, m, _ = p
    a = np.array([J * n**2, 3 * J, 0.4 * m, 0.07, J * m, J * m, J * m, 1.5, 0, 3 * J, 0, J * n, m])
    assert error(solver.mass_matrix(q, p) - without.mass_matrix(q, p), np.diag(a)) < 1e-12
    assert solver.energies(q, u, p)[0] - without.energies(q, u, p)[0] == pytest.approx(a @ u**2 / 2, rel=1e-11)
    assert error(solver.outputs(q, u, p)[2], without.outputs(q, u, p)[2]) < 1e-15
    assert error(solver.bias_force(q, u, p), without.bias_force(q, u, p)) < 1e-14
    udot = np.random.default_rng(8).normal(size=model.nu)
    more = solver.inverse_dynamics(q, u, udot, p) - without.inverse_dynamics(q, u, udot, p)
    assert error(more, a * udot) < 1e-12


def _without_armature(text: str) -> str:
    return re.sub(r", armature: (\[[^\]]*\]|[^,}]*)", "", text)


def test_forward_and_inverse_dynamics_meet(arm: tuple[Model, Path]) -> None:
    """M udot is what is left of the forces; the axle transmits what drives it, less what the rotor takes."""
    model, folder = arm
    solver = codegen.load(folder, "c")
    q, u, p, inputs, t = random_state(np.random.default_rng(5), model)
    udot = solver.accelerations(q, u, p, inputs, t)
    missing = solver.inverse_dynamics(q, u, 0 * udot, p, inputs, t)
    assert error(solver.mass_matrix(q, p) @ udot, -missing) < 1e-12
    assert np.abs(solver.inverse_dynamics(q, u, udot, p, inputs, t)).max() < 1e-11
    about_y = solver.reactions(q, u, p, inputs, t)[0][0, 1]
    assert about_y == pytest.approx(inputs[0] - 0.1 * u[0] - p[0] * p[1] ** 2 * udot[0], rel=1e-10)


def test_more_digits_are_those_of_the_generic_engine(arm: tuple[Model, Path]) -> None:
    model, folder = arm
    more = codegen.load(folder, "numpy").in_precision(35, model)
    state = random_state(np.random.default_rng(6), model)
    seeds = random_seeds(np.random.default_rng(7), model, 2)
    seeds = dict(seeds) if isinstance(seeds, dict) else seeds._asdict()
    with mpmath.workdps(40):
        ours = more.sensitivities(*state, **seeds)
        theirs = RecursiveEngine(model, "mpmath").sensitivities(*state, **seeds)
        for x, y in zip(ours, theirs, strict=True):
            apart = max(abs(a - b) for a, b in zip(np.ravel(x), np.ravel(y), strict=True))
            assert apart < mpmath.mpf(10) ** -28 * max(abs(b) for b in np.ravel(y))


def test_a_rotor_far_heavier_than_all_it_drives_costs_no_digits(tmp_path: Path) -> None:
    """1e8 times the inertia of the links: nothing of what is handed on is a difference of large numbers."""
    model = parse_model(ARM.replace("armature: J*n**2", "armature: 1e8*J").replace("armature: 3*J,", "armature: 1e8,"))
    codegen.generate(model, tmp_path / "heavy", target="numpy")
    solver = codegen.load(tmp_path / "heavy")
    state = random_state(np.random.default_rng(9), model)
    seeds = random_seeds(np.random.default_rng(10), model, 2)
    seeds = dict(seeds) if isinstance(seeds, dict) else seeds._asdict()
    with mpmath.workdps(40):
        exact = RecursiveEngine(model, "mpmath").sensitivities(*state, **seeds)
    for x, y in zip(solver.sensitivities(*state, **seeds), exact, strict=True):
        assert error(x, np.array(y, dtype=float)) < 1e-13


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    """The solver of the arm without its drive, compiled."""
    folder = tmp_path_factory.mktemp("free") / "free"
    text = ARM[: ARM.index("forces:")] + ARM[ARM.index("outputs:") :]
    codegen.generate(parse_model(text), folder, target="c", compile="all")
    return codegen.load(folder)


@pytest.mark.parametrize(("method", "tolerance"), [("dop853", 1e-11), ("radau", 1e-9)])
def test_a_motion_keeps_its_energy_and_has_one_gradient(free: codegen.Solver, method: str, tolerance: float) -> None:
    q, u = free.initial
    run = free.simulate([0.0, 0.2, 0.4], q=q, u=u + 0.3, method=method, rtol=tolerance, atol=tolerance)
    assert np.ptp(run.outputs[:, 0] + run.outputs[:, 1]) < 1e-7 * np.abs(run.outputs).max()
    forward, back = (
        free.judge(0.2, Final("kinetic"), wrt=free.parameter_names, method=way, integrator=method, rtol=1e-9, atol=1e-9)
        for way in ("forward", "adjoint")
    )
    assert np.abs(forward.gradients).max() > 0.1
    assert back.gradients == pytest.approx(forward.gradients, rel=1e-9, abs=1e-9)


PENDULUM = """
model: geared_pendulum
gravity: [0, 0, -9.81]
parameters: {J: 0.004, n: 5, m: 1.2, l: 0.7}
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y ARMATURE}, mass: m, com: [0, 0, -l]}
"""


def test_a_geared_pendulum_in_closed_form(tmp_path: Path) -> None:
    """udot = -m g l sin q / (m l^2 + J n^2), and its derivatives."""
    codegen.generate(parse_model(PENDULUM.replace("ARMATURE", ", armature: J*n**2")), tmp_path / "p", target="numpy")
    solver = codegen.load(tmp_path / "p")
    (J, n, m, l), q = (0.004, 5, 1.2, 0.7), 0.6
    inertia = m * l**2 + J * n**2
    udot = -m * 9.81 * l * np.sin(q) / inertia
    found, by = solver.sensitivities([q], [0.3], dp=np.eye(4))
    assert found[0] == pytest.approx(udot, rel=1e-14)
    right = [-udot * n**2 / inertia, -udot * 2 * n * J / inertia, udot / m - udot * l**2 / inertia,
             udot / l - udot * 2 * m * l / inertia]  # fmt: skip
    assert by[:, 0] == pytest.approx(right, rel=1e-12)


def test_a_body_without_mass_may_turn_with_a_rotor(tmp_path: Path) -> None:
    """A flywheel on a motor: only its rotor resists."""
    text = "model: wheel\nparameters: {a: 0.3}\ninputs: [tau]\nbodies:\n  w: {parent: ground, joint: {type: revolute, axis: z,"
    text += " armature: a}}\nforces: {drive: {type: joint, joint: w, value: tau}}\n"
    model = parse_model(text)
    codegen.generate(model, tmp_path / "wheel", target="numpy")
    udot, by = codegen.load(tmp_path / "wheel").sensitivities([0.1], [0.2], None, [1.5], dp=[[1.0]])
    assert (udot[0], by[0, 0]) == (pytest.approx(5.0, rel=1e-15), pytest.approx(-1.5 / 0.09, rel=1e-14))
    assert DenseEngine(model).accelerations([0.1], [0.2], None, [1.5])[0] == pytest.approx(5.0, rel=1e-15)


def test_what_has_no_rotor_has_no_trace_of_one(tmp_path: Path) -> None:
    """The number zero is as if nothing was written, to the last byte."""
    written = []
    for name, armature in (("none", ""), ("zero", ", armature: 0"), ("some", ", armature: J")):
        codegen.generate(
            parse_model(PENDULUM.replace("ARMATURE", armature)), tmp_path / name, target="both", compile=False
        )
        files = {f.name: f.read_bytes() for f in (tmp_path / name).iterdir() if f.suffix in (".c", ".h", ".py")}
        written.append(files)
    assert written[0] == written[1]
    found = [
        [b"armature" in text or b"rotor" in text for name, text in w.items() if "pendulum" in name] for w in written
    ]
    assert (any(found[0]), any(found[2])) == (False, True)


def test_of_a_ball_all_three_speeds_resist_alike() -> None:
    model = parse_model(ARM)
    ball = next(b for b in model.bodies if b.name == "ball")
    assert len(ball.joint.armature) == 3
    assert len(set(map(id, ball.joint.armature))) == 1
