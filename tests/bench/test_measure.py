"""The tools of all measurements: turns and rounds, C contestants against the generic engine, and the scripts in benchmarks/."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from codegen.measure import accuracy, clock, models, operations, tables
from codegen.measure.compiled import Functions, Workshop
from codegen.reference import RecursiveEngine

SCRIPTS = sorted(p.stem for p in (Path(__file__).parents[2] / "benchmarks").glob("*.py"))
NEEDED = ("casadi", "pinocchio", "mujoco", "jax")


def test_repetitions_fill_a_batch_and_are_warmed_up():
    asked = []

    def run(n):
        asked.append(n)
        return n * 1e-4

    timed = clock.repeated(run, batch=1e-2, warm_up=True)
    asked.clear()
    assert timed() == pytest.approx(1e-4) and asked == [26, 100]


def test_rounds_keep_the_least_of_their_turns_and_compare_at_the_same_moments():
    seconds = iter([3.0, 30.0, 2.0, 40.0, 6.0, 60.0, 8.0, 50.0])
    found = clock.in_rounds({"a": lambda: next(seconds), "b": lambda: next(seconds)}, rounds=2, batches=2)
    assert found["a"].seconds == [2.0, 6.0] and found["b"].seconds == [30.0, 50.0]
    assert found["a"].median == 4.0 and found["a"].least == 2.0
    assert found["b"].ratio(found["a"]) == pytest.approx((15 + 50 / 6) / 2)


@pytest.fixture(scope="module")
def chain(tmp_path_factory):
    """CHAIN(3): its functions, the engine's results along two directions, and a workshop for compilation."""
    m = models.sized("CHAIN", 3)
    dq, du, dp = models.seeds(3, 2)
    exact = RecursiveEngine(m.model).sensitivities(m.q, m.u, dq=dq, du=du, dp=dp)
    return m, Functions.of(m.source(functions=("accelerations", "sensitivities", "gradients"))), exact, Workshop(
        tmp_path_factory.mktemp("compiled"), flags=()
    )  # fmt: skip


def test_contestants_compute_what_the_engine_does(chain):
    m, functions, (udot, dudot), shop = chain
    one = shop.evaluated(functions.contestant("accelerations", m.given(), levels=("-O0",)))
    assert accuracy.relative(one["udot"], udot) < 1e-13
    along = shop.evaluated(functions.contestant("sensitivities", m.given(2), 2, levels=("-O0",)))
    assert max(accuracy.by_direction(along["dudot"].T, dudot)) < 1e-12
    weights = np.array([[0.3, -0.2, 0.7]])
    back = shop.evaluated(
        functions.contestant("sensitivities_transposed", m.given() | {"dudot": weights}, 1, levels=("-O0",))
    )
    seeds = models.seeds(3, 1)
    forward = float(weights[0] @ np.asarray(dudot[0], float))
    backward = sum(float(back[n].ravel() @ x[0]) for n, x in zip(("dq", "du", "dp"), seeds, strict=True))
    assert backward == pytest.approx(forward, rel=1e-12)


def test_contestants_compete_at_their_best_level_and_are_kept(chain, monkeypatch):
    m, functions, _, shop = chain
    contestants = [functions.contestant("accelerations", m.given(), name=n, levels=("-O0", "-O1")) for n in ("a", "b")]
    found = shop.compete(contestants, rounds=2, batches=1, batch=1e-4)
    for x in found.values():
        assert x.level in ("-O0", "-O1") and x.median == min(level.median for level in x.levels.values()) > 0
    monkeypatch.setattr(type(shop), "_run", lambda *_: pytest.fail("compiled again"))
    assert shop.compiled(contestants[0], "-O0").seconds() > 0.0


def test_errors_of_what_vanishes_are_absolute_and_lengths_are_checked():
    assert accuracy.relative([1.0, 2.5], [1.0, 2.0]) == 0.25
    assert accuracy.relative([1e-9], [0.0]) == 1e-9
    assert accuracy.relative([1.5], [1.0], size=10.0) == 0.05
    with pytest.raises(ValueError, match="2 numbers are compared with 1"):
        accuracy.relative([1.0, 2.0], [1.0])


def test_counts_are_those_of_all_sweeps():
    counts = {
        "out": {"per_call": {"additions": 2, "divisions": 1}},
        "in": {"per_call": {"additions": 3, "multiplications": 4}},
    }
    assert operations.total(counts) == {"additions": 5, "multiplications": 4, "divisions": 1, "functions": 0}
    assert operations.plain(operations.total(counts, among=("in",))) == 7


@pytest.mark.parametrize(
    ("seconds", "text"), [(2.31e-7, "231 ns"), (4.56e-6, "4.56 us"), (1.2e-3, "1.2 ms"), (3.0, "3 s")]
)
def test_times_have_a_unit_that_suits_them(seconds, text):
    assert tables.seconds(seconds) == text


@pytest.mark.parametrize("name", models.SIZES)
def test_models_of_any_size_are_read_in_a_state_that_is_closed(name):
    m = models.sized(name, 8)
    assert m.bodies == {"LADDER": 17, "HOOKE": 17}.get(name, 8)
    assert len(m.q) == m.model.nq and len(m.u) == m.model.nu


@pytest.mark.parametrize("name", SCRIPTS)
def test_scripts_can_be_read(name, monkeypatch):
    """What a script imports is there; its run is for people."""
    folder = Path(__file__).parents[2] / "benchmarks"
    monkeypatch.syspath_prepend(str(folder))
    spec = importlib.util.spec_from_file_location(f"benchmark_{name}", folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    try:
        spec.loader.exec_module(module)
    except ModuleNotFoundError as error:
        if error.name not in NEEDED:
            raise
        pytest.skip(f"{name} needs {error.name}, which is an extra")
    assert callable(getattr(module, "main", None)) or name == "pinocchio_builds"
