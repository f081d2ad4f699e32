"""Packages in single precision against double precision: every function, single states and batches in vectors."""

from __future__ import annotations

import pickle
import subprocess
import sys
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import codegen
from codegen.cli import generate_main
from codegen.emit.c import C
from codegen.mechanics.procedures import UnknownFunctionError
from codegen.model import Model, ModelError, load_model, parse_model
from codegen.runtime.standalone.arrays import C_TYPES
from codegen.runtime.standalone.calls import batches
from codegen.runtime.standalone.errors import SingularJointError

EXAMPLES = Path(__file__).parents[2] / "examples"
UDOT, DERIVATIVES = 1e-5, 1e-4
"""Differences allowed, of the largest entry."""


def solo12() -> Model:
    pytest.importorskip("pinocchio", reason="its packages bring the robot's file: pip install pin example-robot-data")
    from codegen.measure.pinocchio_models import robots_folder

    file = robots_folder() / "solo_description/robots/solo12.urdf"
    if not file.is_file():
        pytest.skip("the robots of example-robot-data are not installed: pip install example-robot-data")
    return codegen.import_model(file, base="free").model


MODELS = {
    "chain": lambda: load_model(EXAMPLES / "chain.yaml"),
    "arm": lambda: load_model(EXAMPLES / "arm.yaml"),
    "four_bar": lambda: load_model(EXAMPLES / "four_bar.yaml"),
    "quadruped": lambda: load_model(EXAMPLES / "quadruped.yaml"),
    "solo12": solo12,
    "satellite": lambda: load_model(EXAMPLES / "satellite.yaml"),
}
SLENDER = "satellite"
"""A model whose thin boom may lie along the first axis of a universal joint: its mass matrix is then ill conditioned."""
QUICK = ("chain", "four_bar")
EVERY_MEMBER = ("arm", "four_bar")


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Returns the solvers of a model in single and in double precision."""

    @cache
    def of(name: str) -> tuple[Any, Any]:
        model, folder = MODELS[name](), tmp_path_factory.mktemp(name)
        compiled = "all" if name in EVERY_MEMBER else True
        found = []
        for scalar in ("float32", "float64"):
            codegen.generate(model, folder / scalar, scalar=scalar, reactions=True, frames=True, compile=compiled)
            found.append(codegen.load(folder / scalar))
        return found[0], found[1]

    return of


def states(solver: Any, count: int, seed: int) -> tuple[Any, Any, Any]:
    """Closed states with their directions, as numbers in single precision."""
    rng = np.random.default_rng(seed)
    q, u = solver.initial
    q = q + (0.1 if solver.closure_names else 0.5) * rng.normal(size=(count, solver.nq))
    u = u + rng.normal(size=(count, solver.nu))
    q, u = solver.assemble(q, u)
    sizes = {"dq": solver.nq, "du": solver.nu, "dp": solver.np, "dinputs": solver.ninputs}
    seeds = {n: rng.normal(size=(8, size)).astype("f4") for n, size in sizes.items()}
    return q.astype("f4"), u.astype("f4"), seeds


def off(found: Any, expected: Any) -> float:
    """Difference divided by the largest entry of the state's result."""
    axes = tuple(range(1, found.ndim))
    return float(np.max(np.abs(found - expected).max(axis=axes) / np.abs(expected).max(axis=axes)))


def compare(single: Any, double: Any, count: int, seed: int) -> None:
    q, u, seeds = states(double, count, seed)
    wide = {n: x.astype(float) for n, x in seeds.items()}
    expected = double.sensitivities(q.astype(float), u.astype(float), **wide)
    found = single.sensitivities(q, u, **seeds)
    assert single.accelerations(q, u).dtype == found[0].dtype == found[1].dtype == np.float32
    assert off(single.accelerations(q, u), expected[0]) < UDOT and off(found[0], expected[0]) < UDOT
    assert off(np.moveaxis(found[1], 0, 1), np.moveaxis(expected[1], 0, 1)) < DERIVATIVES
    for i in range(5):
        assert off(single.accelerations(q[i], u[i])[None], expected[0][i : i + 1]) < UDOT
        alone = single.sensitivities(q[i], u[i], **seeds)
        assert alone[1].dtype == np.float32 and off(alone[1][None], expected[1][None, :, i]) < DERIVATIVES


@pytest.mark.parametrize("name", QUICK)
def test_accelerations_and_derivatives_in_vectors(pair, monkeypatch, name):
    monkeypatch.setattr(batches, "WORTH_COMPILING", 1)
    single, double = pair(name)
    compare(single, double, 37, 1)
    assert single._target.batches._libraries["states"]


@pytest.mark.campaign
@pytest.mark.parametrize("name", [name for name in MODELS if name != SLENDER])
def test_thousand_random_states(pair, monkeypatch, name):
    for worth in (1, 10**9):  # in vectors over states, and one state after the other
        monkeypatch.setattr(batches, "WORTH_COMPILING", worth)
        compare(*pair(name), 1000, 2)


@pytest.mark.campaign
def test_errors_stay_below_the_condition_of_the_mass_matrix(pair):
    """Of the matrix with ones on its diagonal; one state in five hundred is beyond `UDOT`."""
    single, double = pair(SLENDER)
    for seed in range(10):
        q, u, _ = states(double, 1000, seed)
        M, udot = double.mass_matrix(q.astype(float)), double.accelerations(q.astype(float), u.astype(float))
        size = np.sqrt(np.einsum("...ii->...i", M))
        condition = np.linalg.cond(M / (size[:, :, None] * size[:, None, :]))
        error = np.abs(single.accelerations(q, u) - udot).max(axis=1) / np.abs(udot).max(axis=1)
        assert (error < 1e-5 + 2.0**-23 * condition).all()
        assert np.mean(error > UDOT) < 0.01 and error.max() < 5e-4


def arrays_of(value: Any) -> list[Any]:
    """All arrays in a result."""
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, (tuple, list)):
        return [x for v in value for x in arrays_of(v)]
    names = [*getattr(type(value), "__slots__", ()), *getattr(value, "__dict__", {})]
    return [x for n in names for x in arrays_of(getattr(value, n))]


MEMBERS = (
    "accelerations", "sensitivities", "jacobians", "coordinate_rates", "coordinate_rate_sensitivities", "energies",
    "energy_sensitivities", "outputs", "output_sensitivities", "closure", "closure_sensitivities", "mass_matrix",
    "inverse_mass_matrix", "bias_force", "bias_force_sensitivities", "inverse_dynamics", "solve_mass", "reactions",
    "reaction_sensitivities", "frames", "frame_sensitivities", "points", "assemble", "assemble_sensitivities", "gradients",
    "output_gradients", "energy_gradients", "condition",
)  # fmt: skip


@pytest.mark.parametrize("count", [None, 3])
@pytest.mark.parametrize("name", EVERY_MEMBER)
def test_members_return_the_scalar_type_and_the_same_numbers(pair, name, count):
    single, double = pair(name)
    q, u, seeds = states(double, count or 1, 3)
    if count is None:
        q, u = q[0], u[0]
    rng = np.random.default_rng(4)
    more = {
        "inverse_dynamics": (u, u),
        "solve_mass": (u,),
        "mass_matrix": (),
        "inverse_mass_matrix": (),
        "condition": (),
    }
    weights = {"gradients": double.nu, "output_gradients": double.noutputs, "energy_gradients": 2}
    for member in MEMBERS:
        given = (q, *more.get(member, (u,)))
        named = dict(seeds) if member.endswith("sensitivities") else {}
        if member in weights:
            named = {"weights": rng.normal(size=weights[member])}
        try:
            expected = getattr(double, member)(*given, **named)
        except AttributeError:  # of trees, or of loops, only
            continue
        found = arrays_of(getattr(single, member)(*given, **named))
        assert len(found) == len(arrays_of(expected)) > 0
        for a, b in zip(found, arrays_of(expected), strict=True):
            assert a.dtype == np.float32 or a.dtype.kind != "f", member
            assert np.array_equal(np.isnan(a), np.isnan(b)), member
            a, b = np.nan_to_num(a), np.nan_to_num(b)
            assert np.abs(a - b).max(initial=0.0) <= 1e-4 * max(np.abs(b).max(initial=0.0), 1e-2), member


def test_arguments_in_double_precision_and_results_in_place(pair):
    single, double = pair("four_bar")
    q, u, _ = states(double, 2, 5)
    out = np.empty(single.nu, np.float32)
    assert single.accelerations(q[0], u[0], out=out) is out
    assert np.array_equal(single.accelerations(q[0].astype(float), u[0].astype(float)), out)
    with pytest.raises(ValueError, match=r"holds float64 and has shape .* array of float32"):
        single.accelerations(q[0], u[0], out=np.empty(single.nu))
    with pytest.raises(ValueError, match=r"q\[0\].* is inf"):
        single.accelerations(np.full(single.nq, 1e300), u[0])


def test_motions_and_fine_tolerances_are_refused(pair):
    single, _ = pair("four_bar")
    wanted = codegen.runtime.Final(single.output_names[0])
    for call in (lambda: single.simulate(1.0), lambda: single.judge(1.0, [wanted])):
        with pytest.raises((AttributeError, ValueError), match=r"--scalar float32: it evaluates .* --scalar float64"):
            call()
    with pytest.raises(ValueError, match=r"equilibrium: tolerance is 1e-12.*rounded to 1.2e-07.*use 1.2e-06 or more"):
        single.equilibrium(tolerance=1e-12)
    with pytest.raises(UnknownFunctionError, match=r"double precision.* leave out simulate"):
        codegen.pipeline.write_solver(load_model(EXAMPLES / "arm.yaml"), functions=["simulate"], scalar="float32")
    with pytest.raises(ValueError, match="only the C target supports"):
        codegen.generate(EXAMPLES / "arm.yaml", target="numpy", scalar="float32")
    with pytest.raises(ValueError, match="allowed are float64, float32"):
        codegen.generate(EXAMPLES / "arm.yaml", scalar="half")


def test_python_and_the_command_line_know_every_scalar_type_of_the_target(capsys):
    assert all(C_TYPES[np.dtype(s.name).char] == s.word for s in C.scalars)
    with pytest.raises(SystemExit):
        generate_main(["--help"])
    assert f"[--scalar {{{','.join(s.name for s in C.scalars)}}}]" in capsys.readouterr().out


def test_the_command_line_says_which_options_go_together(capsys):
    assert generate_main([str(EXAMPLES / "arm.yaml"), "--scalar", "float32", "--target", "both"]) == 2
    assert "--scalar float32 needs --target c" in capsys.readouterr().err


def test_diagnose_knows_the_unit_of_rounding(pair):
    single, double = pair("arm")
    q, u, _ = states(double, 1, 6)
    found, exact = single.diagnose(q[0], u[0]), double.diagnose(q[0].astype(float), u[0].astype(float))
    assert found.digits.max() < 7.3 and 0.3 < found.udot_error.max() / exact.udot_error.max() / 2.0**29 < 3.0
    error = np.abs(single.accelerations(q[0], u[0]) - exact.udot)
    assert (error < 30 * found.udot_error).all() and error.max() > found.udot_error.max() / 1000


def test_a_package_is_opened_by_itself_by_both_targets_and_from_a_pickle(pair):
    single, double = pair("four_bar")
    q, u, _ = states(double, 2, 7)
    for again in (
        pickle.loads(pickle.dumps(single)),
        codegen.load(single.folder, "numpy"),
        codegen.load(single.folder, "both"),
    ):
        assert off(again.accelerations(q, u), double.accelerations(q, u)) < UDOT
        assert again.accelerations(q, u).dtype == again.assemble(q, u)[0].dtype == np.float32
    program = (
        "from float32 import Solver; s = Solver(); q, u = s.initial\n"
        "print(s.accelerations(q, u).dtype, q.dtype, s.assemble(q, u)[0].dtype)\n"
        "try: s.simulate(1.0)\nexcept AttributeError as error: print(error)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=single.folder.parent, capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("float32 float32 float32\n") and "--scalar float32" in done.stdout


SLIDING = """
model: sliding
parameters: {{m: 1.0}}
inputs: [push]
bodies:
  a: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: m}}
forces:
  drive: {{type: joint, joint: a, value: push*{factor} - q.a}}
"""


def test_numbers_that_the_type_cannot_hold_are_errors_with_their_place():
    for factor in ("1e300", "1e-60"):
        model = parse_model(SLIDING.format(factor=factor))
        with pytest.raises(
            ModelError, match=r"sliding, forces.drive.*the number 1e[+-]\d+ is beyond float32.*other units.*target c"
        ):
            codegen.pipeline.write_solver(model, scalar="float32")
        codegen.pipeline.write_solver(model)
    model = parse_model(SLIDING.format(factor="1").replace("m: 1.0", "m: 1e-60"))
    with pytest.raises(ModelError, match=r"parameters.m: the number 1e-60 is beyond float32"):
        codegen.pipeline.write_solver(model, scalar="float32")


def test_a_function_that_a_target_lacks_is_an_error_with_model_and_place(monkeypatch):
    model = parse_model(SLIDING.format(factor="sinh(q.a)"))
    monkeypatch.setattr(type(C), "functions", {n: x for n, x in C.functions.items() if n != "sinh"}, raising=False)
    with pytest.raises(ModelError, match=r"sliding, forces.drive.*lacks the function sinh"):
        codegen.pipeline.write_solver(model)


def test_a_joint_without_inertia_is_singular_in_single_precision_too(tmp_path):
    text = SLIDING.format(factor="1").replace("m: 1.0", "m: 1.0, tiny: 1.0")
    text = text.replace("forces:", "  b: {parent: a, joint: {type: prismatic, axis: x}, mass: tiny}\nforces:")
    codegen.generate(parse_model(text), tmp_path / "s", scalar="float32")
    solver = codegen.load(tmp_path / "s")
    q = u = np.zeros(2, np.float32)
    with pytest.raises(SingularJointError):
        solver.accelerations(q, u, {"tiny": 0.0})
    assert np.isfinite(solver.accelerations(q, u, {"tiny": 1e-3})).all()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        solver.bad_states = "nan"
        found = solver.accelerations(np.zeros((2, 2), np.float32), u, {"tiny": np.array([0.0, 1.0])})
    assert np.isnan(found[0]).all() and np.isfinite(found[1]).all()
