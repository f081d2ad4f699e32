"""Products with the Hessian of outputs that read accelerations or forces of prescribed motion: against 40 digits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from coupled_coordinates import coupled_tree
from measured import with_outputs
from prescribed_models import with_prescribed_at
from random_models import EVERY, RandomState, random_seeds, random_state
from rotor_models import with_rotors_at
from second_derivatives import (
    ACCELERATED,
    EXAMPLES,
    agree_with_differences,
    every_output_of_a_mechanism,
    every_output_of_a_tree,
    made,
)

import codegen
from codegen.model import Model, parse_model
from codegen.reference import DenseEngine
from codegen.runtime import Final, Integral

PRODUCTS = "output_hessian_products"
FUNCTIONS = f"output_gradients,{PRODUCTS}"


def weights_of(model: Model) -> np.ndarray:
    return np.random.default_rng(0).normal(size=len(model.outputs))


def agree(model: Model, state: Any, folder: Path, limit: float) -> None:
    assert any(o.measure in ACCELERATED for o in model.outputs)
    agree_with_differences(model, state, weights_of(model), folder, PRODUCTS, limit)


def only(model: Model, *measures: str) -> Model:
    return replace(model, outputs=tuple(o for o in model.outputs if o.measure in measures))


@pytest.mark.parametrize("seed", (0, 1, 2, 5))
def test_random_trees_agree_with_differences_in_40_digits(seed: int, tmp_path: Path) -> None:
    """With outputs of every measure."""
    model, state = every_output_of_a_tree(seed)
    agree(model, state, tmp_path, 1e-12)


@pytest.mark.parametrize("measure", ACCELERATED)
def test_each_measure_alone_agrees(measure: str, tmp_path: Path) -> None:
    """Without the sweeps of the others."""
    model, state = every_output_of_a_tree(0)
    agree(only(model, measure), state, tmp_path, 1e-12)


@pytest.mark.parametrize("seed", (0, 75))
@pytest.mark.parametrize("scene", ["spatial", "planar", "spherical"])
def test_random_mechanisms_agree_with_differences_in_40_digits(scene: str, seed: int, tmp_path: Path) -> None:
    model, state = every_output_of_a_mechanism(seed, scene=scene, bodies=(2, 4), loops=(1, 2))
    agree(model, state, tmp_path, 1e-10)


@pytest.mark.parametrize(
    ("more", "seed"), [(with_prescribed_at, 500), (with_prescribed_at, 508), (with_rotors_at, 500)]
)
def test_prescribed_motion_and_rotors_in_loops_agree(more: Any, seed: int, tmp_path: Path) -> None:
    model, state = every_output_of_a_mechanism(seed, scene="spatial", bodies=(3, 4), loops=(1, 2), more=more)
    agree(only(model, *ACCELERATED), state, tmp_path, 1e-10)


def test_couplings_agree(tmp_path: Path) -> None:
    found = coupled_tree(np.random.default_rng(2), 4, EVERY, 2)
    assert found is not None
    model = with_outputs(np.random.default_rng(4), found[0])
    agree(only(model, *ACCELERATED), found[1], tmp_path, 1e-11)


GEARS = """
model: gears
gravity: [0, 0, -9.81]
parameters: {length: 0.7, mass: 1.2, ratio: 2.5, rotor: 0.03, pitch: 0.1}
inputs: [pull]
bodies:
  base: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
  arm: {parent: base, joint: {type: revolute, axis: y, armature: rotor}, mass: mass, com: [0, 0.1, -length/2],
        inertia: {xx: 0.1, yy: 0.12, zz: 0.05}}
  screw: {parent: arm, joint: {type: screw, axis: [1, 0.2, 0], pitch: pitch, at: [0, 0, -length], armature: rotor},
          mass: 0.5, com: [0.1, 0.1, 0], inertia: {xx: 0.02, yy: 0.03, zz: 0.03}}
  wheel: {parent: base, joint: {type: revolute, axis: y, at: [0.3, 0, 0]}, mass: 0.6, com: [0.1, 0, 0.05],
          inertia: {xx: 0.02, yy: 0.03, zz: 0.02}}
forces:
  own: {type: joint, joint: screw, value: -3*q.screw*q.base - 0.2*mass*u.screw*u.wheel + pull**2}
motion:
  screw: 0.4*sin(3*t)*length + pull*t
outputs:
  push: {driving_force: screw}
LOOPS
"""
COUPLED = """
couplings:
  gear: {joint: arm, follows: {screw: 0.5, wheel: ratio}}
"""


@pytest.mark.parametrize("loops", ["", COUPLED], ids=["tree", "loops"])
def test_a_driven_screw_with_a_rotor_and_its_own_force_agrees(loops: str, tmp_path: Path) -> None:
    model = parse_model(GEARS.replace("LOOPS", loops))
    drawn = random_state(np.random.default_rng(3), model)
    state = RandomState(*drawn[:4], 0.7)
    if loops:
        solver = made(model, tmp_path / "closed", functions="assemble")
        state = RandomState(*solver.assemble(*state), *state[2:])
    agree(model, state, tmp_path, 1e-12)


LIFT = """
model: lift
gravity: [0, 0, -9.81]
parameters: {a: 0.4, m: 3}
bodies:
  cage: {parent: ground, joint: {type: prismatic, axis: z}, mass: m}
motion:
  cage: a*t**3
outputs:
  push: {driving_force: cage}
  climb: {acceleration: cage, axis: z}
"""


def test_all_motion_may_be_prescribed(tmp_path: Path) -> None:
    """``m (x'' + g)`` with ``x = a t^3``: its derivative by t and a is ``6 m``."""
    model = parse_model(LIFT)
    solver = made(model, tmp_path, functions=PRODUCTS)
    found = solver.output_hessian_products([], [], [0.4, 3.0], t=2.0, weights=[1.0, 0.0], dt=[1.0], dp=[[0.0, 0.0]])
    assert found.p[0] == pytest.approx([6 * 3.0, 6 * 0.4], rel=1e-14)
    found = solver.output_hessian_products([], [], [0.4, 3.0], t=2.0, weights=[0.0, 1.0], dp=[[1.0, 0.0]])
    assert found.t[0] == pytest.approx(6.0, rel=1e-14)


def check_targets(model: Model, state: Any, functions: str, folder: Path) -> None:
    """C for any number of directions and for batches, against NumPy; and against a dense engine on dual numbers."""
    codegen.generate(model, folder / "package", functions=functions)
    in_c, in_numpy = (codegen.load(folder / "package", target=t) for t in ("c", "numpy"))
    rng, weights = np.random.default_rng(3), weights_of(model)
    seeds = random_seeds(rng, model, 11)
    expected = in_numpy.output_hessian_products(*state, weights=weights, **seeds)
    largest = max(np.abs(x).max(initial=0) for x in expected)
    for k in (1, 8, 11):
        found = in_c.output_hessian_products(*state, weights=weights, **{n: x[:k] for n, x in seeds.items()})
        for x, y in zip(found, expected, strict=True):
            assert np.abs(x - y[:k]).max(initial=0) < 1e-12 * largest
    factors = np.array([1.0, -2.0, 0.0])
    states = [np.stack([x] * 3) for x in state[:4]]
    batch = {n: x[:, None] for n, x in seeds.items()}
    found = in_c.output_hessian_products(*states, state.t, weights=factors[:, None] * weights, **batch)
    for x, y in zip(found, expected, strict=True):
        assert np.abs(x - y[:, None] * factors.reshape(3, *[1] * (y.ndim - 1))).max(initial=0) < 1e-12 * largest
    engine = DenseEngine(model).output_hessian_products(*state, weights=weights, **{n: x[:2] for n, x in seeds.items()})
    for x, y in zip(engine, expected, strict=True):
        assert np.abs(np.asarray(x, float) - y[:2]).max(initial=0) < 1e-10 * largest
    for name in ("hessian_products", "inverse_dynamics_hessian_products"):  # their sweeps are shared
        if name in functions.split(","):
            weights = rng.normal(size=model.nu)
            given = (*state[:2], weights, *state[2:]) if "inverse" in name else state
            found, expected = (getattr(s, name)(*given, weights=weights, **seeds) for s in (in_c, in_numpy))
            largest = max(np.abs(x).max(initial=0) for x in expected)
            assert max(np.abs(x - y).max(initial=0) for x, y in zip(found, expected, strict=True)) < 1e-12 * largest


SEVERAL = f"accelerations,hessian_products,energy_hessian_products,{PRODUCTS}"


@pytest.mark.parametrize(
    "functions", [PRODUCTS, f"{SEVERAL},inverse_dynamics_hessian_products"], ids=["alone", "several"]
)
def test_both_targets_agree_for_trees(functions: str, tmp_path: Path) -> None:
    check_targets(*every_output_of_a_tree(2), functions, tmp_path)


@pytest.mark.parametrize("functions", [PRODUCTS, SEVERAL], ids=["alone", "several"])
def test_both_targets_agree_for_loops(functions: str, tmp_path: Path) -> None:
    model, state = every_output_of_a_mechanism(4, scene="spatial", bodies=(2, 4), loops=(1, 2), more=with_prescribed_at)
    check_targets(model, state, functions, tmp_path)


def test_an_example(tmp_path: Path) -> None:
    """The accelerometers of a quadrotor."""
    solver = made(EXAMPLES / "quadrotor.yaml", tmp_path, functions=FUNCTIONS)
    q, u = solver.initial
    H = solver.hessians(q, u, weights={"climb": 1.0}, wrt="q, u, p", of="outputs")
    assert np.abs(H).max() > 0
    assert np.abs(H - H.T).max() < 1e-13 * np.abs(H).max()


def test_motions_use_the_compiled_products(tmp_path: Path) -> None:
    """Hessians of functionals of a driving force, with and without the function in the package."""
    functions, found = "motion,hessian_products", []
    for more in ("", f",{PRODUCTS}"):
        codegen.generate(EXAMPLES / "shaken_pendulum.yaml", tmp_path / f"package{more}", functions=functions + more)
        solver = codegen.load(tmp_path / f"package{more}")
        wanted = [Final("motor"), Integral("motor")]
        judged = solver.judge(0.1, wanted, wrt=("length", "amplitude"), integrator="rk4", step=0.02, hessian=True)
        found.append(judged.hessian_products)
    assert np.abs(found[0]).max() > 0
    np.testing.assert_allclose(*found, rtol=0, atol=1e-13 * np.abs(found[0]).max())


def test_messages(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="output_hessian_products needs outputs, and this model has none"):
        codegen.generate(parse_model(LIFT.partition("outputs:")[0]), tmp_path, functions=PRODUCTS)
