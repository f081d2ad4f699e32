"""The wheel: its contents, generation outside the checkout, and generated packages that need nothing else."""

import importlib.util
import json
import os
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.reference import RecursiveEngine
from codegen.version import __version__

ROOT = Path(__file__).parents[1]
TEMPLATES = sorted(
    p.relative_to(ROOT).as_posix() for p in (ROOT / "templates").rglob("*.jinja")
)  # without what is compiled
EXAMPLE = ROOT / "examples" / "double_pendulum.yaml"
OFFLINE = ("No matching distribution found", "Could not find a version", "NewConnectionError", "Max retries exceeded")

STATE = {"q": [0.3, -0.7], "u": [0.5, 1.1]}
USE_PACKAGE = """
import importlib.util, json, sys
absent = [m for m in ("codegen", "sympy", "scipy", "jinja2", "yaml", "pydantic", "platformdirs", "rich")
          if importlib.util.find_spec(m) is not None]
import numpy as np
from generated.double_pendulum import Solver
state = json.loads(sys.argv[1])
solver = Solver()
udot, dudot = solver.sensitivities(state["q"], state["u"], dp=np.eye(solver.np))
print(json.dumps({"present": absent, "target": solver.target, "udot": udot.tolist(), "dudot": dudot.tolist()}))
"""


def run(*command: object, cwd: Path, home: Path) -> subprocess.CompletedProcess:
    """Run a command in an environment without access to the checkout."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "PYTEST", "VIRTUAL_ENV"))}
    environment |= {"HOME": str(home), "XDG_CACHE_HOME": str(home / "cache")}
    return subprocess.run(
        [str(c) for c in command], cwd=cwd, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True
    )


def make_environment(folder: Path) -> tuple[Path, Path]:
    """A virtual environment without pip or packages: its interpreter, its folder of packages."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    paths = {"base": str(folder), "platbase": str(folder)}
    return folder / "bin" / "python", Path(sysconfig.get_path("purelib", "venv", paths))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel, built from the source distribution like a published one."""
    pytest.importorskip("build")
    folder = tmp_path_factory.mktemp("dist")
    isolation = ["--no-isolation"] if importlib.util.find_spec("hatchling") else []
    done = subprocess.run(
        [sys.executable, "-m", "build", *isolation, "--outdir", folder, ROOT],
        stdin=subprocess.DEVNULL, capture_output=True, text=True,
    )  # fmt: skip
    output = done.stdout + done.stderr
    if done.returncode and any(sign in output for sign in OFFLINE) and not os.environ.get("CI"):
        pytest.skip("building needs hatchling, which is neither installed nor to be had: no network")
    assert done.returncode == 0, output
    (file,) = folder.glob("*.whl")
    return file


@pytest.fixture(scope="module")
def generated(wheel, tmp_path_factory):
    """A folder outside the checkout in which the installed `generate` has run."""
    place = tmp_path_factory.mktemp("elsewhere")
    python, packages = make_environment(place / "environment")
    known = [p for p in sys.path if Path(p).name in {"site-packages", "dist-packages"}]
    (packages / "dependencies.pth").write_text("\n".join(known) + "\n")  # .pth files in there are not followed
    installed = run(
        sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-deps", "--no-index", "--ignore-installed",
        wheel, cwd=place, home=place,
    )  # fmt: skip
    assert installed.returncode == 0, installed.stderr
    where = run(python, "-c", "import codegen; print(codegen.__file__)", cwd=place, home=place)
    assert Path(where.stdout.strip()).is_relative_to(place), where
    (place / EXAMPLE.name).write_bytes(EXAMPLE.read_bytes())
    done = run(python.with_name("generate"), EXAMPLE.name, cwd=place, home=place)
    assert done.returncode == 0, done.stdout + done.stderr
    return place, done.stdout


def test_the_wheel_holds_the_package_and_its_templates_only(wheel):
    names = [n for n in zipfile.ZipFile(wheel).namelist() if not n.endswith("/")]
    information = f"ordernm-{__version__}.dist-info"
    assert {n.split("/")[0] for n in names} == {"codegen", "ordernm", information}
    assert sorted(n for n in names if n.startswith("codegen/templates/")) == [f"codegen/{t}" for t in TEMPLATES]
    assert TEMPLATES
    examples = {n.removeprefix("codegen/examples/") for n in names if n.startswith("codegen/examples/")}
    assert examples > {"pendulum.yaml", "andrews.yaml"} and all((EXAMPLE.parent / n).is_file() for n in examples)
    modules = {p.relative_to(ROOT).as_posix().removeprefix("codegen/alias/") for p in (ROOT / "codegen").rglob("*.py")}
    assert {n for n in names if n.endswith(".py")} == modules
    assert {"codegen/py.typed", "ordernm/py.typed", "ordernm/__init__.pyi"} <= set(
        names
    )  # type checkers read the annotations
    assert f"{information}/licenses/LICENSE" in names


def test_the_wheel_says_what_it_needs_and_installs_both_commands(wheel):
    archive = zipfile.ZipFile(wheel)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    metadata = archive.read(f"ordernm-{__version__}.dist-info/METADATA").decode()
    needed = [line for line in metadata.splitlines() if line.startswith("Requires-Dist:") and "extra ==" not in line]
    assert len(needed) == len(project["dependencies"])
    commands = archive.read(f"ordernm-{__version__}.dist-info/entry_points.txt").decode()
    assert "generate = codegen.entry:generate" in commands
    assert "ordernm = codegen.entry:ordernm" in commands


def test_an_installed_generate_works_outside_the_checkout(generated):
    place, output = generated
    assert "checked against the generic engine" in output
    files = {p.name for p in (place / "generated" / "double_pendulum").iterdir()}
    sources = {"double_pendulum.c", "double_pendulum.h", "double_pendulum_numpy.py"}
    assert files >= {"__init__.py", "model.json", "README.md"} | sources


def test_a_generated_package_needs_numpy_and_cffi_only(generated):
    place, _ = generated
    python, packages = make_environment(place / "bare")
    for found in map(importlib.util.find_spec, ("numpy", "cffi", "_cffi_backend", "pycparser")):
        origin = Path(found.origin)
        item = origin.parent if origin.name == "__init__.py" else origin
        (packages / item.name).symlink_to(item)
        libraries = item.with_name(f"{item.name}.libs")  # where wheels of Linux keep shared libraries
        if libraries.is_dir():
            (packages / libraries.name).symlink_to(libraries)
    done = run(python, "-c", USE_PACKAGE, json.dumps(STATE), cwd=place, home=place)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["present"] == []
    assert result["target"] == "c"
    model = codegen.load_model(EXAMPLE)
    dp = np.eye(len(model.parameters))
    udot, dudot = RecursiveEngine(model).sensitivities(np.array(STATE["q"]), np.array(STATE["u"]), dp=dp)
    np.testing.assert_allclose(result["udot"], udot, rtol=1e-12)
    np.testing.assert_allclose(result["dudot"], dudot, rtol=1e-11, atol=1e-12)


def test_what_is_imported_late_can_be_completed():
    script = "import sys, codegen; print('sympy' in sys.modules, *dir(codegen))"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    late, *names = done.stdout.split()
    assert late == "False" and names == sorted(codegen.__all__)
    assert "runtime" in dir(codegen) and not {"deferred", "annotations", "_PLACES", "__file__"} & {*dir(codegen)}
    assert all(getattr(codegen, name) is not None for name in codegen.__all__)
