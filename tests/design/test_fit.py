"""Identification against linear regression, closed forms, and samples with known noise."""

import numpy as np
import pytest
from oscillator import FREE, oscillator, swing

import codegen
from codegen.runtime import Event, SimulationError


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    return oscillator(tmp_path_factory.mktemp("fit"))


@pytest.mark.parametrize("given", [True, False])
def test_a_free_block_is_the_regression_of_a_line(solver, given):
    """x = x0 + v0 t is linear: values and covariance are those of linear regression."""
    rng = np.random.default_rng(7)
    t = np.linspace(0.5, 3.0, 26)
    x = 0.3 - 0.2 * t + 0.05 * rng.normal(size=26)
    x[4] = np.nan
    known = np.isfinite(x)
    sigma = np.linspace(0.03, 0.08, 26)
    found = codegen.fit(
        solver, t, {"x": x}, ["q0.block", "u0.block"], p=FREE, u={"block": -1.0}, sigma={"x": sigma} if given else None
    )
    weight = 1 / sigma[known] if given else np.ones(25)
    A = np.column_stack([np.ones(25), t[known]]) * weight[:, None]
    best, squares, _, _ = np.linalg.lstsq(A, x[known] * weight)
    covariance = np.linalg.inv(A.T @ A) * (1 if given else squares[0] / 23)
    assert found.values == pytest.approx(best, abs=1e-9)
    assert found.covariance == pytest.approx(covariance, rel=1e-7)
    assert found.deviations == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-7)
    assert found.sum_of_squares == pytest.approx(squares[0], rel=1e-8) and found.freedom == 23
    assert found.correlations[0, 1] == pytest.approx(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]))
    low, high = found.interval("u0.block")
    half = (1.959964 if given else 2.068658) * np.sqrt(covariance[1, 1])
    assert [low, high] == pytest.approx([best[1] - half, best[1] + half], rel=1e-5)
    residuals = found.residuals[0]["x"]
    assert np.isnan(residuals[4])
    assert residuals[known] == pytest.approx(best[0] + best[1] * t[known] - x[known], abs=1e-8)


def test_mass_and_spring_are_found_with_the_covariance_of_the_closed_form(solver):
    rng = np.random.default_rng(3)
    t = np.linspace(0, 5, 101)
    truth = {"stiffness": 8.4, "start": 0.53}
    x = swing(t, **truth)[0] + 0.01 * rng.normal(size=101)
    found = codegen.fit(solver, t, {"x": x}, {"stiffness": (5, 12), "start": None}, sigma=0.01)
    J = np.column_stack([swing(t, **found.as_dict())[1][n] for n in found.names]) / 0.01
    assert found.covariance == pytest.approx(np.linalg.inv(J.T @ J), rel=1e-6)
    assert found.success and 0.7 < found.variance < 1.3
    for name, value in truth.items():
        assert abs(found[name] - value) < 3 * found.deviation(name)
    again = codegen.fit(solver, t, {"q.block": x}, ["stiffness", "start"], sigma=0.01)
    assert again.values == pytest.approx(found.values, rel=1e-7), "a coordinate is a series as well as an output"
    assert "+-" in repr(found) and "stiffness" in repr(found) and "101 samples" in repr(found)


def test_deviations_are_those_of_repeated_experiments(solver):
    """Over 60 draws the errors, in their standard deviations, have squares of mean 1 (within 4 deviations of that mean)."""
    t = np.linspace(0, 4, 41)
    errors = []
    for seed in range(60):
        x = swing(t)[0] + 0.02 * np.random.default_rng(seed).normal(size=41)
        found = codegen.fit(solver, t, {"x": x}, ["stiffness", "start"])
        errors.append((found.values - [8.0, 0.5]) / found.deviations)
    assert np.mean(np.square(errors), axis=0) == pytest.approx([1, 1], abs=4 * np.sqrt(2 / 60) * 1.1)


def test_what_samples_do_not_determine_is_named(solver):
    """Mass and stiffness in proportion, and a damping that is not among the unknown, move the block alike."""
    t = np.linspace(0, 5, 101)
    x = swing(t, stiffness=8.2)[0]
    found = codegen.fit(solver, t, {"x": x}, ["mass", "stiffness", "start"])
    (direction,) = found.undetermined
    assert set(direction) == {"mass", "stiffness"}
    assert direction["stiffness"] / direction["mass"] == pytest.approx(8.2 / 2, rel=1e-6)
    assert np.isinf([found.deviation("mass"), found.deviation("stiffness")]).all()
    assert np.isfinite(found.deviation("start")) and found["stiffness"] / found["mass"] == pytest.approx(4.1)
    assert "not determined" in repr(found) and found.freedom == 99
    nothing = codegen.fit(solver, t, {"x": x}, {"cubic": None, "stiffness": None}, p={"start": 0.0, "stiffness": 4.0})
    assert nothing.freedom == 101 and len(nothing.undetermined) == 2, "a block that rests tells nothing"


def test_a_variable_at_its_bound_counts_as_given(solver):
    t = np.linspace(0, 5, 101)
    found = codegen.fit(solver, t, {"x": swing(t)[0]}, {"stiffness": codegen.Variable(5, 7.9, start=6), "start": None})
    assert found.at_bounds == {"stiffness": "upper"} and np.isnan(found.deviation("stiffness"))
    assert np.isfinite(found.deviation("start")) and "at its upper bound" in repr(found)


def test_experiments_share_variables_and_have_their_own(solver):
    rng = np.random.default_rng(5)
    t = np.linspace(0, 3, 61)
    first = swing(t, start=0.4)[0] + 0.01 * rng.normal(size=61)
    second = swing(t[:31], start=-0.7)[0] + 0.02 * rng.normal(size=31)
    own = {"q0.block": (-2, 2)}
    found = codegen.fit(
        solver,
        variables=["stiffness"],
        experiments=[
            {"times": t, "samples": {"x": first}, "sigma": 0.01, "variables": own, "name": "push"},
            {"times": t[:31], "samples": {"x": second}, "sigma": 0.02, "variables": own, "name": "pull"},
        ],
    )
    assert found.names == ("stiffness", "q0.block (push)", "q0.block (pull)")
    assert np.all(np.abs(found.values - [8.0, 0.4, -0.7]) < 3 * found.deviations)
    (_, by1), (x2, by2) = swing(t, 2.0, *found.values[:2]), swing(t[:31], 2.0, found.values[0], found.values[2])
    J = np.zeros((92, 3))
    J[:61, 0], J[:61, 1] = by1["stiffness"] / 0.01, by1["start"] / 0.01
    J[61:, 0], J[61:, 2] = by2["stiffness"] / 0.02, by2["start"] / 0.02
    assert found.covariance == pytest.approx(np.linalg.inv(J.T @ J), rel=1e-6, abs=1e-12)
    assert len(found.trajectories) == 2 and found.residuals[1]["x"] == pytest.approx(x2 - second, abs=1e-8)


def test_motions_that_fail_on_the_way_are_stepped_back_from(solver):
    """The first step towards the strong cubic force leads beyond what holds for the time."""
    t = np.linspace(0, 2, 21)
    x = solver.simulate(t, p={"cubic": 30.0})["x"]
    found = codegen.fit(solver, t, {"x": x}, {"cubic": codegen.Variable(0, 300, start=1.0)}, most_steps=2000)
    assert found["cubic"] == pytest.approx(30.0, rel=1e-6)
    with pytest.raises(SimulationError):
        codegen.fit(solver, t, {"x": x}, {"cubic": codegen.Variable(0, 300, start=299.0)}, most_steps=2000)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0, 1, 2], {"y": [0, 0, 0]}, ["mass"]), "samples of 'y', which the model does not have; allowed are x, v"),
        (([0, 1, 2], {"x": [0, 0]}, ["mass"]), r"shape \(2,\), expected \(3,\)"),
        (([0, 1, 2], {"x": [0, 0, np.inf]}, ["mass"]), "NaN marks a missing sample"),
        (([0, 2, 1], {"x": [0, 0, 0]}, ["mass"]), "increasing"),
        (([-1, 2, 3], {"x": [0, 0, 0]}, ["mass"]), "after its first sample at -1 s"),
        (([0, 1, 2], None, ["mass"]), "no times or no samples"),
        (([1.0], {"x": [0.0]}, ["mass", "stiffness"]), "1 sample cannot determine 2 variables; give more samples or"),
        (([1.0], {"x": [np.nan]}, ["mass"]), "0 samples cannot determine 1 variable; all samples are NaN"),
        (([0, 1, 2], {"x": [0, 0, 0]}, ["masss"]), "did you mean 'mass'"),
    ],
)
def test_what_is_wrong_is_told(solver, arguments, message):
    with pytest.raises(ValueError, match=message):
        codegen.fit(solver, *arguments)


def test_what_is_wrong_with_sigma_or_an_experiment_is_told(solver):
    t, samples = [0.0, 1.0, 2.0], {"x": [0.0, 0.0, 0.0]}
    with pytest.raises(ValueError, match="must be positive"):
        codegen.fit(solver, t, samples, ["mass"], sigma=0.0)
    with pytest.raises(ValueError, match="has no entry for x"):
        codegen.fit(solver, t, samples, ["mass"], sigma={"v": 1.0})
    with pytest.raises(ValueError, match="allowed are times, samples"):
        codegen.fit(solver, variables=["mass"], experiments=[{"time": t, "samples": samples}])
    with pytest.raises(ValueError, match="experiment 2 has no sigma, but others have"):
        both = [{"times": t, "samples": samples, "sigma": 0.1}, {"times": t, "samples": samples}]
        codegen.fit(solver, variables=["mass"], experiments=both)
    with pytest.raises(ValueError, match="put them into the experiments"):
        codegen.fit(solver, t, samples, ["mass"], experiments=[{"times": t, "samples": samples}])


def test_what_would_be_ignored_is_refused(solver):
    t = np.array([1.0, 2.0])
    one = {"times": t, "samples": {"x": t}, "variables": ["q0.block"], "name": "a"}
    for arguments, message in (
        ({"sigma": {"x": 1.0, "speed": 2.0}}, "sigma of 'speed', which the model does not have"),
        ({"undetermined": 2.0}, "expected a number between 0 and 1"),
        ({"on_failure": "return"}, "fit does not take on_failure"),
        ({"times": None, "samples": None, "experiments": [one, one]}, "two experiments have the name a"),
        ({"times": None, "samples": None, "experiments": one}, "experiments must be a list of mappings"),
    ):
        with pytest.raises(ValueError, match=message):
            codegen.fit(solver, **{"times": t, "samples": {"x": t}, "variables": ["mass"]} | arguments)


def test_a_motion_that_ends_before_the_last_sample_is_an_error(solver):
    t = np.linspace(0.1, 3.0, 8)
    with pytest.raises(SimulationError, match="before the last sample"):
        codegen.fit(solver, t, {"x": t}, ["mass"], q={"block": 1.0}, events=[Event("x", 0.5)])


def test_no_deviations_come_of_as_many_samples_as_variables(solver):
    found = codegen.fit(solver, [1.0], {"x": [0.5]}, ["q0.block"], p=FREE)
    assert found.freedom == 0 and np.isnan(found.deviations).all()
    assert "not more samples than variables" in repr(found) and "nan" not in repr(found)
