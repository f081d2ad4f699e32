"""Docstrings of public functions: each has its numpydoc sections, and its example prints what it shows."""

from __future__ import annotations

import doctest
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from docs_namespace import namespace

import codegen
import codegen.runtime
from codegen.reference.engine import Engine
from codegen.runtime.standalone.calls.package import Package
from codegen.runtime.standalone.solver import Solver

validate = pytest.importorskip("numpydoc.validate", reason="numpydoc is not installed: pip install -e '.[test]'")

FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
CHECKED = (
    "GL03", "GL06", "GL07", "GL08", "SS01", "SS02", "SS03", "SS06", "PR01", "PR02", "PR03", "PR04", "PR07", "PR10", "RT01",
    "RT03", "EX01",
)  # fmt: skip
"""What numpydoc's validation has to find nothing of."""
OF_PROPERTIES = ("GL03", "GL06", "GL07", "GL08", "SS01", "SS02", "SS03", "SS06")

FUNCTIONS = [
    f"codegen.{module}.{name}"
    for module, names in {
        "generation": "generate", "summary": "Report", "reporting.measuring": "report",
        "exporting.plain_c": "ExportedC export_c",
        "exporting.fmu.export": "ExportedFMU export_fmu", "casadi.functions": "function ode",
        "casadi.optimal_control": "collocation Collocation", "casadi.optimum": "Optimum",
        "casadi.exporting": "export_casadi ExportedCasadi",
        "model.loading": "load_model parse_model", "model.builder": "ModelBuilder",
        "importing.importer": "Imported import_model from_mujoco from_pinocchio",
        "runtime.loading": "load load_trajectory",
        "runtime.standalone.solver": "Solver", "runtime.standalone.calls.package": "Package",
        "runtime.standalone.trajectory.trajectory": "Trajectory", "runtime.standalone.trajectory.events": "Event Crossing",
        "runtime.standalone.motion.controllers": "Sample",
        "runtime.standalone.motion.functionals": "Final At Integral AtEvent LeastSquares Judged",
        "runtime.standalone.motion.ode": "Ode",
        "runtime.standalone.state.derivatives": "Jacobians Gradients HessianProducts InverseDynamicsProducts",
        "runtime.standalone.state.frame_motion": "FrameMotion PointMotion",
        "runtime.standalone.statics.equilibrium": "Equilibrium",
        "runtime.standalone.statics.linearization": "Linearization Matrices Modes",
        "runtime.standalone.trust.diagnosis": "Diagnosis MassCondition ClosureCondition",
        "importing.sympy_model": "from_sympy", "reference.engine": "Engine Jacobians", "reference.dense": "DenseEngine",
        "reference.recursive": "RecursiveEngine", "symbolic.motion": "Equations equations",
        "symbolic.recursion": "Recursion statements", "model.sympy_output": "to_sympy", "model.model": "Model",
        "model.forces.line_law": "LineLaw Coefficient", "emit.target": "Target Scalar InstructionSet",
        "measure.clock": "Seconds Rounds elapsed calibrated repeated alternate turns in_rounds exponent summary cores one_core",
        "bench.work_precision": "Point integrate error_at_end diagram best seconds_at",
        "design.variables": "Variable Variables", "design.objective": "OfVariables Objective objective",
        "design.outcome": "Outcome", "design.evaluated_points": "Evaluation", "design.load_cases": "LoadCases",
        "design.optimizing": "optimize", "design.fitting": "fit", "design.fit_result": "Fit",
        "design.many_motions": "Motions simulate_many", "design.sweep": "sweep", "design.sweep_result": "Sweep",
    }.items()
    for name in names.split()
]  # fmt: skip
"""Functions, and classes with all their public members."""


def members(name: str) -> Iterator[str]:
    """The name itself, and those of public methods and properties of a class that describes them.

    A method without a docstring has that of its base class. The class of an engine describes the arguments of all methods.
    """
    yield name
    found = named(name)
    if not inspect.isclass(found) or issubclass(found, Engine):
        return
    for member, value in vars(found).items():
        described = value.__doc__ or not inspect.getdoc(value)
        wrapped = inspect.isfunction(value) or isinstance(value, (property, classmethod, staticmethod))
        if member[0] != "_" and described and (wrapped or hasattr(value, "func")):
            yield f"{name}.{member}"


def named(name: str) -> Any:
    """An object by its module and name."""
    module, _, rest = name.rpartition(".")
    try:
        return getattr(importlib.import_module(module), rest)
    except ModuleNotFoundError:
        return inspect.getattr_static(named(module), rest)


OPEN = (Package,)
"""Classes whose subclasses are checked where they are defined."""
PUBLIC = [member for name in FUNCTIONS for member in members(name)]


def test_all_that_ordernm_exports_is_checked():
    exported = [getattr(codegen, n) for n in codegen.__all__ if n != "__version__"]
    exported += [getattr(codegen.runtime, n) for n in codegen.runtime.__all__]
    checked = tuple(named(n) for n in FUNCTIONS)
    left = [
        x.__name__ for x in exported if not (x in checked or (inspect.isclass(x) and issubclass(x, (Exception, *OPEN))))
    ]
    assert left == []


def test_functions_that_the_api_page_lists_are_checked():
    page = (Path(codegen.__file__).parents[1] / "docs" / "api.md").read_text(encoding="utf-8")
    rows = " ".join(re.findall(r"^\| (`.*?) \|", page, re.MULTILINE))
    listed = {n for n in re.findall(r"(\w+)\(", rows) if not n.startswith("NAME_")}
    assert len(listed) > 50
    assert listed - {n.rpartition(".")[2] for n in PUBLIC} == {
        "f",
        "load_cases",
    }  # f(x) is an objective's value; LoadCases


@pytest.mark.parametrize("name", PUBLIC)
def test_a_docstring_has_its_sections(name):
    found = validate.validate(name)
    codes = CHECKED if inspect.isfunction(named(name)) else OF_PROPERTIES
    assert [message for code, message in found["errors"] if code in codes] == [], found["docstring"]


@pytest.mark.parametrize("name", sorted(n for n in set(vars(Engine)) & set(vars(Solver)) if n[0] != "_"))
def test_a_method_of_an_engine_takes_arguments_of_solver(name):
    of_engine, of_solver = (inspect.signature(getattr(x, name)).parameters for x in (Engine, Solver))
    assert getattr(Engine, name).__doc__
    assert [n for n in of_engine if n != "seeds"] == [n for n in of_solver if n in of_engine]
    assert ("seeds" in of_engine) == any(n.startswith("d") for n in of_solver)


@pytest.fixture(scope="module")
def names(tmp_path_factory) -> dict[str, Any]:
    return namespace(tmp_path_factory.mktemp("docs"))


ROOT = Path(codegen.__file__).parents[1]
MODULES = sorted(
    ".".join(p.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for p in (ROOT / "codegen").rglob("*.py")
    if ">>> " in p.read_text(encoding="utf-8")
)
"""Modules with examples, those of functions that are not public too."""


@pytest.mark.parametrize("module", MODULES)
def test_examples_print_what_they_show(module, names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    if module.startswith("codegen.casadi"):
        pytest.importorskip("casadi", reason="CasADi is not installed: pip install -e '.[casadi]'")
    for library in ("jax", "torch"):
        if module.startswith(f"codegen.{library}"):
            pytest.importorskip(library, reason=f"{library} is not installed: pip install -e '.[{library}]'")
    found = importlib.import_module(module)
    tests = [t for t in doctest.DocTestFinder().find(found) if t.examples]
    assert tests
    said: list[str] = []
    for test in tests:
        test.globs = vars(found) | names
        doctest.DocTestRunner(optionflags=FLAGS).run(test, out=said.append)
    assert "".join(said) == ""
