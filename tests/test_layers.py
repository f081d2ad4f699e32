"""The layers of the package: every module imports only lower layers. Also automatic checks of style."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "codegen"
MODULES = sorted(PACKAGE.rglob("*.py"))

FLOORS = {
    "version": set(),
    "wording": set(),  # parts of messages; every layer may import it
    "deferred": set(),  # names that are imported when first asked for
    "records": set(),  # data classes
    "html_tables": set(),  # results in notebooks
    "terminal": {"runtime"},  # progress, colours, line width
    "elementary": set(),  # the elementary functions
    "jumps": {"elementary"},  # of functions of time
    "model": {"elementary", "html_tables", "jumps", "version"},
    "importing": {"html_tables", "model", "version"},  # robots of other formats
    "program": {"elementary", "records", "version"},  # knows no mechanics
    "loops": {"model", "records", "version"},  # graph, assembly and partition, on floats
    "mechanics": {"loops", "model", "program", "records", "version"},  # knows no C and no files
    "reference": {"elementary", "loops", "model", "version"},  # nothing of the generator but these, graph and partition
    "symbolic": {
        "deferred",
        "elementary",
        "html_tables",
        "loops",
        "mechanics",
        "model",
        "program",
        "reference",
        "version",
    },  # sympy
    "emit": {"elementary", "model", "program", "records", "version"},  # prints any program
    "display": {"model"},  # what views need to know of a model
    "manifest": {"display", "emit", "jumps", "loops", "mechanics", "model", "program"},  # what model.json says
    "pipeline": {
        "emit",
        "loops",
        "manifest",
        "mechanics",
        "model",
        "program",
        "version",
    },  # the stages from model to files
    "runtime": {
        "deferred",
        "elementary",
        "emit",
        "html_tables",
        "jumps",
        "loops",
        "mechanics",
        "model",
        "pipeline",
        "program",
        "version",
    },
    "design": {
        "html_tables",
        "runtime",
        "terminal",
        "version",
    },  # on solvers; knows no models, and no package carries it
    "operators": {"runtime"},  # functions of solvers with their derivatives
    "differentiable_motions": {"design", "runtime"},  # motions as functions of numbers
    "jax": {"deferred", "differentiable_motions", "operators", "runtime"},
    "torch": {"deferred", "differentiable_motions", "operators", "runtime"},
}
"""What each layer may import besides itself. Layers that are not listed (generation, cli, report, ...) are the top:
they may import everything, and no listed layer may import them."""

APART = {"measure": {"bench", "cli", "reporting"}, "bench": {"cli", "reporting"}, "reporting": {"bench", "cli"}}
"""At the top: the benchmark and reports stand on `measure`, which knows neither, and they do not know each other."""

ROOMS = {
    "joints": set(),
    "structure": {"joints"},
    "tree": {"joints", "structure"},
    "ears": {"joints", "structure", "tree"},
    "elements": {"joints", "structure", "tree"},
    "outputs": {"joints", "structure", "tree"},
}
"""The rooms of the mechanics, and what each may import beside itself. The sweeps over all of them, what is made of the
sweeps (procedures, a folder too), and the words that all share (fields, stores, vectors) stand beside the rooms."""

STANDALONE = PACKAGE / "runtime" / "standalone"
"""Copied into generated packages, file by file, which need NumPy and cffi only."""

EXTRAS = {
    "trust/precision": {"mpmath"},
    "trajectory/plot": {"matplotlib"},
    "trajectory/table": {"pandas"},
    "trajectory/files": {"pyarrow"},
    "display/picture": {"PIL", "matplotlib", "mpl_toolkits"},
    "display/meshes": {"trimesh"},
    "display/viewer": {"rich", "viser"},  # viser needs rich
}
"""What single modules of it may import beside these, within functions only: who calls them has installed it."""

RUN_TIME = ("files", "calls", "assembly", "state", "statics", "trajectory", "display", "motion", "trust")
"""The rooms of it, each of which may import those before it."""

FORBIDDEN_CALLS = {"eval", "exec", "__import__", "os.chdir", "os.system"}
MACHINE_PATH = re.compile(
    r"(?<![\w.}>/-])/(?:" + "|".join(("work", "home", "root", "Users", "tmp/venv")) + r")(?:/|\b(?!\w))"
)


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _floor(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _room(path: Path) -> str:
    parts = path.relative_to(PACKAGE).parts
    return parts[1] if parts[0] == "mechanics" and len(parts) > 2 and parts[1] != "procedures" else ""


@dataclass
class Seen:
    """What the checks need to know of a module: its imports, the lines within functions, and calls of names with dots."""

    imports: list[ast.Import | ast.ImportFrom] = field(default_factory=list)
    lines_of_functions: set[int] = field(default_factory=set)
    calls: list[tuple[int, str]] = field(default_factory=list)


@cache
def seen(source: str) -> Seen:
    """A module is parsed once for all checks."""
    found = Seen()
    for n in ast.walk(ast.parse(source)):
        if isinstance(n, ast.Import | ast.ImportFrom):
            found.imports.append(n)
        elif isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef):
            found.lines_of_functions.update(range(n.body[0].lineno, (n.end_lineno or n.lineno) + 1))
        elif isinstance(n, ast.Call) and isinstance(n.func, ast.Name | ast.Attribute):
            found.calls.append((n.lineno, _dotted(n.func)))
    return found


def _dotted(node: ast.expr) -> str:
    """A dotted name; text before a dot that is not a name is left out."""
    if isinstance(node, ast.Attribute):
        return f"{_dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def imports(source: str, path: Path) -> Iterator[tuple[int, str]]:
    """Line and absolute name of everything imported at any depth; ``from a import b`` gives ``a.b``."""
    package = path.relative_to(ROOT).parent.parts
    for node in seen(source).imports:
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        else:
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = (*base, node.module) if node.module else base
            yield from ((node.lineno, ".".join((*module, alias.name))) for alias in node.names)


def lines_of_functions(source: str) -> set[int]:
    """Lines that run when a function is called, not when the module is imported."""
    return seen(source).lines_of_functions


def faults(source: str, path: Path) -> list[str]:
    """Imports of higher layers."""
    floor, found = _floor(path), []
    for line, name in imports(source, path):
        parts = name.split(".")
        if path.is_relative_to(STANDALONE):
            own = parts[:2] in [["codegen", name] for name in ("elementary", "html_tables", "jumps", "wording")] or (
                parts[:3] == ["codegen", "runtime", "standalone"] and len(parts) > 3
            )
            module = path.relative_to(STANDALONE).with_suffix("").as_posix()
            extra = parts[0] in EXTRAS.get(module, ()) and line in lines_of_functions(source)
            room, lower = module.rpartition("/")[0], parts[3] if own and len(parts) > 4 else ""
            if room and lower in RUN_TIME and RUN_TIME.index(lower) > RUN_TIME.index(room):
                found.append(f"{_name(path)}:{line}: {room} imports {name}; {lower} is above it")
            if not own and not extra and parts[0] not in sys.stdlib_module_names | {"numpy", "cffi"}:
                found.append(
                    f"{_name(path)}:{line}: {name}; beside itself the standalone run time has the standard library, numpy and "
                    f"cffi only, and extras within functions of the modules that EXTRAS names"
                )
        elif parts[0] == "codegen" and floor in APART and parts[1] in APART[floor]:
            found.append(f"{_name(path)}:{line}: {floor} imports {name}; {floor} does not know {parts[1]}")
        elif parts[0] == "codegen" and floor in FLOORS:
            target = parts[1] if len(parts) > 1 else "the top"
            if target not in {floor, "wording", *FLOORS[floor]}:
                allowed = ", ".join(sorted(FLOORS[floor])) or "nothing"
                found.append(f"{_name(path)}:{line}: {floor} imports {name}; beside itself it may import {allowed}")
            room, other = _room(path), parts[2] if parts[1:2] == ["mechanics"] and len(parts) > 2 else ""
            if room and other in ROOMS and other not in ROOMS[room] | {room}:
                allowed = ", ".join(sorted(ROOMS[room])) or "nothing"
                found.append(f"{_name(path)}:{line}: {room} imports {name}; of the other rooms it may import {allowed}")
    return found


Graph = dict[str, set[str]]


def graph(sources: dict[Path, str]) -> Graph:
    """Which modules each one imports at any depth, for type checkers too; packages are not meant where modules in them are."""
    names = {p: ".".join(p.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for p in sources}
    modules, found = set(names.values()), {}
    for path, source in sources.items():
        found[names[path]] = set()
        for _, name in imports(source, path):
            known = next((n for n in (name, name.rpartition(".")[0]) if n in modules), None)
            if known not in (None, names[path]):
                found[names[path]].add(known)
    return found


def reached(modules: Graph, start: str) -> set[str]:
    """The modules that a module imports, directly or through others."""
    found, left = set(), {start}
    while left:
        left = set().union(*(modules[m] for m in left)) - found
        found |= left
    return found


def circles(modules: Graph) -> list[str]:
    """Circular imports, as ``a -> b``."""
    beyond = {m: reached(modules, m) for m in modules}
    return sorted(f"{a} -> {b}" for a, several in modules.items() for b in several if a in beyond[b])


def forbidden_calls(source: str) -> list[tuple[int, str]]:
    return [(line, name) for line, name in seen(source).calls if name in FORBIDDEN_CALLS]


def test_modules_import_lower_floors_only():
    assert not [fault for p in MODULES for fault in faults(p.read_text(encoding="utf-8"), p)]


def test_modules_make_no_forbidden_calls():
    assert not {_name(p): wrong for p in MODULES if (wrong := forbidden_calls(p.read_text(encoding="utf-8")))}


def test_there_are_modules_on_every_floor():
    assert {_floor(p) for p in MODULES} >= FLOORS.keys()
    assert {_room(p) for p in MODULES} == {*ROOMS, ""}
    assert {p.parent.name for p in MODULES if p.parent.parent == STANDALONE} == {*RUN_TIME}


def test_no_module_imports_itself_in_a_circle():
    modules = graph({p: p.read_text(encoding="utf-8") for p in MODULES})
    assert sum(map(len, modules.values())) > len(modules)
    assert not circles(modules)


def test_circles_are_seen_in_functions_and_across_floors():
    def of(**sources):
        files = {"one": "loops/one.py", "two": "loops/two.py", "top": "loops/__init__.py", "far": "emit/far.py"}
        return circles(graph({PACKAGE / files[name]: source for name, source in sources.items()}))

    there, back = "codegen.loops.one -> codegen.loops.two", "codegen.loops.two -> codegen.loops.one"
    for source in ("from . import one", "def f():\n    from .one import g", "import codegen.loops.one as one",
                   "if TYPE_CHECKING:\n    from .one import G"):  # fmt: skip
        assert of(one="from .two import f", two=source, top="") == [there, back]
    assert of(one="from ..emit.far import f", far="from ..loops import f", top="from .one import f", two="") == [
        "codegen.emit.far -> codegen.loops",
        "codegen.loops -> codegen.loops.one",
        "codegen.loops.one -> codegen.emit.far",
    ]
    assert of(one="from .two import f", two="import sys", top="from .one import f", far="from ..loops import f") == []


def test_statements_are_of_one_algebra():
    """A symbol of sympy's is none of ours, and `isinstance` would say so without a word; sympy meets formulas of models only."""
    found = {}
    for path in MODULES:
        names = [
            name
            for node in seen(path.read_text(encoding="utf-8")).imports
            for name in ([node.module or ""] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names])
        ]
        if any(name.split(".")[0] == "sympy" for name in names):
            found[path.relative_to(PACKAGE).as_posix()] = len(names)
    formulas = {
        *(f"model/sympy_{name}.py" for name in ("names", "output", "trees")),
        *(f"importing/sympy_{name}.py" for name in ("closures", "conditions", "loads", "model", "rotations", "system")),
    }
    assert {name for name in found if not name.startswith("symbolic/")} == formulas


DECLARED_AS = {
    "pydantic_core": "pydantic",
    "yaml": "PyYAML",
    "pinocchio": "pin",
    "PIL": "pillow",
    "mpl_toolkits": "matplotlib",
}
"""What a package is called where it is installed from, by the name that is imported."""


def test_everything_that_is_imported_is_declared():
    """A package that comes only because another one needs it may be missing one day."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *(d for extra in project["optional-dependencies"].values() for d in extra)]
    declared = {re.split(r"[<>=,;\[ ]", d)[0] for d in wanted}
    core = {re.split(r"[<>=,;\[ ]", d)[0] for d in project["dependencies"]}
    missing = []
    for path in MODULES:
        source = path.read_text(encoding="utf-8")
        inner = lines_of_functions(source)
        for line, name in imports(source, path):
            package = name.split(".")[0]
            if package not in sys.stdlib_module_names | {"codegen", "ordernm"}:
                known = declared if line in inner or package == _floor(path) else core  # codegen/jax imports jax
                missing += [f"{_name(path)}:{line}: {package}"] * (DECLARED_AS.get(package, package) not in known)
    assert not missing


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
        ("mechanics/x.py", "from ..emit.c.module import CWriter"),
        ("mechanics/structure/x.py", "from ..ears.orthogonal import Factor"),
        ("mechanics/tree/x.py", "from .. import spatial, ears"),
        ("mechanics/ears/x.py", "from ..outputs import energy"),
        ("reference/x.py", "from codegen.program.block import Block"),
        ("importing/x.py", "from ..loops import ears"),
        ("model/x.py", "from ..importing import import_model"),
        ("model/x.py", "import codegen"),
        ("emit/x.py", "from ..cli import main"),
        ("emit/x.py", "from ..mechanics import stores"),
        ("emit/c/x.py", "from ...runtime import load"),
        ("runtime/x.py", "from ..design import objective"),
        ("measure/x.py", "from ..bench.problem import Setting"),
        ("bench/x.py", "from ..reporting import figures"),
        ("reporting/x.py", "from ..bench import page"),
        ("design/x.py", "from ..model import load_model"),
        ("runtime/standalone/x.py", "import scipy.linalg"),
        ("runtime/standalone/x.py", "from ..sections import STANDALONE"),
        ("runtime/standalone/x.py", "def f():\n    from .. import load"),
        ("runtime/standalone/x.py", "from ...version import __version__"),
        ("runtime/standalone/calls/x.py", "from ..state.frames import Frames"),
        ("runtime/standalone/trajectory/trajectory.py", "def f():\n    import matplotlib"),
        ("runtime/standalone/trajectory/plot.py", "import matplotlib"),
        ("runtime/standalone/trajectory/plot.py", "def f():\n    import pandas"),
        ("runtime/standalone/trajectory/plot.py", "if TYPE_CHECKING:\n    from matplotlib.figure import Figure"),
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
        ("mechanics/ears/x.py", "from ..tree.kinematics import pose\nfrom .. import fields\nfrom .geometry import Ear"),
        ("emit/c/x.py", "from ...program import plan\nfrom ..printer import Printer"),
        ("cli.py", "from . import generation, reference"),
        (
            "runtime/standalone/x.py",
            "import json\nimport numpy as np\nfrom cffi import FFI\nfrom .errors import PackageError",
        ),
        ("runtime/standalone/state/x.py", "from ..calls.package import Package\nfrom ..errors import PackageError"),
        ("runtime/standalone/trajectory/plot.py", "def f():\n    from matplotlib.figure import Figure"),
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


def test_files_of_the_integrator_call_lower_rows_only() -> None:
    """The rows are in the first comment of `inside.h`; every file is in one, and none calls its own row or a higher one."""
    folder = PACKAGE / "runtime" / "motion"
    sources = {f.stem: re.sub(r"/\*.*?\*/", "", f.read_text(), flags=re.S) for f in folder.glob("*.c")}
    drawn = re.findall(r"^ \*     ([a-z_]+(?:, [a-z_]+)*)  ", (folder / "inside.h").read_text(), flags=re.M)
    row = {name: i for i, names in enumerate(drawn) for name in names.split(", ")}
    assert sorted(row) == sorted(sources)
    home = {
        symbol: name
        for name, text in sources.items()
        for symbol in re.findall(
            r"^(?:const method |[a-z][\w *]*[ *])(ordernm_\w+)(?: = |\([^;{]*\)\s*\{)", text, flags=re.M
        )
    }
    assert len(home) > 100
    upward = {
        f"{name} calls {symbol} of {home[symbol]}"
        for name, text in sources.items()
        for symbol in set(re.findall(r"\bordernm_\w+", text)) & home.keys()
        if home[symbol] != name and row[home[symbol]] <= row[name]
    }
    assert not upward, sorted(upward)
    for name, text in sources.items():
        assert text.count("\n") < 500, name
