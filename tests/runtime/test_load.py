"""Opening packages: their location, packages that are written again, and packages of other versions."""

import gc
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.runtime import CompileError, PackageError, Solver
from codegen.runtime.standalone.files.build import Build
from codegen.runtime.standalone.files.manifest import file_digest, seal

FOUR_BAR = Path(__file__).parents[2] / "examples" / "four_bar.yaml"

MODEL = """\
model: pendulum
gravity: [0, 0, -9.81]
parameters: {length: 1.0}
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    mass: 2
    com: [0, 0, -length/2]
    inertia: {xx: 1, yy: 1, zz: 1}
"""


def test_a_folder_without_package_is_told(tmp_path):
    with pytest.raises(ValueError, match=r"contains no complete generated solver.*generate MODEL\.yaml"):
        codegen.load(tmp_path)
    with pytest.raises(ValueError, match="contains no complete generated solver: there is no such folder"):
        codegen.load(tmp_path / "missing")
    with pytest.raises(
        PackageError, match="this is a text of several lines; the folder of a generated package is needed"
    ):
        codegen.load(MODEL)
    with pytest.raises(TypeError, match=r"^a Model is given; the folder of a generated package is needed"):
        codegen.load(codegen.parse_model(MODEL))
    with pytest.raises(TypeError, match=r"^an int is given; the file of a trajectory is needed"):
        codegen.load_trajectory(3)


def test_a_model_file_in_place_of_a_package_is_told(tmp_path):
    for name, message in (
        ("rod.yaml", r"a model file, and a solver is a folder; create one with: generate rod\.yaml -o FOLDER"),
        ("rod.txt", r"it is a file; create one with: generate MODEL\.yaml"),
    ):
        (tmp_path / name).write_text("model: rod\n")
        with pytest.raises(PackageError, match=message):
            codegen.load(tmp_path / name)


def test_a_package_written_anew_is_read_anew(tmp_path):
    folder = tmp_path / "pendulum"
    results = []
    for mass in (2, 3):
        codegen.generate(codegen.model.parse_model(MODEL.replace("mass: 2", f"mass: {mass}")), folder, compile=False)
        for target in ("c", "numpy"):
            results.append(codegen.load(folder, target).mass_matrix([0.0])[0, 0])
    np.testing.assert_allclose(results, [1.5, 1.5, 1.75, 1.75])


def test_a_package_is_importable_by_name(tmp_path):
    codegen.generate(codegen.model.parse_model(MODEL), tmp_path / "pendulum")
    program = (
        "from pendulum import Solver, CompileError; print(Solver('numpy').mass_matrix([0.0])[0, 0], Solver().target)"
    )
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["1.5", "c"]


@pytest.mark.parametrize("sealed", [True, False])
def test_a_package_of_another_version_runs_itself(tmp_path, sealed):
    folder = tmp_path / "pendulum"
    codegen.generate(codegen.model.parse_model(MODEL), folder)
    assert type(codegen.load(folder)) is Solver
    brought = folder / "_runtime" / "calls" / "package.py"
    brought.write_text(brought.read_text() + "\nVERSION_OF_THE_TEST = 1\n")
    with pytest.raises(PackageError, match=r"_runtime/calls/package\.py was changed"):
        codegen.load(folder)
    manifest = json.loads((folder / "model.json").read_text())
    del manifest["seal"]
    if not sealed:
        (folder / "model.json").write_text(json.dumps(manifest))
        with pytest.raises(ValueError, match="damaged") as told:
            codegen.load(folder)  # by its own run time, which knows seals
        assert not isinstance(told.value, PackageError)
        return
    manifest["digests"]["_runtime/calls/package.py"] = file_digest(brought.read_bytes())
    (folder / "model.json").write_text(seal(json.dumps(manifest)))
    solver = codegen.load(folder)
    assert not isinstance(solver, Solver)
    assert type(solver) is type(codegen.load(folder))
    assert solver.mass_matrix([0.0])[0, 0] == pytest.approx(1.5)


ONE_FILE = """\
class Solver:
    def __init__(self, folder, target=None):
        self.folder, self.target = folder, target or "c"
"""


@pytest.mark.parametrize("sealed", [True, False])
def test_a_package_whose_run_time_is_one_file_runs_itself(tmp_path, sealed):
    """Packages of earlier versions have ``_runtime.py``."""
    folder = tmp_path / "pendulum"
    files = {
        "__init__.py": "from pathlib import Path\nfrom . import _runtime\n\n\nclass Solver(_runtime.Solver):\n"
        "    def __init__(self, target=None):\n        super().__init__(Path(__file__).parent, target)\n",
        "_runtime.py": ONE_FILE,
    }
    manifest = {"generator": "ordernm", "name": "pendulum", "files": [*files, "model.json"]}
    manifest["digests"] = {name: file_digest(text.encode()) for name, text in files.items()}
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_text(text)
    (folder / "model.json").write_text(seal(json.dumps(manifest)) if sealed else json.dumps(manifest))
    solver = codegen.load(folder, "numpy")
    assert (solver.folder, solver.target) == (folder, "numpy") and not isinstance(solver, Solver)
    (folder / "_runtime.py").write_text(ONE_FILE.replace('"c"', '"numpy"'))
    if sealed:
        with pytest.raises(PackageError, match=r"its _runtime\.py was changed"):
            codegen.load(folder)
    else:
        assert codegen.load(folder).target == "numpy"
    # regenerating takes it for its own, and leaves nothing of it
    codegen.generate(codegen.model.parse_model(MODEL), folder)
    assert not (folder / "_runtime.py").exists() and (folder / "_runtime" / "calls" / "package.py").exists()
    assert type(codegen.load(folder)) is Solver


def test_a_package_may_be_moved(tmp_path):
    codegen.generate(codegen.model.parse_model(MODEL), tmp_path / "pendulum")
    os.rename(tmp_path / "pendulum", tmp_path / "elsewhere")
    solver = codegen.load(tmp_path / "elsewhere")
    assert solver.mass_matrix([0.0])[0, 0] == pytest.approx(1.5)
    assert len(list((tmp_path / "elsewhere").glob("*.dynamics-*.so"))) == 1


def test_of_further_partitions_what_motions_call_is_compiled_at_first(tmp_path):
    folder = tmp_path / "four_bar"
    codegen.generate(FOUR_BAR, folder, partitions=2, check=False)

    def compiled():
        return sorted(p.name.split("-")[0] for p in folder.glob("four_bar*.so"))

    assert compiled() == ["four_bar.dynamics", "four_bar_second.motion"]
    solver = codegen.load(folder)
    assert np.isfinite(solver.condition(solver.initial[0])).all()  # of both
    assert len(compiled()) == 2
    q, u = solver.assemble(u={"crank": 0.5})
    udot = solver.accelerations(q, u)
    solver.use_partition(1)
    np.testing.assert_allclose(solver.accelerations(q, u), udot, rtol=1e-12, atol=1e-12)
    assert compiled() == ["four_bar.dynamics", "four_bar_second.dynamics", "four_bar_second.motion"]


def test_a_model_that_cannot_move_is_refused():
    text = MODEL.replace("{type: revolute, axis: y}", "{type: fixed}")
    with pytest.raises(codegen.ModelError, match="nothing can move"):
        codegen.parse_model(text)


def test_one_and_two_directions_are_compiled_when_they_are_called(tmp_path):
    """Half of what gcc would do at first; beside eight others, in threads, and in batches they are the same functions."""
    codegen.generate(FOUR_BAR, tmp_path / "four_bar")
    solver = codegen.load(tmp_path / "four_bar", "c")
    expected = codegen.load(tmp_path / "four_bar", "numpy")
    (q, u), rng = solver.initial, np.random.default_rng(1)
    dp = rng.normal(size=(11, solver.np))

    def compiled():
        return {name.split(".")[1].split("-")[0] for name in os.listdir(tmp_path / "four_bar") if name.endswith(".so")}

    def check(k):
        for given in (q, np.tile(q, (3, 1))):
            for x, y in zip(
                solver.sensitivities(given, u, dp=dp[:k]), expected.sensitivities(given, u, dp=dp[:k]), strict=True
            ):
                assert x.shape == y.shape
                np.testing.assert_allclose(x, y, rtol=1e-10, atol=1e-12)

    for k in (0, 3, 8, 11):
        check(k)
    assert compiled() == {"dynamics"}
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(check, (1, 2, 9, 10, 1, 2, 9, 10)))
    assert compiled() == {"dynamics", "few"}
    assert codegen.load(tmp_path / "four_bar", "c").sensitivities(q, u, dp=dp[0])[1].shape == (1, solver.nu)


def test_a_solver_that_is_gone_takes_no_functions_along(tmp_path):
    """The first library of a package is one for all its solvers; each has its own functions over one and two directions."""
    codegen.generate(FOUR_BAR, tmp_path / "four_bar")
    first, second = (codegen.load(tmp_path / "four_bar", "c") for _ in range(2))
    q, u = first.initial
    expected = first.sensitivities(q, u, dp=np.ones(first.np))[1]
    del first
    gc.collect()
    np.testing.assert_array_equal(second.sensitivities(q, u, dp=np.ones(second.np))[1], expected)


@pytest.mark.parametrize("batch", [False, True])
def test_where_they_cannot_be_compiled_eight_directions_serve(tmp_path, monkeypatch, batch):
    codegen.generate(FOUR_BAR, tmp_path / "four_bar")
    solver, expected = (codegen.load(tmp_path / "four_bar", target) for target in ("c", "numpy"))
    (q, u), dp = solver.initial, np.random.default_rng(1).normal(size=(9, solver.np))
    q = np.tile(q, (3, 1)) if batch else q

    def fail(build, output, log_file):
        raise CompileError("the compiler is gone")

    monkeypatch.setattr(Build, "_compile", fail)
    with pytest.warns(
        RuntimeWarning, match="four_bar: one or two directions take as long as eight: the compiler is gone"
    ):
        solver.sensitivities(q, u, dp=dp[:1])
    for k in (1, 2, 9):
        for x, y in zip(solver.sensitivities(q, u, dp=dp[:k]), expected.sensitivities(q, u, dp=dp[:k]), strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-10, atol=1e-12)
