"""Products with the Hessian of weighted accelerations of models with loops: against differences of gradients in 40 digits.

Differences move all coordinates and speeds along complete seeds.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from coupled_coordinates import coupled_tree
from coupled_mechanisms import platform, rails, tips_joined
from point_condition_models import SPATIAL
from prescribed_models import with_prescribed_at
from random_mechanisms import random_mechanisms
from random_models import EVERY, RandomState, random_seeds
from rotor_models import with_rotors_at
from second_derivatives import EXAMPLES, FUNCTIONS, differences, hessian, kept_as_given, made

import codegen
from codegen.model import Model, parse_model


def state_of(solver: codegen.Solver, seed: int = 1) -> tuple[RandomState, np.ndarray]:
    """A consistent state near the initial values, and weights."""
    rng = np.random.default_rng(seed)
    q, u = solver.initial
    q, u = solver.assemble(q, u + 0.7 * rng.normal(size=u.shape))
    inputs = rng.normal(size=len(solver.input_names))
    return RandomState(q, u, np.asarray(solver.parameters), inputs, 0.0), rng.normal(size=u.size)


def agree(model: Any, folder: Path, limit: float, state: Any = None, weights: Any = None, skew: float = 1e-13) -> None:
    """Check every entry, and the symmetry of coordinates that can be chosen independently of each other."""
    solver = made(model, folder, functions=f"{FUNCTIONS},assemble_sensitivities")
    if state is None:
        state, weights = state_of(solver)
    H, reference = hessian(solver, state, weights), differences(solver, state, weights)
    largest = np.abs(reference).max()
    assert largest > 0
    assert np.abs(H - reference).max() < limit * largest
    *_, dq, _ = solver.assemble_sensitivities(*state, dq=np.eye(state.q.size))
    apart = kept_as_given(solver, dq) == [n in solver.independent_names for n in solver.coordinate_names]
    assert np.abs(H - H.T).max() < skew * largest or not apart


@pytest.mark.parametrize(
    "name", ["four_bar", "slider_crank", "screw_jack", "bricard", "hooke_ladder", "valve_train", "coupler"]
)
def test_examples_agree_with_differences_in_40_digits(name: str, tmp_path: Path) -> None:
    """A coupling, a point on a curve, sliding and universal joints, redundant conditions."""
    agree(EXAMPLES / f"{name}.yaml", tmp_path, 1e-11)


def test_forces_on_bodies_that_read_dependent_joints_agree(tmp_path: Path) -> None:
    """Their change by dependent speeds and coordinates belongs to the change of the loop."""
    text = (EXAMPLES / "four_bar.yaml").read_text(encoding="utf-8")
    forces = """forces:
  wind: {type: force, on: coupler, value: [-2*u.rocker, 0, q.rocker*u.crank]}
  brake: {type: joint, joint: coupler, value: -0.3*u.rocker*q.coupler}
"""
    model = parse_model(text.replace("forces:\n", forces, 1))
    agree(model, tmp_path / "all", 1e-11)
    solvers = [made(model, tmp_path / target, target) for target in ("c", "numpy")]
    state, weights = state_of(codegen.load(tmp_path / "all" / "package"))
    c, in_numpy = (hessian(solver, state, weights) for solver in solvers)
    assert np.abs(c - in_numpy).max() < 1e-13 * np.abs(c).max()


@pytest.mark.parametrize(
    "rods", [tips_joined(3, base="free"), platform(2), rails(1)], ids=["tips", "platform", "rails"]
)
def test_loops_that_couple_branches_agree(rods: Any, tmp_path: Path) -> None:
    """Links far apart are coupled: bases that move, several far links."""
    agree(rods.model(), tmp_path, 1e-10)


def a_mechanism(
    seed: int, more: Any = lambda rng, drawn: drawn, **options: Any
) -> tuple[Model, RandomState, np.ndarray]:
    """A random mechanism, a state with quaternions of unit length, and weights."""
    _, drawn = next(random_mechanisms(1, seed, **options))
    model, q, u, p, inputs, t = more(np.random.default_rng([9, seed]), drawn)
    q = q.copy()
    for body, (rows, _) in zip(model.bodies, model.coordinate_slices, strict=True):
        for place in body.joint.kind.quaternions:
            q[rows][place] /= np.linalg.norm(q[rows][place])
    rng = np.random.default_rng([34, seed])
    return model, RandomState(q, u, p, inputs, t), rng.normal(size=model.nu)


@pytest.mark.parametrize("seed", range(0, 100, 25))
@pytest.mark.parametrize("scene", ["spatial", "planar", "spherical"])
def test_random_mechanisms_agree_with_differences_in_40_digits(scene: str, seed: int, tmp_path: Path) -> None:
    model, state, weights = a_mechanism(seed, scene=scene, bodies=(2, 4), loops=(1, 2))
    agree(model, tmp_path, 1e-10, state, weights, 1e-12)


def test_a_platform_on_six_legs_agrees(tmp_path: Path) -> None:
    """An independent quaternion of any length, dependent quaternions, six loops."""
    agree(EXAMPLES / "stewart.yaml", tmp_path, 1e-11)


@pytest.mark.parametrize("name", ["four_bar", "double_wishbone"])
def test_both_targets_agree(name: str, tmp_path: Path) -> None:
    codegen.generate(EXAMPLES / f"{name}.yaml", tmp_path / "package", functions=FUNCTIONS)
    in_c, in_numpy = (codegen.load(tmp_path / "package", target=t) for t in ("c", "numpy"))
    state, weights = state_of(in_numpy)
    rng = np.random.default_rng(2)
    seeds = random_seeds(rng, codegen.load_model(EXAMPLES / f"{name}.yaml"), 11)
    given = {n: x for n, x in seeds.items() if n != "dt"}
    alone = in_numpy.hessian_products(*state, weights=weights, **given)
    largest = max(np.abs(x).max(initial=0) for x in alone)
    for k in (1, 8, 11):
        found = in_c.hessian_products(*state, weights=weights, **{n: x[:k] for n, x in given.items()})
        for x, y in zip(found, alone, strict=True):
            assert np.abs(x - y[:k]).max(initial=0) < 1e-12 * largest
    states = [np.stack([x, x, x]) for x in state[:4]]
    scaled = np.array([1.0, -2.0, 0.0])[:, None] * weights
    batch = in_c.hessian_products(*states, state.t, weights=scaled, **{n: x[:, None] for n, x in given.items()})
    for x, y in zip(batch, alone, strict=True):
        factors = np.array([1.0, -2.0, 0.0]).reshape(3, *[1] * (y.ndim - 1))
        assert np.abs(x - y[:, None] * factors).max(initial=0) < 1e-12 * largest


def test_dependent_entries_are_ignored_and_their_results_are_zero(tmp_path: Path) -> None:
    solver = made(EXAMPLES / "four_bar.yaml", tmp_path)
    state, weights = state_of(solver)
    dq = np.array([[1.0, 0.0, 0.0], [1.0, 5.0, -3.0]])
    found = solver.hessian_products(*state, weights=weights, dq=dq, du=dq)
    for x in found:
        assert (x[0] == x[1]).all()
    assert not found.q[:, 1:].any() and not found.u[:, 1:].any() and found.q[:, 0].all()


@pytest.mark.parametrize("more", [with_prescribed_at, with_rotors_at])
def test_prescribed_motion_and_rotors_in_loops_agree(more: Any, tmp_path: Path) -> None:
    model, state, weights = a_mechanism(500, scene="spatial", bodies=(3, 4), loops=(1, 2), more=more)
    agree(model, tmp_path, 1e-10, state, weights, 1e-12)


def test_couplings_agree(tmp_path: Path) -> None:
    found = coupled_tree(np.random.default_rng(2), 4, EVERY, 2)
    assert found is not None
    agree(found[0], tmp_path, 1e-11, found[1], np.random.default_rng(5).normal(size=found[0].nu))


def test_points_on_surfaces_and_distances_agree(tmp_path: Path) -> None:
    agree(parse_model(SPATIAL.replace("BASE", "free")), tmp_path, 1e-11)
