"""Matrices whose columns are computed all at once: on random trees, with many columns, and in part."""

from __future__ import annotations

from pathlib import Path

import mpmath
import numpy as np
import pytest
from made_once import made

import codegen
from codegen.mechanics.structure.system import LONG
from codegen.model import parse_model
from codegen.reference import DenseEngine
from tests.random_models import EVERY, random_state, random_tree, relative_error
from tests.rotor_models import with_rotors

EXAMPLES = Path(__file__).parents[2] / "examples"
ACCURACY = 1e-11
MATRICES = ("q", "u", "p", "inputs", "t")


BY_COLUMNS = ("jacobians", "mass_matrix", "inverse_mass_matrix")


@pytest.mark.parametrize("seed", [3, 8, 21])
def test_random_trees_agree_with_the_dense_method(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    model = random_tree(rng, 6 + seed % 5, joints=EVERY)
    if seed % 2:
        model = with_rotors(np.random.default_rng(seed), model)
    solver, engine = made(model, tmp_path / "package", functions=BY_COLUMNS), DenseEngine(model)
    for _ in range(3):
        state = random_state(rng, model)
        J, exact = solver.jacobians(*state), engine.jacobians(*state)
        for name in MATRICES:
            assert relative_error(getattr(J, name), getattr(exact, name)) < ACCURACY, name
        M = engine.mass_matrix(state.q, state.p)
        assert relative_error(solver.mass_matrix(state.q, state.p), M) < ACCURACY
        inverse = solver.inverse_mass_matrix(state.q, state.p)
        solved = np.stack([engine.solve_mass(state.q, b, state.p) for b in np.eye(model.nu)], axis=1)
        assert relative_error(inverse, solved) < ACCURACY
        assert np.array_equal(inverse, inverse.T)


def chain(n: int) -> codegen.Model:
    text = (EXAMPLES / "chain.yaml").read_text()
    assert "{n: 12," in text
    return parse_model(text.replace("{n: 12,", f"{{n: {n},"))


@pytest.fixture(scope="module")
def long_chain(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return made(chain(40), tmp_path_factory.mktemp("long") / "package")


def test_more_columns_than_there_is_room_for(long_chain: codegen.Solver) -> None:
    n, k = 40, np.arange(1, 41)
    q, u = 0.3 * np.sin(k), 0.2 * np.cos(k)
    J = long_chain.jacobians(q, u)
    exact = long_chain.in_precision(40).jacobians(q, u, wrt="q, u")
    for given, of in ((J.q, exact.q), (J.u, exact.u)):
        scale = np.abs(of).max()
        assert float(np.abs(given - of).max() / scale) < 5e-14
    M = long_chain.mass_matrix(q)
    x = np.cos(k * 0.7)
    assert np.array_equal(M, M.T)
    b = long_chain.inverse_dynamics(q, np.zeros(n), x) - long_chain.inverse_dynamics(q, np.zeros(n), np.zeros(n))
    assert np.abs(M @ x - b).max() < 1e-12 * np.abs(b).max()


def test_the_inverse_of_the_mass_matrix_keeps_its_digits(long_chain: codegen.Solver) -> None:
    """The condition of M is 1e7 here; the factors of forward dynamics do not know it."""
    q = 0.3 * np.sin(np.arange(1, 41))
    exact = long_chain.in_precision(40)
    inverse = long_chain.inverse_mass_matrix(q)
    with mpmath.workdps(40):
        M = mpmath.matrix(exact.mass_matrix(q).tolist())
        of = np.array((M**-1).tolist())
        assert float(np.abs(inverse - of).max() / np.abs(of).max()) < 2e-14
        assert float(np.abs(exact.inverse_mass_matrix(q) - of).max() / np.abs(of).max()) < 1e-25
    assert np.array_equal(inverse, inverse.T)
    many = np.stack([q, -q])
    assert np.array_equal(long_chain.inverse_mass_matrix(many)[0], inverse)


def test_the_inverse_where_force_elements_act_is_that_of_the_tree(tmp_path: Path) -> None:
    """Columns are taken one after the other there."""
    spring = (
        "  spring: {type: spring, from: {body: c, at: [0, 0.1, 0]}, to: {body: ground, at: [1, 0, 0]}, stiffness: 3}"
    )
    model = parse_model(COUPLED.rstrip() + "\n" + spring + "\n")
    solver, engine = made(model, tmp_path / "package"), DenseEngine(model)
    q = [0.3, -0.7, 0.2]
    solved = np.stack([engine.solve_mass(q, b) for b in np.eye(3)], axis=1)
    assert relative_error(solver.inverse_mass_matrix(q), solved) < ACCURACY
    assert relative_error(solver.inverse_mass_matrix(q) @ engine.mass_matrix(q), np.eye(3)) < ACCURACY


def test_only_what_is_asked_for(long_chain: codegen.Solver) -> None:
    k = np.arange(1, 41)
    q, u = 0.3 * np.sin(k), 0.2 * np.cos(k)
    whole = long_chain.jacobians(q, u)
    many = np.stack([q, 2 * q, q])
    for wrt, names in (("q, u", "qu"), ("u", "u"), (["p"], "p"), ("p,q", "qp")):
        for J, of in ((long_chain.jacobians(q, u, wrt=wrt), ...), (long_chain.jacobians(many, u, wrt=wrt), 2)):
            for name in MATRICES:
                found = getattr(J, name)
                assert (found is None) == (name not in names)
                if found is not None:
                    assert np.array_equal(found[of], getattr(whole, name))
    assert repr(long_chain.jacobians(q, u, wrt="u")) == "<Jacobians of udot: u (40, 40)>"


@pytest.mark.parametrize(("wrt", "told"), [("q, v", "'v'"), ("input", "did you mean 'inputs'"), ([], "wrt is empty")])
def test_unknown_names_are_told(long_chain: codegen.Solver, wrt: object, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        long_chain.jacobians(np.zeros(40), np.zeros(40), wrt=wrt)  # type: ignore[arg-type]


LEGS = """
model: legs
bodies:
  trunk: {parent: ground, joint: {type: free}, mass: 3, inertia: {xx: 0.1, yy: 0.2, zz: 0.3}, com: [0.1, 0, 0.2]}
  repeat k in 1..3:
    thigh(k): {parent: trunk, joint: {type: revolute, axis: x, at: [0.3*k, 0.1, 0]}, mass: 1,
               inertia: {xx: 0.1, yy: 0.2, zz: 0.1}, com: [0.1, 0, -0.5]}
    shank(k): {parent: thigh(k), joint: {type: revolute, axis: y, at: [0, 0, -0.7]}, mass: 1,
               inertia: {xx: 0.1, yy: 0.2, zz: 0.1}, com: [0, 0.1, -0.5]}
    foot(k): {parent: shank(k), joint: {type: prismatic, axis: z, at: [0, 0, -0.7]}, mass: 0.3,
              inertia: {xx: 0.01, yy: 0.02, zz: 0.01}, com: [0, 0.1, -0.1]}
"""


def test_what_legs_have_nothing_to_do_with_is_zero(tmp_path: Path) -> None:
    """Blocks of four rows and columns of which links know all, some and no rows, and a last one that is not whole."""
    model = parse_model(LEGS)
    solver, engine = made(model, tmp_path / "package", functions=BY_COLUMNS), DenseEngine(model)
    assert "take_blocks(" in (tmp_path / "package" / "legs.c").read_text()
    q = np.array([0.1, -0.2, 0.3, 0.8, 0.1, -0.5, 0.3, 0.3, -0.7, 0.2, 0.5, 0.4, -0.1, 0.9, 0.6, 0.15])
    q[3:7] /= np.linalg.norm(q[3:7])
    inverse = solver.inverse_mass_matrix(q)  # leaves its rows behind
    M = solver.mass_matrix(q)
    assert relative_error(M, engine.mass_matrix(q)) < ACCURACY
    assert relative_error(inverse @ M, np.eye(15)) < ACCURACY
    assert np.array_equal(M, M.T) and np.array_equal(inverse, inverse.T)
    leg = np.repeat([0, 1, 2, 3], [6, 3, 3, 3])
    apart = (leg[:, None] != leg) & (leg[:, None] > 0) & (leg > 0)
    assert not M[apart].any()


LEANING = """
model: leaning
constants: {{n: {n}}}
parameters: {{g: 9.81, s: 0.3, L: 0.7}}
gravity: [g*sin(s), 0.1*g, -g*cos(s)]
bodies:
  repeat k in 1..n:
    rod(k):
      parent: rod(k-1)
      joint: {{type: revolute, axis: [k % 2, 1 - k % 2, 0], at: [0, 0, -L]}}
      shape: {{type: rod, axis: z, length: L, mass: 1, center: [0, 0, -L/2]}}
      first: {{parent: ground, joint: {{at: [0, 0, 0]}}}}
  side: {{parent: rod(2), joint: {{type: universal, axes: [x, y], at: [0.1, 0, -L]}}, mass: 2,
         inertia: {{xx: 0.1, yy: 0.2, zz: 0.1}}, com: [0.1, 0, -L]}}
"""


@pytest.mark.parametrize("n", [3, LONG + 2])
def test_gravity_that_depends_on_parameters(n: int, tmp_path: Path) -> None:
    """Of short chains it is in the remainders, of long ones in the explicit part of the accelerations."""
    model = parse_model(LEANING.format(n=n))
    solver = made(model, tmp_path / "package")
    k = np.arange(1, model.nq + 1)
    state = (0.3 * np.sin(k), 0.2 * np.cos(k), [9.7, 0.2, 0.8])
    J, exact = solver.jacobians(*state), solver.in_precision(40, model).jacobians(*state)
    for name in ("q", "u", "p"):
        of = getattr(exact, name)
        assert float(np.abs(getattr(J, name) - of).max() / np.abs(of).max()) < 2e-14, name


MANY = """
model: many
inputs: [a, b, c, d]
bodies:
  repeat k in 1..4:
    rod(k): {parent: rod(k-1), joint: {type: revolute, axis: [k % 2, 1 - k % 2, 0], at: [0, 0, -1]}, mass: 1,
             inertia: {xx: 0.1, yy: 0.2, zz: 0.1}, com: [0.1, 0, -0.5], first: {parent: ground}}
forces:
  one:
    type: joint
    joint: rod(2)
    value: "a*sin(q.rod(1)) + b*u.rod(1)*u.rod(2) + c*q.rod(2)*q.rod(3) + d*u.rod(3)*q.rod(4) - u.rod(4)"
"""


def test_a_force_with_more_arguments_than_directions(tmp_path: Path) -> None:
    """Columns are taken one after the other then."""
    model = parse_model(MANY)
    solver, engine = made(model, tmp_path / "package"), DenseEngine(model)
    state = ([0.3, -0.7, 0.2, 0.5], [1.0, 0.4, -0.8, 0.6], [], [1.2, 0.7, -0.3, 0.4])
    J, exact = solver.jacobians(*state), engine.jacobians(*state)
    for name in MATRICES:
        assert relative_error(getattr(J, name), getattr(exact, name)) < ACCURACY, name


COUPLED = """
model: coupled
gravity: [0, 0, -9.81]
inputs: [motor, brake]
parameters: {d: 0.3}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}, com: [0, 0, -1]}
  b: {parent: a, joint: {type: revolute, axis: x, at: [0, 0, -1]}, mass: 2,
      inertia: {xx: 0.1, yy: 0.2, zz: 0.1}, com: [0.1, 0, -1]}
  c: {parent: a, joint: {type: prismatic, axis: z, at: [0.2, 0, -1]}, mass: 3,
      inertia: {xx: 0.1, yy: 0.1, zz: 0.2}, com: [0, 0.2, 0]}
forces:
  one: {type: joint, joint: a, value: "motor*cos(q.b) - d*u.a*u.c - 3*q.a"}
  two: {type: joint, joint: c, value: "brake**2 - motor*u.b + t*q.a"}
"""


def test_joint_forces_that_depend_on_everything(tmp_path: Path) -> None:
    model = parse_model(COUPLED)
    solver, engine = made(model, tmp_path / "package"), DenseEngine(model)
    state = ([0.3, -0.7, 0.2], [1.0, 0.4, -0.8], [0.3], [1.2, 0.7], 0.6)
    J, exact = solver.jacobians(*state), engine.jacobians(*state)
    for name in MATRICES:
        assert relative_error(getattr(J, name), getattr(exact, name)) < ACCURACY, name
    alone = solver.jacobians(*state, wrt="inputs")
    assert np.array_equal(alone.inputs, J.inputs) and alone.q is None
