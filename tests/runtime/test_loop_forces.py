"""Mass matrix and inverse dynamics of mechanisms, on their independent speeds: against the tree without its loops, and against
accelerations under the very forces that were found."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from prescribed_models import bars
from rotor_models import with_rotors

import codegen
from codegen.model import Expression, Model, load_model, parse_model
from codegen.model.forces import JointForce

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = ("four_bar", "stewart", "bricard", "double_wishbone", "driven", "geared")
"""Examples, and a four-bar on a cart, with a pendulum on its coupler, whose crank is a function of time and parameters, without
and with rotors."""
T = 0.3


def pushed(model: Model, independent: tuple[str, ...]) -> Model:
    """The model with an additional input for each independent speed: a force along it."""
    forces, inputs, at = list(model.forces), list(model.inputs), 0
    for k, body in enumerate(model.bodies):
        speeds = model.released.speed_names[at : (at := at + len(body.joint.kind.speeds))]
        values = [
            Expression(("name", f"push_{n.replace('.', '_')}")) if n in independent else Expression.number(0)
            for n in speeds
        ]
        if any(not e.is_number for e in values):
            forces.append(JointForce(f"push_{body.name}", k, tuple(values)))
            inputs += [str(e) for e in values if not e.is_number]
    return dataclasses.replace(model, forces=tuple(forces), inputs=tuple(inputs))


@pytest.fixture(scope="module", params=NAMES)
def case(request: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any, Any]:
    """The solver, the solver of the pushed model, and the solver of the tree without its loops."""
    folder: Path = tmp_path_factory.mktemp(request.param)
    drawn = bars("cart", True) if request.param in NAMES[-2:] else load_model(EXAMPLES / f"{request.param}.yaml")
    model = with_rotors(np.random.default_rng(1), drawn, 1.0) if request.param == "geared" else drawn
    tree = dataclasses.replace(model, name="tree", loops=(), independent=())
    functions = ("accelerations", "sensitivities", "energy_sensitivities", "mass_matrix", "energies")
    made = []
    for name, of in (("own", model), ("tree", tree)):
        codegen.generate(of, folder / name, target="numpy", functions=functions[: 5 if of is tree else 3])
        made.append(codegen.load(folder / name))
    codegen.generate(
        pushed(model, made[0].independent_speed_names), folder / "pushed", target="numpy", functions=functions[:2]
    )
    return made[0], codegen.load(folder / "pushed"), made[1]


def state(solver: Any, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q, u = solver.initial
    return solver.assemble(q + 0.02 * rng.normal(size=solver.nq), u + rng.normal(size=solver.nu), t=T)


def test_the_mass_matrix_is_that_of_the_tree_on_closed_motions(case: tuple[Any, Any, Any]) -> None:
    solver, _, tree = case
    for seed in range(3):
        q, u = state(solver, seed)
        n = len(solver.independent_speed_names)
        free = [solver.speed_names.index(name) for name in solver.independent_speed_names]
        unit = np.zeros((n, solver.nu))
        unit[range(n), free] = 1.0
        rest = solver.assemble(q, 0 * u, t=T)[1]  # what prescribed motion makes of it
        Y = np.stack([solver.assemble(q, x, t=T)[1] - rest for x in unit], axis=1)
        expected = Y.T @ tree.mass_matrix(q, t=T) @ Y
        found = solver.mass_matrix(q, t=T)
        size = np.sqrt(np.diag(expected))
        assert (np.abs(found - expected) <= 1e-12 * np.outer(size, size)).all()
        there, back, still = (tree.energies(q, x, t=T)[0] for x in (u, 2 * rest - u, rest))
        assert (there + back) / 2 - still == pytest.approx(u[free] @ found @ u[free] / 2, rel=1e-13)


def test_the_forces_found_make_the_accelerations_asked_for(case: tuple[Any, Any, Any]) -> None:
    solver, moved, _ = case
    rng = np.random.default_rng(4)
    q, u = state(solver, 5)
    wanted, inputs, t = rng.normal(size=solver.nu), rng.normal(size=solver.ninputs), T
    free = [solver.speed_names.index(name) for name in solver.independent_speed_names]
    seeds = {
        "dq": rng.normal(size=(3, solver.nq)), "du": rng.normal(size=(3, solver.nu)), "dudot": rng.normal(size=(3, solver.nu)),
        "dp": 0.1 * rng.normal(size=(3, solver.np)) * solver.parameters, "dinputs": rng.normal(size=(3, solver.ninputs)),
        "dt": rng.normal(size=3),
    }  # fmt: skip
    tau, dtau = solver.inverse_dynamics_sensitivities(q, u, wanted, None, inputs, t, **seeds)
    assert np.array_equal(tau, solver.inverse_dynamics(q, u, wanted, None, inputs, t))
    bias, dbias = solver.bias_force_sensitivities(q, u, None, inputs, t, dq=seeds["dq"])
    assert np.array_equal(bias, solver.bias_force(q, u, None, inputs, t)) and dbias.shape == dtau.shape
    dudot = seeds.pop("dudot")
    seeds["dinputs"] = np.concatenate([seeds["dinputs"], dtau], axis=1)
    udot, changed = moved.sensitivities(q, u, None, [*inputs, *tau], t, **seeds)
    assert np.abs(udot - wanted)[free].max() <= 1e-11 * (1 + np.abs(wanted).max())
    size = np.abs(
        moved.sensitivities(q, u, None, [*inputs, *tau], t, dq=seeds["dq"], dp=seeds["dp"], dt=seeds["dt"])[1]
    ).max()
    assert np.abs(changed - dudot)[:, free].max() <= 1e-11 * size


def test_derivatives_of_the_mass_matrix(case: tuple[Any, Any, Any]) -> None:
    solver, _, _ = case
    rng = np.random.default_rng(6)
    q, u = state(solver, 7)
    dq, dp = rng.normal(size=(2, solver.nq)), 0.1 * rng.normal(size=(2, solver.np)) * solver.parameters
    dt = rng.normal(size=2)
    M, dM = solver.mass_matrix_sensitivities(q, t=T, dq=dq, dp=dp, dt=dt)
    wanted = rng.normal(size=solver.nu)
    free = [solver.speed_names.index(name) for name in solver.independent_speed_names]
    dtau = solver.inverse_dynamics_sensitivities(q, u, wanted, t=T, dq=dq, dp=dp, dt=dt)[1]
    udot, dudot = solver.sensitivities(q, u, t=T, dq=dq, dp=dp, dt=dt)
    expected = dM @ (wanted - udot)[free] - dudot[:, free] @ M
    assert np.abs(dtau - expected).max() <= 1e-11 * (np.abs(expected).max() + np.abs(dudot).max() * np.abs(M).max())
    assert np.array_equal(dM, dM.swapaxes(1, 2)) and dM.shape == (2, *M.shape)


def test_batches(case: tuple[Any, Any, Any]) -> None:
    solver, _, _ = case
    states = [state(solver, seed) for seed in (8, 9)]
    q, u = (np.stack(x) for x in zip(*states, strict=True))
    w = np.ones(solver.nu)
    dq = np.random.default_rng(1).normal(size=(3, 2, solver.nq))
    t = np.array([T, T])
    M, dM = solver.mass_matrix_sensitivities(q, t=t, dq=dq)
    tau, dtau = solver.inverse_dynamics_sensitivities(q, u, w, t=t, dq=dq)
    for i, (one, speeds) in enumerate(states):
        a, da = solver.mass_matrix_sensitivities(one, t=T, dq=dq[:, i])
        b, db = solver.inverse_dynamics_sensitivities(one, speeds, w, t=T, dq=dq[:, i])
        for x, y in ((M[i], a), (dM[:, i], da), (tau[i], b), (dtau[:, i], db)):
            assert np.abs(x - y).max() <= 1e-12 * (1 + np.abs(y).max())
    out = np.empty_like(M)
    assert solver.mass_matrix(q, t=t, out=out) is out and np.array_equal(out, M)


def test_what_there_is_not(case: tuple[Any, Any, Any]) -> None:
    solver, _, _ = case
    q, u = solver.initial
    with pytest.raises(AttributeError, match="defined for trees only; mass_matrix is there, on the independent speeds"):
        solver.solve_mass(q, u)
    with pytest.raises(ValueError, match="no seed given"):
        solver.inverse_dynamics_sensitivities(q, u, u)
    with pytest.raises(ValueError, match=r"udot has shape \(1,\), expected"):
        solver.inverse_dynamics(q, u, [1.0])


def test_a_tree_keeps_its_own(tmp_path: Path) -> None:
    text = "model: m\nbodies: {a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {yy: 2}}}\n"
    codegen.generate(parse_model(text), tmp_path / "m", target="numpy")
    solver = codegen.load(tmp_path / "m")
    assert np.array_equal(solver.mass_matrix([0.0]), [[2.0]])
    assert not (tmp_path / "m" / "_runtime" / "state" / "loop_forces.py").exists()
