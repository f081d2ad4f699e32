"""Members of the solver against the generic engine and each other; the tests in `rig` cover arrays."""

import ast
import inspect
import re

import numpy as np
import pytest

import codegen
from codegen.reference import RecursiveEngine
from codegen.runtime import Solver
from codegen.runtime.sections import SECTIONS, solver_text
from codegen.runtime.standalone import solver as whole
from codegen.runtime.standalone.calls.functions import SOMETIMES


def state(solver, rng, *batch):
    """Random arguments q, u, p, inputs, t, each (*batch, n); quaternions of any length."""
    q = rng.normal(size=(*batch, solver.nq))
    u = rng.normal(size=(*batch, solver.nu))
    p = solver.parameters * rng.uniform(0.9, 1.1, size=(*batch, solver.np))
    return q, u, p, rng.normal(size=(*batch, solver.ninputs)), rng.uniform(size=batch)


def seeds_of(solver, rng, *lead):
    sizes = {"dq": solver.nq, "du": solver.nu, "dp": solver.np, "dinputs": solver.ninputs}
    return {name: rng.normal(size=(*lead, n)) for name, n in sizes.items()} | {"dt": rng.normal(size=lead)}


def close(a, b, rtol=1e-11):
    """Check the largest difference divided by the largest reference; targets round alike, batches may differ."""
    a, b = np.asarray(a), np.asarray(b)
    assert a.shape == b.shape
    assert np.max(np.abs(a - b), initial=0.0) <= rtol * max(np.max(np.abs(b), initial=0.0), 1e-12)


# ---- agreement with the generic engine, member by member -------------------------------------------------------------


@pytest.mark.parametrize("name", ["double_pendulum", "satellite"])
@pytest.mark.parametrize("target", ["c", "numpy", "both"])
def test_every_member_agrees_with_the_generic_engine(name, target, packages, models):
    solver, engine = codegen.load(packages / name, target), RecursiveEngine(models[name])
    rng = np.random.default_rng(3)
    q, u, p, inputs, t = state(solver, rng)
    all_seeds = seeds_of(solver, rng, 3)
    b, udot, db, dudot = (rng.normal(size=(*k, solver.nu)) for k in ((), (), (3,), (3,)))

    def some(*names):
        return {n: all_seeds[n] for n in names}

    everything = dict(all_seeds)
    pairs = [
        ("accelerations", (q, u, p, inputs, t), {}),
        ("sensitivities", (q, u, p, inputs, t), everything),
        ("coordinate_rates", (q, u, p, inputs, t), {}),
        ("coordinate_rate_sensitivities", (q, u, p, inputs, t), everything),
        ("mass_matrix", (q, p), {}),
        ("mass_matrix_sensitivities", (q, p), some("dq", "dp")),
        ("solve_mass", (q, b, p), {}),
        ("solve_mass_sensitivities", (q, b, p), some("dq", "dp") | {"db": db}),
        ("inverse_dynamics", (q, u, udot, p, inputs, t), {}),
        ("inverse_dynamics_sensitivities", (q, u, udot, p, inputs, t), everything | {"dudot": dudot}),
        ("energies", (q, u, p, inputs, t), {}),
        ("energy_sensitivities", (q, u, p, inputs, t), everything),
        ("outputs", (q, u, p, inputs, t), {}),
        ("output_sensitivities", (q, u, p, inputs, t), everything),
    ]
    for member, arguments, seeds in pairs:
        ours, theirs = (getattr(x, member)(*arguments, **seeds) for x in (solver, engine))
        _same(ours, theirs, member)
    ours, theirs = (x.jacobians(q, u, p, inputs, t) for x in (solver, engine))
    for field in ("q", "u", "p", "inputs", "t"):
        close(getattr(ours, field), np.asarray(getattr(theirs, field), float))


def _same(ours, theirs, member):
    if isinstance(theirs, tuple):
        assert len(ours) == len(theirs)
        for a, b in zip(ours, theirs, strict=True):
            _same(a, b, member)
        return
    theirs = np.asarray(theirs, dtype=float)
    assert np.shape(ours) == theirs.shape, member
    close(ours, theirs)


# ---- directions ------------------------------------------------------------------------------------------------------


def test_what_a_function_does_not_depend_on_has_zero_derivative(satellite):
    q, u, p, inputs, t = state(satellite, np.random.default_rng(12))
    qdot, dqdot = satellite.coordinate_rate_sensitivities(q, u, p, inputs, t, dp=np.eye(satellite.np))
    close(qdot, satellite.coordinate_rates(q, u))
    assert dqdot.shape == (satellite.np, satellite.nq)
    assert not dqdot.any()


def test_any_number_of_directions_of_a_batch_gives_what_each_gives_alone(satellite):
    q, u = satellite.initial
    dp = np.random.default_rng(3).normal(size=(19, satellite.np))
    alone = np.concatenate([satellite.output_sensitivities(q, u, dp=row)[1] for row in dp])
    batch = np.tile(q, (120, 1))
    for k in range(1, 20):
        close(satellite.output_sensitivities(batch, u, dp=dp[:k])[1], np.repeat(alone[:k, None], 120, axis=1))


# ---- names -----------------------------------------------------------------------------------------------------------


def test_parameters_inputs_and_seeds_may_be_given_by_name(satellite):
    q, u = satellite.initial
    name, other = satellite.parameter_names[1], satellite.input_names[0]
    p, inputs = satellite.parameters, np.zeros(satellite.ninputs)
    p[1] *= 1.1
    inputs[0] = 2.0
    expected = satellite.accelerations(q, u, p, inputs)
    close(satellite.accelerations(q, u, {name: p[1]}, {other: 2.0}), expected)
    batch = satellite.accelerations(q, u, {name: [p[1], satellite.parameters[1]]}, inputs)
    close(batch[0], expected)
    dp = np.zeros(satellite.np)
    dp[1] = 1.0
    close(satellite.sensitivities(q, u, dp={name: 1.0})[1], satellite.sensitivities(q, u, dp=dp)[1])


def test_names_and_sizes_match(satellite, models):
    model = models["satellite"]
    assert satellite.coordinate_names == model.coordinate_names == satellite.independent_names
    assert satellite.speed_names == model.speed_names == satellite.independent_speed_names
    assert satellite.parameter_names == model.parameter_names
    assert satellite.input_names == model.inputs
    assert satellite.output_names == tuple(o.name for o in model.outputs)
    assert satellite.closure_names == satellite.prescribed_names == ()
    sizes = satellite.nq, satellite.nu, satellite.np, satellite.ninputs, satellite.noutputs
    assert sizes == (model.nq, model.nu, len(model.parameters), len(model.inputs), len(model.outputs))
    assert "nq=" in repr(satellite)
    assert satellite.operations["accelerations"]["kinematics"]["per_call"]["multiplications"] > 0


# ---- states ----------------------------------------------------------------------------------------------------------


def test_assembling_a_tree_normalises_quaternions(satellite):
    rng = np.random.default_rng(13)
    q, u, p, inputs, t = state(satellite, rng, 3)
    q_new, u_new = satellite.assemble(q, u, p)
    assert np.array_equal(u_new, u)
    for i in [j for j, n in enumerate(satellite.coordinate_names) if n.endswith(".qw")]:
        close(np.linalg.norm(q_new[..., i : i + 4], axis=-1), np.ones(3))
    close(satellite.accelerations(q_new, u, p, inputs, t), satellite.accelerations(q, u, p, inputs, t))
    again = satellite.assemble(q_new, u)[0]
    close(again, q_new)
    start = satellite.assemble()
    close(start[0], satellite.initial[0])
    close(satellite.assemble(u=u[0])[1], u[0])


def test_assembled_seeds_say_the_same(satellite):
    rng = np.random.default_rng(14)
    q, u, p, inputs, t = state(satellite, rng, 2)
    dq, du = rng.normal(size=(3, 2, satellite.nq)), rng.normal(size=(3, satellite.nu))
    q_new, u_new, dq_new, du_new = satellite.assemble_sensitivities(q, u, p, dq=dq, du=du)
    assert dq_new.shape == (3, 2, satellite.nq)
    assert du_new.shape == (3, 2, satellite.nu)
    ours = satellite.sensitivities(q_new, u_new, p, inputs, t, dq=dq_new, du=du_new)[1]
    close(ours, satellite.sensitivities(q, u, p, inputs, t, dq=dq, du=du)[1], rtol=1e-10)
    _, _, dq_none, du_none = satellite.assemble_sensitivities(q, u, p, dp=np.eye(satellite.np))
    assert not dq_none.any()
    assert not du_none.any()


def test_forces_and_accelerations_belong_together(satellite):
    rng = np.random.default_rng(15)
    q, u, p, inputs, t = state(satellite, rng, 2)
    seeds = seeds_of(satellite, rng, 3, 2)
    udot, dudot = satellite.sensitivities(q, u, p, inputs, t, **seeds)
    bias, dbias = satellite.bias_force_sensitivities(q, u, p, inputs, t, **seeds)
    M, dM = satellite.mass_matrix_sensitivities(q, p, dq=seeds["dq"], dp=seeds["dp"])
    close(bias, satellite.bias_force(q, u, p, inputs, t))
    close(np.einsum("...ij,...j->...i", M, udot), -bias, rtol=1e-9)
    left = np.einsum("k...ij,...j->k...i", dM, udot) + np.einsum("...ij,k...j->k...i", M, dudot)
    close(left, -dbias, rtol=1e-9)
    close(satellite.solve_mass(q, -bias, p), udot, rtol=1e-9)
    force = satellite.inverse_dynamics(q, u, udot, p, inputs, t)
    assert np.max(np.abs(force)) <= 1e-9 * np.max(np.abs(bias))


# ---- sections --------------------------------------------------------------------------------------------------------


def methods(text: str) -> dict[str, ast.FunctionDef]:
    """The methods of the class in a text of `Solver`, by name."""
    (solver,) = (node for node in ast.parse(text).body if isinstance(node, ast.ClassDef))
    return {node.name: node for node in solver.body if isinstance(node, ast.FunctionDef)}


def test_every_method_is_written_out_with_what_it_takes():
    """In one class, in sections that `SECTIONS` knows, each with a docstring; none takes what it does not name."""
    text = inspect.getsource(whole)
    assert set(re.findall(r"^    # -- (.+?) -+$", text, re.MULTILINE)) == SECTIONS.keys()
    found = methods(text)
    assert {*SOMETIMES} <= found.keys() and len(found) > 50
    for name, method in found.items():
        if not name.startswith("_"):
            assert ast.get_docstring(method) and method.returns is not None, name
            assert method.args.vararg is None and method.args.kwarg is None, name
            assert len(method.body) <= 3, name  # the docstring, and a call
    assert [c.__name__ for c in Solver.__mro__] == ["Solver", "Solver", "Package", "object"]


def test_a_package_has_some_sections_whole_and_imports_what_these_use():
    text = inspect.getsource(whole)
    assert solver_text(SECTIONS) == text
    for section in SECTIONS:
        part = solver_text([section])
        names = {
            a.asname or a.name
            for node in ast.walk(ast.parse(part))
            if isinstance(node, ast.ImportFrom)
            for a in node.names
        }
        body = part.partition("\nclass Solver")[2]
        assert all(re.search(rf"\b{name}\b", body) for name in names - {"annotations"}), section
        assert methods(part).keys() < methods(text).keys() and part.count("# -- ") == 1
        compile(part, section, "exec")
