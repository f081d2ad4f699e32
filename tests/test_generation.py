"""`generate`: the files that it writes, the errors, and that a package is written completely or not at all."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen import generation
from codegen.generation import FolderError, check_solver, generate
from codegen.model import ModelError, parse_model
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.runtime import CompileError
from codegen.runtime.standalone.files.manifest import file_digest, seal

TEXT = """
model: rod
gravity: [0, 0, -9.81]
parameters: {length: {value: 1.0, unit: m}}
inputs: [motor]
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: cylinder, axis: z, length: length, radius: 0.02, density: 2700, center: [0, 0, -length/2]}
  bob:
    parent: rod
    joint: {type: spherical, at: [0, 0, -length]}
    shape: {type: sphere, radius: 0.1, mass: 1, center: [0, 0, -0.2]}
forces:
  drive: {type: joint, joint: rod, value: motor*sin(t) - 0.01*u.rod}
outputs:
  energy: kinetic_energy
"""
FILES = ["README.md", "__init__.py", "model.json", "rod.c", "rod.h", "rod_calls.c", "rod_directions.h", "rod_model.h",
         "rod_numpy.py"]  # fmt: skip
"""Beside the run time."""
LOOP = """
model: rod
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0.5, 0, 0]}
  b: {parent: a, joint: {type: revolute, axis: y, at: [1, 0, 0]}, mass: 1, com: [0.5, 0, 0]}
  c: {parent: ground, joint: {type: revolute, axis: y, at: [2, 0, 0]}, mass: 1, com: [0, 0, 0.5]}
loops:
  pin: {joint: {type: revolute, axis: y}, from: {body: b, at: [1, 0, 0]}, to: {body: c, at: [0, 0, 1]}}
initial:
  q: {a: -0.8, b: 0.6, c: 0.1}
"""


@pytest.fixture(scope="module")
def model():
    return parse_model(TEXT)


@pytest.fixture(scope="module")
def written(model, tmp_path_factory) -> Path:
    """A package without a compiled library; tests must not change it."""
    return generate(model, tmp_path_factory.mktemp("out") / "rod", compile=False).folder


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def neighbours(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.parent.iterdir())


def test_the_files_of_a_package(written):
    assert set(FILES) <= set(contents(written))
    manifest = json.loads((written / "model.json").read_text())
    assert manifest["generator"] == "ordernm" and manifest["name"] == "rod"
    assert manifest["coordinate_names"] == ["rod", "bob.qw", "bob.qx", "bob.qy", "bob.qz"]
    assert manifest["parameter_names"] == ["length"] and manifest["input_names"] == ["motor"]
    assert re.fullmatch("[0-9a-f]{64}", manifest["hash"])
    assert neighbours(written) == ["rod"]  # nothing of the making is left beside it
    assert not list(written.glob("*.so"))


def test_files_say_neither_when_nor_where(written):
    for name, content in contents(written).items():
        text = content.decode()
        assert str(written.parent) not in text and str(Path.cwd()) not in text, name
        assert os.uname().nodename not in text or len(os.uname().nodename) < 4, name
        assert not re.search(r"\b(19|20)\d\d-\d\d-\d\d\b|\b\d\d:\d\d:\d\d\b", text), name
        assert "\r" not in text and text.endswith("\n"), name


@pytest.mark.parametrize("seed", ["1", "4242"])
def test_same_bytes_under_other_hash_seeds_and_folders(written, tmp_path, seed):
    script = "import sys, codegen; from codegen.model import parse_model\n" \
             "codegen.generate(parse_model(sys.stdin.read()), sys.argv[1], compile=False)"  # fmt: skip
    place = tmp_path / f"other {seed}" / "package"
    environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(Path(codegen.__file__).parents[1])}
    subprocess.run(
        [sys.executable, "-c", script, place], input=TEXT, text=True, check=True, env=environment, cwd=tmp_path
    )
    assert contents(place) == contents(written)


def carried(folder: Path) -> set[str]:
    """Modules of the run time in a package, with their folders."""
    return modules(folder / "_runtime")


def modules(place: Path) -> set[str]:
    return {p.relative_to(place).with_suffix("").as_posix() for p in place.rglob("*.py")}


SHARED = {"elementary", "jumps", "html_tables", "wording"}
"""Modules of `codegen` that packages contain, too."""


def test_the_run_time_is_copied_as_it_is(written):
    """But for where it finds what it shares with the rest of ordernm."""
    own = Path(codegen.__file__).parent / "runtime" / "standalone"
    for name in carried(written) - {"solver"}:  # which has its sections only
        file = next(x for x in (own / f"{name}.py", own.parents[1] / f"{name}.py") if x.is_file())
        text = file.read_text()
        for shared in SHARED:
            text = text.replace(f"\nfrom ....{shared} import", f"\nfrom ..{shared} import")
        assert (written / "_runtime" / f"{name}.py").read_text() == text
    listed = json.loads((written / "model.json").read_text())["files"]
    texts = {f"_runtime/{n}.py" for n in carried(written)}
    of_c = {
        f"_runtime/calls/{n}" for n in ("calls.h", "direct_call.c", "direct_call.h", "direct_states.h", "on_threads.h")
    }
    assert {n for n in listed if n.startswith("_runtime/")} == texts | of_c
    for name in of_c:
        assert (written / name).read_text() == (own / name.removeprefix("_runtime/")).read_text()


def test_threads_are_carried_where_functions_run_on_them(tmp_path):
    codegen.generate(parse_model(TEXT), tmp_path / "rod", compile=False, check=False, functions=["energies"])
    assert not list((tmp_path / "rod").rglob("*on_threads*"))


OF_LOOPS = {
    "trust/exact_loops",
    "state/loop_forces",
    "assembly/loops",
    "assembly/assembly",
    "assembly/following",
    "assembly/newton",
    "assembly/open_states",
    "assembly/starting",
}
LATE = {
    "trajectory/files", "trajectory/html", "trajectory/plot", "trajectory/table", "files/whole_file", "calls/formulas",
    "state/negative_masses",
}  # fmt: skip
"""Imported by functions that use them."""
OPTIONAL = OF_LOOPS | {"state/reactions", "assembly/redundancy"}


def test_a_package_carries_the_run_time_that_it_uses_only(written, tmp_path):
    """And without rests of what stood there before."""
    everything = modules(Path(codegen.__file__).parent / "runtime" / "standalone")
    of_views = {m for m in everything if m.startswith("display/")}
    assert everything - carried(written) == of_views | OF_LOOPS | {
        "state/reactions",
        "assembly/redundancy",
        "state/frames",
        "state/frame_motion",
        "state/hessians",
        "statics/curvature",
        "motion/kinks",
        "motion/prescribed_branches",
        "trust/single_precision",
    }
    folder = tmp_path / "rod"
    loop = parse_model(LOOP)
    # a parameter that moves a pin along its axis opens a redundant condition
    opening = parse_model(
        LOOP.replace("[1, 0, 0]}, to", "[1, off, 0]}, to").replace("bodies:", "parameters: {off: 0}\nbodies:")
    )
    reactions = "state/reactions"
    for model, options, expected in (
        (loop, {}, OF_LOOPS), (opening, {"reactions": True}, {*OF_LOOPS, reactions, "assembly/redundancy"}), (loop, {}, OF_LOOPS),
        (parse_model(TEXT), {}, set()), (parse_model(TEXT), {"reactions": True}, {reactions}),
    ):  # fmt: skip
        generate(model, folder, compile=False, **options)
        assert carried(folder) & OPTIONAL == expected and carried(folder) <= everything | SHARED


def test_every_file_of_the_run_time_is_imported_by_what_carries_it(written):
    script = "import sys, rod; print(*(m[13:].replace('.', '/') for m in sys.modules if m.startswith('rod._runtime.')))"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=written.parent, capture_output=True, text=True, check=True
    )
    assert {*done.stdout.split()} == {m.removesuffix("/__init__") for m in carried(written) - LATE - {"__init__"}}


WITHOUT = """
import json, sys
from rod import Solver
solver = Solver("numpy")
told = {}
for name in sys.argv[1:]:
    try:
        getattr(solver, name)
    except AttributeError as error:
        told[name] = str(error)
print(json.dumps(told))
"""


def test_members_of_sections_that_a_package_lacks_say_why(written, tmp_path):
    """A solver of the package says what one of `codegen.load` does."""
    loop = generate(parse_model(LOOP), tmp_path / "rod", "numpy").folder
    of_trees = ("inverse_mass_matrix", "solve_mass_sensitivities", "solve_mass")
    for folder, names in ((written, ("reactions",)), (loop, ("reactions", *of_trees))):
        done = subprocess.run(
            [sys.executable, "-c", WITHOUT, *names], cwd=folder.parent, capture_output=True, text=True, check=True
        )
        told = json.loads(done.stdout)
        assert set(told) == set(names)
        ours = codegen.load(folder, "numpy")
        q, u = ours.initial
        for name in names:
            with pytest.raises(AttributeError) as caught:
                getattr(ours, name)(*((q,) if name == "inverse_mass_matrix" else (q, u)))
            assert str(caught.value) == told[name]


@pytest.mark.parametrize("target", ["c", "numpy", "both"])
def test_both_targets_are_always_written(model, tmp_path, target):
    folder = generate(model, tmp_path / "rod", target, compile=False).folder
    assert set(FILES) <= set(contents(folder))
    assert json.loads((folder / "model.json").read_text())["target"] == target


def test_a_report_is_short_and_can_be_read(model, tmp_path):
    report = generate(model, tmp_path / "rod", "numpy", check=True)
    assert repr(report).startswith("<Report rod: 2 bodies, ") and len(repr(report)) < 200 + len(str(tmp_path))
    text = str(report)
    assert text.startswith(f"rod  {tmp_path / 'rod'}\n") and "2 bodies, 5 coordinates, 4 speeds, 1 parameter;" in text
    assert "checked against the generic engine" in text and "triangularize" not in text
    assert "triangularize" in "\n".join(report.lines(verbose=True))
    assert repr(model) == "<Model rod: 2 bodies, 0 loops, nq=5, nu=4, np=1, ninputs=1, noutputs=1>"


def test_layouts(model, tmp_path):
    texts = {}
    for layout in ("kinds", "unrolled", "auto"):
        report = generate(model, tmp_path / layout, layout=layout, compile=False)
        assert report.layout in ("kinds", "unrolled") and layout in ("auto", report.layout)
        texts[layout] = (tmp_path / layout / "rod.c").read_text()
    assert texts["auto"] in (texts["kinds"], texts["unrolled"])


@pytest.mark.parametrize("option", ["target", "layout"])
def test_unknown_options_are_refused(model, tmp_path, option):
    with pytest.raises(ValueError, match=rf"{option} is 'rust'; allowed are .*, "):
        generate(model, tmp_path / "rod", **{option: "rust"})
    assert not (tmp_path / "rod").exists()


@pytest.mark.parametrize("option", ["reactions", "frames", "check", "force", "compile"])
@pytest.mark.parametrize("value", ["no", 0, None])
def test_options_that_are_neither_true_nor_false_are_refused(model, tmp_path, option, value):
    allowed = "True, False and 'all'" if option == "compile" else "True and False"
    with pytest.raises(ValueError, match=f"^{option} is {value!r}; allowed are {allowed}$"):
        generate(model, tmp_path / "rod", **{option: value})
    assert not (tmp_path / "rod").exists()


def test_objects_in_place_of_a_model_are_refused(model, tmp_path):
    with pytest.raises(TypeError, match=r"^an int is given; a Model, or the path of its file, is needed"):
        generate(3, tmp_path / "rod")
    with pytest.raises(ModelError, match=r"^<string>: this is the text of a model; a path is needed here"):
        generate("model: rod\nbodies: {}\n", tmp_path / "rod")
    for engine in (RecursiveEngine, DenseEngine):
        with pytest.raises(TypeError, match=r"^a str is given; a Model is needed; load_model reads a file"):
            engine("rod.yaml")


@pytest.mark.parametrize("functions", [3, True, b"x", [["accelerations"]], ("accelerations", 3)])
def test_functions_that_are_no_names_are_refused(model, tmp_path, functions):
    with pytest.raises(ValueError, match=r"functions contains .*, expected names such as"):
        generate(model, tmp_path / "rod", functions=functions)
    assert not (tmp_path / "rod").exists()


FOREIGN = {
    "a file": {"notes.txt": "mine"},
    "another model.json": {"model.json": '{"generator": "me"}'},
    "a model.json that is a list": {"model.json": "[1]"},
    "a model.json that is no JSON": {"model.json": "{"},
    "a model.json that is no text": {"model.json": b"\xff\xfe"},
    "a folder": {"sub/x": ""},
    "a hidden file": {".hidden": ""},
}


@pytest.mark.parametrize("case", FOREIGN)
def test_a_foreign_folder_is_refused_and_left_alone(model, tmp_path, case):
    folder = tmp_path / "rod"
    for name, content in FOREIGN[case].items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    before = contents(folder)
    with pytest.raises(FolderError, match=r"rod.*did not write.*-o"):
        generate(model, folder, compile=False)
    assert contents(folder) == before and neighbours(folder) == ["rod"]


def test_a_file_in_an_own_folder_is_not_lost(model, tmp_path):
    folder = generate(model, tmp_path / "rod", compile=False).folder
    for mine in (folder / "results.csv", folder / "_runtime" / "results.csv", folder / "notes" / "results.csv"):
        mine.parent.mkdir(exist_ok=True)
        mine.write_text("days of work")
        with pytest.raises(
            FolderError, match=r"contains (_runtime/results\.csv|results\.csv|notes).* besides generated files, .*-o"
        ):
            generate(parse_model(TEXT.replace("2700", "2800")), folder, compile=False)
        assert mine.read_text() == "days of work"
        mine.unlink()


def test_a_file_in_the_place_of_the_folder(model, tmp_path):
    (tmp_path / "rod").write_text("mine")
    with pytest.raises(FolderError, match=r"is a file; .*-o"):
        generate(model, tmp_path / "rod", compile=False)
    assert (tmp_path / "rod").read_text() == "mine"


def test_the_working_directory_is_refused(model, tmp_path, monkeypatch):
    # it would be replaced, and the shell stand in a folder that is no more
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for folder in (".", tmp_path / "here", tmp_path / "here" / ".." / "here"):
        with pytest.raises(FolderError, match=r"working directory.*-o"):
            generate(model, folder, compile=False)
    assert neighbours(tmp_path / "here") == ["here"] and not contents(tmp_path)


def test_empty_folders_parents_and_links(model, tmp_path):
    (tmp_path / "empty").mkdir()
    generate(model, tmp_path / "empty", compile=False)
    generate(model, tmp_path / "a" / "b" / "c", compile=False)
    (tmp_path / "target").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "target")
    generate(model, tmp_path / "link", compile=False)
    assert (tmp_path / "link").is_symlink()
    assert contents(tmp_path / "empty") == contents(tmp_path / "a" / "b" / "c") == contents(tmp_path / "target")


def test_own_output_is_overwritten(model, tmp_path):
    folder = generate(model, tmp_path / "rod", compile=False).folder
    for place in (folder, folder / "_runtime"):
        (place / "__pycache__").mkdir()
        (place / "__pycache__" / "x.pyc").write_bytes(b"")
    before = (folder / "rod.c").read_bytes()
    changed = parse_model(TEXT.replace("2700", "2800"))
    assert generate(changed, folder, compile=False).written
    assert (folder / "rod.c").read_bytes() != before
    listed = json.loads((folder / "model.json").read_text())["files"]
    assert neighbours(folder) == ["rod"] and sorted(contents(folder)) == listed and set(FILES) < set(listed)


def test_another_model_leaves_nothing_of_the_first(model, tmp_path):
    folder = generate(model, tmp_path / "rod", compile=False).folder
    generate(parse_model(TEXT.replace("model: rod", "model: stick")), folder, compile=False)
    assert not list(folder.glob("rod*")) and (folder / "stick.c").exists()


@pytest.mark.parametrize("existing", [False, True])
def test_a_failure_while_writing_leaves_what_was_there(model, tmp_path, monkeypatch, existing):
    folder = tmp_path / "rod"
    if existing:
        generate(model, folder, compile=False)
    before = contents(tmp_path)
    changed = parse_model(TEXT.replace("2700", "2800"))
    real, count = Path.write_bytes, [0]

    def full(self, data):
        count[0] += 1
        if count[0] == 4:
            real(self, data[: len(data) // 2])
            raise OSError(28, "No space left on device", str(self))
        return real(self, data)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises((FolderError, OSError), match="No space left"):
            generate(changed, folder, compile=False)
    assert count[0] == 4 and contents(tmp_path) == before
    assert neighbours(folder) == (["rod"] if existing else [])


def test_a_failure_before_writing_leaves_what_was_there(model, tmp_path, monkeypatch):
    import codegen.pipeline

    folder = generate(model, tmp_path / "rod", compile=False).folder
    before = contents(folder)

    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(codegen.pipeline, "write_solver", interrupted)
    with pytest.raises(KeyboardInterrupt):
        generate(model, folder, compile=False)
    assert contents(folder) == before and neighbours(folder) == ["rod"]


def test_a_wrong_model_writes_nothing(tmp_path):
    with pytest.raises(ModelError):
        generate(tmp_path / "missing.yaml", tmp_path / "out")
    (tmp_path / "bad.yaml").write_text(TEXT.replace("revolute", "revolving"))
    with pytest.raises(ModelError, match=r"bad\.yaml:\d+:\d+: .*revolving.*revolute"):
        generate(tmp_path / "bad.yaml", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_failing_compiler_leaves_source_and_log(model, tmp_path, monkeypatch):
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O0 -fno-such-flag")
    with pytest.raises(CompileError, match=r"rod\.c.*rod.*\.log") as error:
        generate(model, tmp_path / "rod")
    assert "no-such-flag" in str(error.value)
    (log,) = (tmp_path / "rod").glob("*.log")
    assert "no-such-flag" in log.read_text() and (tmp_path / "rod" / "rod.c").exists()
    assert not list((tmp_path / "rod").glob("*.so"))
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O0")
    report = generate(model, tmp_path / "rod", check=True)
    assert report.compiled and report.errors["dudot"] < 1e-9


def test_without_compiler_there_is_a_remark_and_numpy_checks(model, tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    report = generate(model, tmp_path / "rod", check=True)
    assert not report.compiled
    assert any("no-such-compiler" in r and "NumPy" in r for r in report.remarks)
    assert 0 <= report.errors["udot"] < 1e-9 and 0 <= report.errors["dudot"] < 1e-9
    with pytest.warns(RuntimeWarning, match=r"no-such-compiler.*NumPy target"):
        solver = codegen.load(tmp_path / "rod")
    assert solver.target == "numpy" and np.isfinite(solver.accelerations(*solver.initial)).all()


def renew_digest(file):
    """Update the manifest of a package after a change of a file, as if `generate` had written it."""
    manifest = json.loads((file.parent / "model.json").read_text())
    del manifest["seal"]
    manifest["digests"][file.name] = file_digest(file.read_bytes())
    (file.parent / "model.json").write_text(seal(json.dumps(manifest)))


def test_the_check_finds_wrong_numbers(model, tmp_path):
    report = generate(model, tmp_path / "rod", "numpy")
    file = tmp_path / "rod" / "rod_numpy.py"
    text = file.read_text()
    assert "9.81" in text
    file.write_text(text.replace("9.81", "9.82"))
    renew_digest(file)
    check_solver(model, report)
    assert report.errors["udot"] > report.agreement and report.errors["dudot"] > report.agreement
    file.write_text(text.replace("9.81", "float('nan')"))
    renew_digest(file)
    check_solver(model, report)
    assert not report.errors["udot"] <= report.agreement


def test_the_check_knows_how_large_what_cancels_is(tmp_path):
    """Derivatives that are zero where udot is thousands."""
    text = """
model: sheet
bodies:
  a: {parent: ground, joint: {type: planar, normal: [1, 2, 3]}, mass: 10, inertia: {xx: 1, yy: 1, zz: 1}}
forces: {push: {type: force, on: a, value: [980, 0, 98000]}}
"""
    report = generate(parse_model(text), tmp_path / "sheet", "numpy", check=True)
    assert max(report.errors.values()) < report.agreement


SLIDER = """
model: slider
bodies:
  a: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  f: {type: joint, joint: a, value: FORCE}
"""


def test_a_check_where_expressions_have_a_value(tmp_path):
    # log has none at half of the states: those are left out, and they are no wrong numbers
    report = generate(parse_model(SLIDER.replace("FORCE", "log(q.a)")), tmp_path / "half", "numpy", check=True)
    assert report.errors["dudot"] < 1e-9 and not report.remarks
    report = generate(parse_model(SLIDER.replace("FORCE", "log(q.a - 100)")), tmp_path / "none", "numpy", check=True)
    assert not report.errors and any("not checked" in r for r in report.remarks)


def test_large_models_are_not_checked(model, tmp_path, monkeypatch):
    monkeypatch.setattr(generation, "CHECK_LIMIT", 1)
    report = generate(model, tmp_path / "rod", "numpy", check=True)
    assert not report.errors and any("not checked" in r and "1 bodies" in r for r in report.remarks)


BLOCKED = """
import importlib.abc, sys

class Blocker(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in sys.argv[2].split(","):
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Blocker())
sys.path.insert(0, sys.argv[1])
from package import Solver
solver = Solver(*sys.argv[3:])
udot, dudot = solver.sensitivities(*solver.initial, dq=[1.0, 0, 0, 0, 0])
print(solver.target, *udot)
"""


@pytest.fixture(scope="module")
def package(model, tmp_path_factory):
    return generate(model, tmp_path_factory.mktemp("alone") / "package").folder


@pytest.mark.parametrize(("target", "without"), [("c", "cffi_none"), ("numpy", "cffi,_cffi_backend")])
def test_a_package_stands_alone(package, model, target, without):
    blocked = f"{without},codegen,sympy,scipy,jinja2,yaml,pydantic,platformdirs,rich"
    run = subprocess.run([sys.executable, "-I", "-c", BLOCKED, package.parent, blocked, target],
                         capture_output=True, text=True, check=False)  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert not run.stderr
    used, *udot = run.stdout.split()
    assert used == target
    expected = codegen.load(package, target).accelerations(*codegen.load(package).initial)
    np.testing.assert_allclose([float(x) for x in udot], expected, rtol=1e-12, atol=1e-12)


def test_both_targets_agree_when_loaded(package):
    assert codegen.load(package, "both").target == "c"


def test_a_solver_of_a_package_can_be_sent_to_another_process(package):
    script = ("import pickle; from package import Solver, TargetsDifferError; s = pickle.loads(pickle.dumps(Solver('numpy')))\n"
              "print(type(s) is Solver, s.target, s.accelerations(*s.initial).shape)")  # fmt: skip
    run = subprocess.run(
        [sys.executable, "-c", script], cwd=package.parent, capture_output=True, text=True, check=False
    )
    assert run.stdout == "True numpy (4,)\n", run.stderr


def test_a_force_without_a_value_at_some_states_is_no_difference_of_the_targets(tmp_path):
    model = parse_model("""
model: gated
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, 1]}
forces:
  gate: {type: joint, joint: arm, value: acos(20*u.arm)}
""")
    generate(model, tmp_path / "gated", target="both")
    solver = codegen.load(tmp_path / "gated", target="both")
    with pytest.warns(RuntimeWarning, match=r"the force on joint arm is not finite \(force gate"):
        assert np.isnan(solver.accelerations([0.1], [1.0])).all()
    assert np.isclose(solver.accelerations([0.1], [0.0])[0], np.pi / 2)
