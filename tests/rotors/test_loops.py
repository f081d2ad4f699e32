"""Rotor inertias in mechanisms: dependent, independent, coupled and prescribed joints, long branches, reactions."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import error, function_errors, transposes
from coupled_mechanisms import by_hand
from coupled_models import MODELS
from emit.test_random_mechanisms import check, draw
from prescribed_models import bars, with_prescribed_at
from random_elements import with_random_elements
from random_models import random_seeds
from rotor_models import with_rotors, with_rotors_at

import codegen
from codegen.model import Model, parse_model
from codegen.reference import DenseEngine, RecursiveEngine


def errors(solver: codegen.Solver, model: Model, state: tuple[Any, ...], seeds: Any) -> dict[str, float]:
    """Errors of every function against both engines, and of the transposes."""
    found = transposes(solver, state, np.random.default_rng(0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of parameters that open redundant conditions
        for engine in (DenseEngine(model), RecursiveEngine(model)):
            of_engine = function_errors(solver, engine, state, seeds)
            found |= {f"{type(engine).__name__}.{name}": x for name, x in of_engine.items()}
    return found


@pytest.mark.parametrize("seed", [0, 3])
def test_random_mechanisms_are_those_of_both_engines(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    drawn = draw(seed, bodies=(3, 5), loops=(1, 2))
    assert drawn is not None
    drawn = with_rotors_at(rng, drawn)
    if seed % 2:
        drawn = drawn._replace(model=with_random_elements(rng, drawn.model))
    codegen.generate(drawn.model, tmp_path / "m", target="numpy", layout=["kinds", "unrolled"][seed % 2])
    check(drawn, codegen.load(tmp_path / "m"), seed)


@pytest.mark.campaign
@pytest.mark.parametrize("target", ["numpy", "c"])
def test_campaign(tmp_path: Path, target: str) -> None:
    for seed in range(100, 140):
        drawn = draw(seed, bodies=(3, 8), loops=(1, 3))
        if drawn is not None:
            drawn = with_rotors_at(np.random.default_rng(seed), drawn)
            codegen.generate(drawn.model, tmp_path / f"m{seed}", target, compile="all" if target == "c" else False)
            check(drawn, codegen.load(tmp_path / f"m{seed}"), seed)


@pytest.mark.parametrize("name", ["tips_joined", pytest.param("rails", marks=pytest.mark.campaign)])
def test_long_branches_are_coupled_through_rotors(tmp_path: Path, name: str) -> None:
    drawn = with_rotors_at(np.random.default_rng(3), by_hand(name), 1.0)
    codegen.generate(drawn.model, tmp_path / "m", target="numpy")
    check(drawn, codegen.load(tmp_path / "m"), 1)


@pytest.mark.parametrize(("frame", "load"), [("ground", False), ("cart", True)])
def test_a_driven_crank_and_its_rotor(tmp_path: Path, frame: str, load: bool) -> None:
    model = with_rotors(np.random.default_rng(1), bars(frame, load), 1.0)
    codegen.generate(model, tmp_path / "bars", target="c", compile="all")
    solver, rng, p, t = codegen.load(tmp_path / "bars"), np.random.default_rng(2), [0.9, 1.7, 0.4], 0.6
    q, u = solver.assemble(solver.initial[0], rng.normal(size=solver.nu), p, t=t)
    found = errors(solver, model, (q, u, p, None, t), random_seeds(rng, model, 3))
    assert max(found.values()) < 1e-12, found


@pytest.mark.parametrize("seed", [4])
def test_prescribed_joints_of_random_mechanisms(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    drawn = draw(seed, bodies=(3, 4), loops=(1, 2))
    assert drawn is not None
    drawn = with_prescribed_at(rng, with_rotors_at(rng, drawn, 1.0))
    codegen.generate(drawn.model, tmp_path / "m", target="numpy")
    found = errors(codegen.load(tmp_path / "m"), drawn.model, drawn[1:], random_seeds(rng, drawn.model, 2))
    assert max(found.values()) < 1e-10, found


@pytest.mark.parametrize("name", ["differential", "geared five-bar on a cart"])
def test_coupled_joints(tmp_path: Path, name: str) -> None:
    model = with_rotors(np.random.default_rng(4), parse_model(MODELS[name]), 1.0)
    codegen.generate(model, tmp_path / "m", target="numpy")
    solver, rng = codegen.load(tmp_path / "m"), np.random.default_rng(3)
    q, u = solver.initial
    q, u = solver.assemble(q + 0.1 * rng.normal(size=solver.nq), rng.normal(size=solver.nu), t=0.6)
    found = errors(solver, model, (q, u, None, rng.normal(size=solver.ninputs), 0.6), random_seeds(rng, model, 2))
    assert max(found.values()) < 1e-10, found


GEARED = """
model: geared
gravity: [0, 0, -9.81]
parameters: {J: 0.002, n: 6, I: 0.3}
bodies:
  ROTOR
  wheel: {parent: ground, joint: {type: revolute, axis: y ARMATURE}, mass: 2, com: [0.2, 0, 0], inertia: {yy: I}}
COUPLING
"""


def test_a_rotor_on_the_ground_is_a_body_behind_a_gear(tmp_path: Path) -> None:
    """On the ground nothing is left out: the same motion as with the rotor as a body, and the same derivatives."""
    rotor = "motor: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {yy: J}}"
    texts = [
        GEARED.replace("ROTOR", "").replace("ARMATURE", ", armature: J*n**2").replace("COUPLING", ""),
        GEARED.replace("ROTOR", rotor).replace("ARMATURE", "").replace(
            "COUPLING", "couplings: {gear: {joint: motor, follows: {wheel: n}}}"
        ),
    ]  # fmt: skip
    found = []
    for i, text in enumerate(texts):
        codegen.generate(parse_model(text), tmp_path / f"m{i}", target="numpy")
        solver = codegen.load(tmp_path / f"m{i}")
        q, u = solver.assemble([0.3, 0.3][: solver.nq], [1.1, 1.1][: solver.nu]) if i else ([0.3], [1.1])
        j = solver.speed_names.index("wheel")
        udot, by = solver.sensitivities(q, u, dp=np.eye(3))
        found.append([udot[j], *by[:, j], *solver.energies(q, u)])
    assert found[0][:4] == pytest.approx(found[1][:4], rel=1e-13)
    assert found[0][4] == pytest.approx(found[1][4], rel=1e-14)


def test_what_loops_transmit_and_the_mass_on_independent_speeds(tmp_path: Path) -> None:
    model = with_rotors(np.random.default_rng(5), bars("cart", True, "", "-0.3*u.crank"), 1.0)
    codegen.generate(model, tmp_path / "bars", target="numpy", reactions=True)
    solver, rng = codegen.load(tmp_path / "bars"), np.random.default_rng(6)
    q, u = solver.assemble(solver.initial[0], rng.normal(size=solver.nu))
    assert error(solver.reactions(q, u)[1], DenseEngine(model).reactions(q, u)) < 1e-12
    free = [solver.speed_names.index(n) for n in solver.independent_speed_names]
    units = np.zeros((len(free), solver.nu))
    units[range(len(free)), free] = 1.0
    Y = np.stack([solver.assemble(q, x)[1] for x in units], axis=1)
    M = Y.T @ DenseEngine(model).mass_matrix(q) @ Y
    assert error(solver.mass_matrix(q), M) < 1e-13
    udot = solver.accelerations(q, u)
    assert error(M @ udot[free], -solver.bias_force(q, u)) < 1e-12


def test_a_mechanism_keeps_its_energy(tmp_path: Path) -> None:
    model = with_rotors(np.random.default_rng(5), bars("ground", False, "", "0"), 1.0)
    model = dataclasses.replace(model, forces=())
    codegen.generate(model, tmp_path / "bars", target="c", compile="all")
    solver = codegen.load(tmp_path / "bars")
    q, u = solver.assemble(solver.initial[0], [0.5] * solver.nu)
    run = solver.simulate(0.5, q=q, u=u, rtol=1e-11, atol=1e-11)
    energy = run.outputs[:, 0] + run.outputs[:, 1]
    assert np.ptp(run.outputs[:, 0]) > 0.1
    assert np.ptp(energy) < 1e-8 * np.abs(run.outputs).max()
