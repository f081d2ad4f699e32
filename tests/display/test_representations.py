"""Results of public functions have a short `repr`, and valid HTML in which names are escaped."""

import inspect
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import ordernm
from codegen.html_tables import SHOWN, html_of
from codegen.runtime.standalone.display.poses import Poses
from codegen.runtime.standalone.state.derivatives import HessianProducts, InverseDynamicsProducts
from codegen.runtime.standalone.statics.curvature import EquilibriumProducts
from ordernm.runtime import Event, Final

EXAMPLES = Path(__file__).parents[2] / "examples"
LONGEST = 1200
"""Characters of a `repr`, which has one line or a few."""

EVIL = "<script>alert('&')</script>"

MODEL = """
model: seen
gravity: [0, 0, -9.81]
parameters: {length: 1.0, weight: {value: 2.0, unit: kg}}
inputs: [torque]
bodies:
  upper:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: rod, axis: z, length: length, mass: weight, center: [0, 0, -length/2]}
  lower:
    parent: upper
    joint: {type: revolute, axis: y, at: [0, 0, -length]}
    shape: {type: rod, axis: z, length: length, mass: 1, center: [0, 0, -length/2]}
points: {tip: {body: lower, at: [0, 0, -length]}}
forces:
  motor: {type: joint, joint: upper, value: torque - 0.2*u.upper}
  damper: {type: joint, joint: lower, value: -0.2*u.lower}
initial: {q: {upper: 0.3, lower: 0.2}}
outputs: {x: {position: tip, axis: x}, height: {position: tip, axis: z}}
"""


class Page(HTMLParser):
    """The tags of a text, all of which must be closed, and its words."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.words = [], [], []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in ("br", "iframe"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag != "iframe":
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seen") / "seen"
    ordernm.generate(ordernm.parse_model(MODEL), folder, frames=True)
    return ordernm.load(folder)


@pytest.fixture(scope="module")
def results(solver, tmp_path_factory):
    """One object of each class that public functions return, by name."""
    folder = tmp_path_factory.mktemp("made")
    q, u = solver.initial
    times = np.linspace(0, 0.5, 6)
    run = solver.simulate(times, sensitivities="length", events=[Event("height", -1.85, stop=False)])
    model = ordernm.parse_model(MODEL)
    objective = ordernm.objective(solver, 0.5, Final("x"), {"length": (0.5, 1.5)})
    rest = solver.equilibrium(q=[0.0, 0.0])
    linear = solver.linearize(rest.q)
    (folder / "arm.urdf").write_text(ARM)
    return {
        "Model": model,
        "ModelBuilder": ordernm.ModelBuilder("built"),
        "Imported": ordernm.import_model(folder / "arm.urdf"),
        "Report": ordernm.generate(model, folder / "numpy", target="numpy"),
        "Solver": solver,
        "Extended": solver.in_precision(30),
        "Jacobians": solver.jacobians(q, u),
        "Gradients": solver.gradients(q, u, weights=np.eye(2)),
        "HessianProducts": HessianProducts(*np.ones((4, 2, 2)), np.ones(2)),
        "InverseDynamicsProducts": InverseDynamicsProducts(*np.ones((5, 2, 2)), np.ones(2)),
        "EquilibriumProducts": EquilibriumProducts(np.ones((2, 3)), np.ones((2, 1))),
        "FrameMotion": solver.frames(q, u),
        "FrameMotion of many": solver.frames(np.tile(q, (3, 1)), np.tile(u, (3, 1)), accelerations=True),
        "FrameMotion of one": solver.frames(q, u, bodies="upper"),
        "PointMotion": solver.points(q, u),
        "OperationCounts": solver.operations,
        "Equilibrium": rest,
        "Linearization": linear,
        "Modes": linear.modes(),
        "Matrices": linear.sensitivities("length"),
        "Judged": solver.judge(0.5, Final("x"), wrt=["length", "weight"]),
        "Diagnosis": solver.diagnose(q, u),
        "Ode": solver.ode(),
        "ExportedC": ordernm.export_c(model, folder / "c", functions="accelerations"),
        "ExportedFMU": ordernm.export_fmu(model, folder / "model.fmu", platforms="none"),
        "Trajectory": run,
        "Crossing": run.events[0],
        "Objective": objective,
        "Outcome": objective.result([0.5]),
        "LoadCases": ordernm.load_cases([objective]),
        "Fit": ordernm.fit(solver, times, {"x": solver.simulate(times, p={"length": 1.1})["x"]}, "length"),
        "Motions": ordernm.simulate_many(solver, times, p={"length": [0.8, 1.2]}),
        "Sweep": ordernm.sweep(solver, {"length": [0.8, 1.2]}, lambda s, case: {"twice": 2 * case["length"]}),
        "Variable": ordernm.Variable(0.5, 1.5),
        "optimum": ordernm.optimize(objective),
    }


ARM = """<robot name="arm"><link name="base"/><link name="arm">
  <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit effort="1" velocity="1"/></joint></robot>"""

TEXT_ONLY = {"ExportedC", "ExportedFMU", "ModelBuilder", "Ode", "Variable", "optimum"}
"""Objects without HTML: three of one line, a table in text, and SciPy's."""


def test_each_has_a_short_text_and_readable_html(results):
    for name, x in results.items():
        text = repr(x)
        assert 5 < len(text) < LONGEST or name == "OperationCounts", (name, len(text))  # a table of all functions
        assert " object at 0x" not in text and "array(" not in text.split("jac")[0], (name, text)
        if name not in TEXT_ONLY:
            page = Page(x._repr_html_())
            assert page.tags[0] == "div" and "".join(page.words).strip(), name


def test_the_results_are_of_all_classes_that_members_return(results):
    """Classes in the annotations of public functions and of the solver's members."""
    from codegen.runtime.solver import Solver

    known = {type(x).__name__ for x in results.values()} | {"Viewer"}
    functions = [f for n, f in inspect.getmembers(Solver) if inspect.isfunction(f) and n[0] != "_"]
    functions += [f for n in dir(ordernm) if inspect.isfunction(f := getattr(ordernm, n))]
    returned = " ".join(str(f.__annotations__.get("return")) for f in functions)
    words = {w for w in returned.replace("[", " ").replace("]", " ").replace(",", " ").split() if w[0].isupper()}
    assert words - known <= {"Array", "Any", "None"}
    assert len(words) >= 12


def test_equations_and_statements_are_short(tmp_path):
    pytest.importorskip("sympy")
    from ordernm.symbolic import equations, statements

    model = ordernm.load_model(EXAMPLES / "four_bar.yaml")
    for x in (equations(model), statements(model)):
        assert len(repr(x)) < 200 and "four_bar" in repr(x)
        assert "four_bar" in "".join(Page(x._repr_html_()).words)


def test_tables_show_values_and_names(results, solver):
    page = Page(results["Equilibrium"]._repr_html_())
    assert "q.upper" in page.words
    page = Page(results["Jacobians"]._repr_html_())
    assert "(2, 2)" in page.words and f"{np.abs(results['Jacobians'].q).max():.6g}" in page.words
    assert "upper" in Page(results["FrameMotion"]._repr_html_()).words
    page = Page(results["Modes"]._repr_html_())
    assert f"{results['Modes'].frequencies[0]:.6g}" in page.words
    assert f"{results['Fit']['length']:.6g}" in Page(results["Fit"]._repr_html_()).words
    assert "length" in "".join(Page(results["Sweep"]._repr_html_()).words)


def test_texts_are_escaped_and_long_tables_cut():
    page = html_of([EVIL], (EVIL,), [(EVIL,)] * (SHOWN + 3))
    assert "<script" not in page and f"and {3} more" in Page(page).words
    assert Page(page).words.count(EVIL) == SHOWN + 2
    assert len(html_of([], ("x",), [("y" * 1000,)])) < 400
    assert html_of([], ("x",), []) == "<div><p></p></div>"
    found = Page(html_of(["numbers"], ("a", "b", "c"), [(1.23456789, None, np.int64(7))])).words
    assert found[-2:] == ["1.23457", "7"]


def test_names_from_files_are_escaped():
    model = ordernm.parse_model(MODEL)
    object.__setattr__(model.bodies[0], "name", EVIL)
    assert "<script" not in model._repr_html_()


def test_a_view_shows_itself_as_a_frame():
    pytest.importorskip("viser")
    from codegen.runtime.standalone.display.scene import Scene
    from codegen.runtime.standalone.display.viewer import Viewer

    view = Viewer("empty", Scene(("a",)), Poses(np.zeros(1), np.eye(3)[None, None], np.zeros((1, 1, 3))), Path())
    try:
        assert view.url in repr(view) and view.url in view._repr_html_()
    finally:
        view.close()
