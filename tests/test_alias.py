"""``import ordernm`` is ``import codegen``: the same module objects, pickles and commands, also for type checkers."""

import importlib
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

import codegen

ALIAS = Path(codegen.__file__).parent / "alias"

SAME = """
import sys
{first}
{second}
import ordernm, codegen
assert ordernm is codegen
alike = [(m, n) for n, m in sys.modules.items() if n.startswith("ordernm.")]
assert alike and all(m is sys.modules["codegen" + n[7:]] for m, n in alike), alike
assert all(m.__spec__.name == m.__name__ for m, _ in alike)
"""


def python(*arguments, cwd):
    environment = {"PYTHONPATH": f"{ALIAS.parent.parent}:{ALIAS}", "PATH": "/usr/bin:/bin"}
    return subprocess.run([sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True)


@pytest.mark.parametrize("first", ["import ordernm.reference", "from ordernm.runtime.standalone import errors",
                                   "import codegen.reference; from ordernm import generate"])  # fmt: skip
@pytest.mark.parametrize(
    "second", ["from ordernm.reference import DenseEngine", "import codegen.model, ordernm.model.errors"]
)
def test_both_names_are_one_package(tmp_path, first, second):
    done = python("-c", SAME.format(first=first, second=second), cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_errors_classes_and_pickles_are_the_same():
    import ordernm
    import ordernm.model.errors
    import ordernm.reference
    from ordernm.runtime import CompileError

    assert ordernm is codegen and ordernm.reference is codegen.reference
    assert CompileError is codegen.runtime.CompileError
    assert ordernm.model.errors.ModelError is codegen.ModelError
    found = pickle.loads(pickle.dumps(ordernm.Variable))
    assert found is codegen.Variable
    with pytest.raises(ModuleNotFoundError, match=r"ordernm\.nothing"):
        import ordernm.nothing
    with pytest.raises(AttributeError, match="module 'ordernm' has no attribute 'nothing'; it has ExportedC, "):
        ordernm.nothing  # noqa: B018


@pytest.mark.parametrize(
    ("module", "name", "hint"),
    [
        ("ordernm", "Final", "; it is in ordernm.runtime"),
        ("ordernm", "simulate", "; it is in ordernm.jax and ordernm.torch"),
        ("ordernm", "DenseEngine", "; it is in ordernm.reference"),
        ("ordernm", "Collocation", "; it is in ordernm.casadi"),
        ("ordernm", "equations", "; it is in ordernm.symbolic"),
        ("ordernm.runtime", "generate", "; it is in ordernm"),
        ("ordernm", "__wrapped__", ""),
    ],
)
def test_names_of_other_modules_are_found_there(module: str, name: str, hint: str) -> None:
    with pytest.raises(AttributeError) as caught:
        getattr(importlib.import_module(module), name)
    assert str(caught.value) == f"module {module!r} has no attribute {name!r}{hint}"


def test_modules_that_are_not_imported_are_named() -> None:
    program = "import ordernm; ordernm.symbolic"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert ended.stderr.endswith("no attribute 'symbolic'; it is a module: import ordernm.symbolic\n")


@pytest.mark.parametrize(
    "arguments", [("-m", "ordernm"), ("-m", "codegen"), ("-c", "from ordernm.cli import main; main()")]
)
def test_commands_under_both_names(tmp_path, arguments):
    done = python(*arguments, "--version", cwd=tmp_path)
    assert done.stdout == f"ordernm {codegen.__version__}\n", done.stderr


def test_type_checkers_know_both_names(tmp_path):
    pytest.importorskip("mypy", reason="needs mypy")
    (tmp_path / "use.py").write_text(
        "import ordernm\nfrom ordernm.reference import DenseEngine\nfrom ordernm.runtime import Event\n"
        "solver: ordernm.Solver = ordernm.load('x')\nreveal_type(ordernm.load)\nreveal_type(DenseEngine)\nreveal_type(Event)\n"
    )
    others = ",".join(
        f"{name}.*" for name in ("numpy", "sympy", "mpmath", "pydantic", "jinja2", "scipy", "cffi", "yaml")
    )
    (tmp_path / "mypy.ini").write_text(  # reading them takes most of the time, and nothing here depends on them
        f"[mypy]\n[mypy-{others}]\nfollow_imports = skip\nfollow_imports_for_stubs = true\n"
    )
    environment = {
        "MYPYPATH": f"{ALIAS.parent.parent}:{ALIAS}",
        "PATH": "/usr/bin:/bin",
        "MYPY_CACHE_DIR": str(tmp_path),
    }
    command = [sys.executable, "-m", "mypy", "--follow-imports=silent", "--ignore-missing-imports", "use.py"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert "codegen.runtime.solver.Solver" in done.stdout and done.returncode == 0, done.stdout
    assert "codegen.reference.dense.DenseEngine" in done.stdout and "Any" not in done.stdout


def test_every_package_has_its_stub():
    packages = {p.parent.name for p in (ALIAS.parent).glob("*/__init__.py")} - {"alias"}
    assert {p.stem for p in (ALIAS / "ordernm").glob("*.pyi")} - {"__init__"} == packages
