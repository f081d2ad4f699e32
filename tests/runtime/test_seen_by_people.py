"""Results as people see them: printed tables, pictures in notebooks, texts of diagnoses and fits."""

import pickle
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.design.fit_result import Fit
from codegen.runtime.standalone.motion.functionals import Final

EXAMPLES = Path(__file__).parents[2] / "examples"

SPRUNG = """
model: sprung
gravity: [0, 0, -9.81]
parameters: {m: 3.0, k: 294.3, c: 0.5}
bodies:
  block: {parent: ground, joint: {type: prismatic, axis: z}, mass: m}
forces:
  spring: {type: joint, joint: block, value: -k*q.block - c*u.block}
initial: {q: {block: 0.3}}
outputs: {z: {value: q.block}}
"""


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sprung") / "sprung"
    codegen.generate(codegen.parse_model(SPRUNG), folder, check=False)
    return codegen.load(folder)


def test_results_print_in_few_lines(solver):
    judged = solver.judge(0.5, [Final("z"), Final("z")], wrt=("m", "k"))
    assert repr(judged).splitlines()[0].startswith("Judged: 2 values, gradients: ")
    assert f"by m {judged.gradients[0, 0]:.6g}, k {judged.gradients[0, 1]:.6g}" in repr(judged)
    modes = solver.linearize([-0.1], [0.0]).modes()
    assert f"{modes.frequencies[0]:.6g}" in repr(modes) and "array" not in repr(modes)
    operations = solver.operations
    assert isinstance(operations, dict) and "accelerations" in repr(operations)
    assert len(repr(operations)) < 6000 and repr(operations).splitlines()[0].split()[:2] == ["operations", "all"]
    total = sum(sum(of["per_call"].values()) for of in operations["accelerations"].values() if "per_call" in of)
    row = next(line for line in repr(operations).splitlines() if line.startswith("accelerations "))
    assert int(row.split()[1]) == total


def test_pictures_show_themselves(solver):
    pytest.importorskip("matplotlib")
    figure = solver.simulate(0.5).plot()
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert pickle.loads(pickle.dumps(figure))._repr_png_()[:4] == b"\x89PNG"


def test_where_weight_and_spring_cancel_digits_are_those_of_the_forces(solver):
    rest = solver.equilibrium().q
    for q in (rest, np.nextafter(rest, 1.0), rest + 1e-15):
        diagnosis = solver.diagnose(q, [0.0])
        assert abs(diagnosis.udot[0]) < 1e-12
        assert diagnosis.digits[0] > 14 or "forces that cancel" in repr(diagnosis)
    assert 1.0 < solver.diagnose(rest, [0.0]).at_work[0] < 100.0  # m/s^2


def test_a_fit_that_does_not_fit_says_so(solver):
    t = np.linspace(0.1, 1.0, 12)
    samples = {"z": 5.0 + 0.0 * t}  # where the block never is
    found = codegen.fit(solver, t, samples, {"c": (0.4, 0.6)}, sigma=1e-4)
    assert isinstance(found, Fit) and found.variance > 100
    assert "times as large as sigma" in repr(found) and "or the search ended in a local minimum: start from" in repr(
        found
    )
    with pytest.raises(
        ValueError, match=r"start is {'c': 0\.5}, expected the start of the motion, s; the search starts from"
    ):
        codegen.fit(solver, t, samples, ["c"], start={"c": 0.5})
    good = codegen.fit(solver, t, {"z": solver.simulate(np.r_[0.0, t], p={"c": 0.45})["z"][1:]}, ["c"], sigma=1e-4)
    assert repr(good).startswith("1 variable from 12 samples, ")
    assert "as large as sigma" not in repr(good) and "made no progress" not in repr(good)


def test_a_line_search_without_a_lower_value_is_explained(solver, monkeypatch):
    objective = codegen.objective(solver, 0.5, [Final("z")], {"c": (0.1, 2.0)})

    def stuck(function, start, **options):
        from scipy.optimize import OptimizeResult

        return OptimizeResult(x=start, fun=function(start)[0], success=False, message="ABNORMAL: ")

    monkeypatch.setattr("scipy.optimize.minimize", stuck)
    result = codegen.optimize(objective)
    assert "the line search finds no lower value along a gradient of" in result.message
    assert "x0=result.x" in result.message


def test_states_of_a_tree_need_no_functions(tmp_path):
    model = codegen.load_model(EXAMPLES / "pendulum.yaml")
    codegen.generate(model, tmp_path / "pendulum", functions=["states", "dynamics"], check=False)
    solver = codegen.load(tmp_path / "pendulum")
    q, u = solver.assemble(*solver.initial)
    assert np.isfinite(solver.accelerations(q, u)).all()


@pytest.mark.parametrize(
    "error",
    [
        codegen.runtime.SingularJointError("ball.1", " (state [3] of the batch)"),
        codegen.runtime.SingularLoopError("pin", coupled=True),
        codegen.runtime.SingularForceError("spring", "its ends coincide"),
        codegen.runtime.SingularOutputError("distance"),
        codegen.runtime.AssemblyError("pin", 0.1, tolerance=1e-5),
        codegen.runtime.EquilibriumError(2.0, "crank", np.array([1.0, 2.0])),
        codegen.runtime.SimulationError("the motion ends", None),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_that_a_pool_of_processes_returns_are_those_that_were_raised(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert {n: np.asarray(x).tolist() for n, x in vars(again).items()} == {
        n: np.asarray(x).tolist() for n, x in vars(error).items()
    }
