"""The floors of the package: every module imports lower ones only, and a few habits that no review should have to find."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "codegen"
MODULES = sorted(PACKAGE.rglob("*.py"))

FLOORS = {
    "version": set(),
    "model": {"version"},
    "program": {"version"},  # knows no mechanics
    "loops": {"model", "version"},  # graph, assembly and partition, on floats
    "mechanics": {"loops", "model", "program", "version"},  # knows no C and no files
    "reference": {"loops", "model", "version"},  # shares nothing with the generator but model, graph and partition
    "emit": {"loops", "mechanics", "model", "program", "version"},
    "runtime": {"emit", "loops", "mechanics", "model", "program", "version"},
}
"""What each floor may import beside itself. Floors that are not listed (generation, cli, report, ...) are the top:
they may import everything, and no listed floor may import them."""

WITHOUT_CIRCLES = ["emit", "mechanics", "model", "program", "runtime"]
"""Floors on which imports are in order inside too."""

STANDALONE = PACKAGE / "runtime" / "solver.py"
"""Copied into every generated package, which needs NumPy and cffi only."""

FORBIDDEN_CALLS = {"eval", "exec", "__import__", "os.chdir", "os.system"}
MACHINE_PATH = re.compile(
    r"(?<![\w.}>/-])/(?:" + "|".join(("work", "home", "root", "Users", "tmp/venv")) + r")(?:/|\b(?!\w))"
)


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _floor(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(source: str, path: Path) -> Iterator[tuple[int, str]]:
    """Line and absolute name of everything imported at any depth; ``from a import b`` gives ``a.b``."""
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = (*base, node.module) if node.module else base
            yield from ((node.lineno, ".".join((*module, alias.name))) for alias in node.names)


def faults(source: str, path: Path) -> list[str]:
    """Imports that climb."""
    floor, found = _floor(path), []
    for line, name in imports(source, path):
        parts = name.split(".")
        if path == STANDALONE:
            if parts[0] not in sys.stdlib_module_names | {"numpy", "cffi"}:
                found.append(
                    f"{_name(path)}:{line}: {name}; the standalone solver has the standard library, numpy and cffi only"
                )
        elif parts[0] == "codegen" and floor in FLOORS:
            target = parts[1] if len(parts) > 1 else "the top"
            if target != floor and target not in FLOORS[floor]:
                allowed = ", ".join(sorted(FLOORS[floor])) or "nothing"
                found.append(f"{_name(path)}:{line}: {floor} imports {name}; beside itself it may import {allowed}")
    return found


def circle(sources: dict[Path, str]) -> list[str]:
    """A circle of imports, if there is one, among modules given by path with their text."""
    by_name = {".".join(p.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): p for p in sources}
    needs: dict[str, set[str]] = {}
    for name, path in by_name.items():
        found = {full for _, full in imports(sources[path], path)}
        # what is imported is a module, or something in one
        needs[name] = {f if f in by_name else f.rpartition(".")[0] for f in found} & by_name.keys()
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def forbidden_calls(source: str) -> list[tuple[int, str]]:
    calls = (n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Call))
    return [(n.lineno, f) for n in calls if (f := ast.unparse(n.func)) in FORBIDDEN_CALLS]


@pytest.mark.parametrize("path", MODULES, ids=_name)
def test_a_module_imports_lower_floors_only(path):
    assert not faults(path.read_text(encoding="utf-8"), path)


@pytest.mark.parametrize("path", MODULES, ids=_name)
def test_a_module_makes_no_forbidden_calls(path):
    assert not forbidden_calls(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("floor", WITHOUT_CIRCLES)
def test_no_modules_of_a_floor_import_each_other(floor):
    assert not circle({p: p.read_text(encoding="utf-8") for p in MODULES if _floor(p) == floor})


def test_the_check_sees_circles():
    a, b, c = (PACKAGE / "program" / f"{name}.py" for name in "abc")
    assert circle({a: "from .b import x", b: "from . import c", c: "def f():\n    from .a import y"})
    assert not circle({a: "from .b import x\nfrom . import c", b: "from . import c", c: "import a"})


def test_there_are_modules_on_every_floor():
    assert {_floor(p) for p in MODULES} >= FLOORS.keys()
    assert STANDALONE in MODULES


def test_nothing_is_called_utils():
    assert not [p for p in PACKAGE.rglob("*") if p.stem.strip("_") in {"util", "utils", "helpers", "misc", "common"}]


def test_tracked_files_name_no_path_of_a_machine():
    try:
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout.decode()
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    found = []
    for name in filter(None, listed.split("\0")):
        try:
            lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
        except (UnicodeDecodeError, OSError):  # not text, or removed but not yet committed
            continue
        found += [f"{name}:{k}: {line.strip()}" for k, line in enumerate(lines, 1) if MACHINE_PATH.search(line)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("file", "source"),
    [
        ("program/x.py", "from ..mechanics import joints"),
        ("program/x.py", "from .. import mechanics"),
        ("program/x.py", "def f():\n    import codegen.model.model"),
        ("mechanics/x.py", "from ..emit.c import CWriter"),
        ("reference/x.py", "from codegen.program.block import Block"),
        ("model/x.py", "import codegen"),
        ("emit/x.py", "from ..cli import main"),
        ("emit/c/x.py", "from ...runtime import load"),
        ("runtime/solver.py", "import scipy.linalg"),
        ("runtime/solver.py", "from .compiler import build"),
    ],
)
def test_the_check_sees_imports_that_climb(file, source):
    assert faults(source, PACKAGE / file)


@pytest.mark.parametrize(
    ("file", "source"),
    [
        (
            "program/x.py",
            "import sympy\nfrom . import passes\nfrom .block import Block\nfrom ..version import __version__",
        ),
        ("mechanics/x.py", "from ..model.model import GROUND\nfrom ..program import block"),
        ("emit/c/x.py", "from ...mechanics import kinds\nfrom ..printer import Printer"),
        ("cli.py", "from . import generation, reference"),
        ("runtime/solver.py", "import json\nimport numpy as np\nfrom cffi import FFI"),
    ],
)
def test_the_check_lets_imports_of_lower_floors_pass(file, source):
    assert not faults(source, PACKAGE / file)


def test_the_check_sees_forbidden_calls_and_paths():
    source = "eval('1')\nimport os\nos.chdir('.')\nre.compile('x')\nx.eval()"
    assert [f for _, f in forbidden_calls(source)] == ["eval", "os.chdir"]
    for text in ("cd /{}/main", '"/{}"', "=/{}/me"):
        assert all(MACHINE_PATH.search(text.format(d)) for d in ("work", "home", "root", "Users"))
    for text in ("frame/{}s", "a/{}", "../{}", "/{}bench", "https://x.org/{}/a", "{{base}}/{}"):
        assert not any(MACHINE_PATH.search(text.format(d)) for d in ("work", "home", "root", "Users")), text
