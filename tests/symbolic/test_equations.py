"""Equations of motion in sympy equal those of generated solvers at random states."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy
from equation_agreement import Agreement, accelerations, difference

import codegen
from codegen.model import Model
from codegen.model.errors import ModelError
from codegen.symbolic import Equations, SymbolicError, TooLargeError, equations, motion, statements
from codegen.symbolic.pages import equations_page
from codegen.symbolic.recursion_writing import as_latex as statements_latex
from codegen.symbolic.writing import as_latex, as_sympy, as_text

EXAMPLES = Path(__file__).parents[2] / "examples"

TOP = """
model: top
gravity: [0, 0, -g]
parameters: {g: 9.81, mass: 0.3, height: 0.05, across: 2.0e-4, along: 3.0e-4}
bodies:
  top:
    parent: ground
    joint: {type: spherical}
    mass: mass
    com: [0, 0, height]
    inertia: {xx: across, yy: across, zz: along}
"""


ELEMENTS = """
model: elements
gravity: [0, 0, -9.81]
parameters: {k: 30, mass: 2}
inputs: [push]
bodies:
  slide:
    parent: ground
    joint: {type: prismatic, axis: x}
    mass: mass
  arm:
    parent: slide
    joint: {type: revolute, axis: y, at: [0, 0, 0.3], armature: 0.1}
    mass: 1.5
    com: [0, 0.1, -0.4]
    inertia: {xx: 0.02, yy: 0.03, zz: 0.01, xz: 0.002}
  tip:
    parent: arm
    joint: {type: revolute, axis: x, at: [0, 0, -0.8]}
    mass: 0.5
    com: [0, 0, -0.2]
points:
  end: {body: tip, at: [0, 0.05, -0.4]}
  wall: {body: ground, at: [1, 0.2, 0.1]}
forces:
  spring: {type: spring, from: wall, to: end, stiffness: k, damping: 0.4, free_length: 0.5}
  twist: {type: torsion, from: {body: slide}, to: {body: arm}, axis: y, stiffness: 2, damping: 0.1}
  rubber: {type: bushing, from: {body: arm, at: [0, 0, -0.8]}, to: {body: tip}, stiffness: [10, 20, 30],
           rotational_stiffness: [1, 2, 3], damping: [1, 1, 1], rotational_damping: [0.1, 0.1, 0.1]}
  wind: {type: force, on: end, value: [push, 0, 0.3*velocity.end.z]}
  stop: {type: joint, joint: slide, value: "if(q.slide > 0.1, -40*(q.slide - 0.1), 0) - max(u.slide, 0.2) + abs(q.arm)"}
outputs:
  height: {position: end, axis: z}
  far: {distance: [wall, end]}
  kinetic: kinetic_energy
  potential: potential_energy
  turn: {rotation: tip, entry: xy}
  acceleration: {acceleration: end, axis: x}
  spin: {momentum: angular, axis: y}
  mode: {value: "mod(q.arm, 0.5) + step(q.slide, 0, 1)"}
"""

COUPLED = """
model: coupled
gravity: [0, 0, -9.81]
parameters: {ratio: 2, radius: 0.5, length: 0.7}
bodies:
  wheel: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 0.1, yy: 0.2, zz: 0.1}}
  rack: {parent: ground, joint: {type: prismatic, axis: x}, mass: 3}
  rod: {parent: rack, joint: {type: spherical}, mass: 1, com: [0, 0, -0.3], inertia: {xx: 0.03, yy: 0.03, zz: 0.001}}
  motor: {parent: rack, joint: {type: revolute, axis: z}, mass: 1, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
couplings:
  gear: {joint: rack, follows: {wheel: radius}}
motion: {motor: 0.3*sin(2*t)}
"""

SMALL = {"top": TOP, "elements": ELEMENTS, "coupled": COUPLED}


def read(name: str) -> Model:
    return codegen.parse_model(SMALL[name], name) if name in SMALL else codegen.load_model(EXAMPLES / f"{name}.yaml")


@pytest.mark.parametrize("intermediates", [False, True], ids=["expanded", "intermediates"])
@pytest.mark.parametrize(
    ("name", "form"),
    [
        ("pendulum", "tree"), ("double_pendulum", "tree"), ("swing_up", "tree"), ("top", "tree"),
        ("four_bar", "multipliers"), ("four_bar", "embedded"), ("slider_crank", "multipliers"), ("slider_crank", "embedded"),
        ("elements", "tree"), ("coupled", "multipliers"), ("coupled", "embedded"),
    ],
)  # fmt: skip
def test_equations_are_those_of_the_solver(name, form, intermediates, tmp_path):
    model = read(name)
    check(model, equations(model, form=form, intermediates=intermediates), tmp_path)


@pytest.mark.campaign
@pytest.mark.parametrize("form", ["multipliers", "embedded"])
@pytest.mark.parametrize("name", ["stewart", "planar_3rrr", "bricard", "double_wishbone", "ladder", "hooke_ladder"])
def test_equations_of_large_mechanisms_are_those_of_the_solver(name, form, tmp_path):
    model = read(name)
    check(model, equations(model, form=form, intermediates=True), tmp_path)


def check(model: Model, found: Equations, folder: Path) -> None:
    """Check the equations at five states that close the loops."""
    codegen.generate(model, folder / "made", target="numpy", compile=False, check=False)
    solver = codegen.load(folder / "made")
    agreement, rng = Agreement(model, solver, found), np.random.default_rng(len(model.name))
    for _ in range(5):
        p = solver.parameters * rng.uniform(0.98, 1.02, len(solver.parameters))
        inputs, t = rng.normal(size=len(model.inputs)), rng.uniform()
        q, u = solver.initial
        q, u = q + rng.normal(size=len(q)) * 0.03, rng.normal(size=len(u))
        state = (*solver.assemble(q, u, p, inputs, t), p, inputs, t)
        udot = accelerations(found, agreement.evaluate(*state))
        assert difference(udot, solver.accelerations(*state)) < 1e-12
        errors = agreement.errors(state)
        assert max(errors.values()) < 1e-12, errors
    assert not found.outputs.refused


def test_quaternions_in_outputs_are_those_of_the_solver(tmp_path):
    """At turns of any size, where another component is the largest."""
    outputs = "".join(f"\n  {e}: {{rotation: top, entry: {e}}}" for e in ("qw", "qx", "qy", "qz"))
    model = codegen.parse_model(f"{TOP}outputs:{outputs}", "top")
    codegen.generate(model, tmp_path / "made", target="numpy", compile=False, check=False)
    found, rng = equations(model, intermediates=True), np.random.default_rng(0)
    agreement = Agreement(model, codegen.load(tmp_path / "made"), found)
    p = [x.value for x in model.parameters]
    errors = [agreement.errors((rng.normal(size=4), rng.normal(size=3), p, [], 0.0)) for _ in range(30)]
    assert not found.outputs.refused and max(max(e.values()) for e in errors) < 1e-12
    assert found.outputs["qx"].has(sympy.Piecewise)


def test_numbers_are_exact_and_terms_are_few():
    """A person would write the mass matrix of the double pendulum with these terms."""
    found = equations(read("double_pendulum"))
    l1, l2, m2 = (found.symbol(name) for name in ("length_1", "length_2", "mass_2"))
    across = sympy.Rational(1, 7500)  # 0.02 m in radius: three tenths of 0.02**2
    expected = l2**2 * m2 / 3 + m2 * across
    assert found.M[1, 1] == expected
    assert found.M[0, 1] == expected + l1 * l2 * m2 * sympy.cos(found.q[1]) / 2
    assert not found.M.atoms(sympy.Float) | found.forcing.atoms(sympy.Float)


def test_parameters_are_given_by_name_or_as_the_model_has_them():
    model = read("pendulum")
    of_values = equations(model, parameters="values")
    assert of_values.parameters == () and of_values.M.free_symbols == set()
    one = equations(model, parameters={"length": sympy.Rational(1, 2)})
    assert one.M == equations(model).subs({"length": 0.5}).M
    assert [p.name for p in one.parameters] == [n for n in model.parameter_names if n != "length"]
    with pytest.raises(SymbolicError, match=r"no parameter 'lenght'; it has .*; did you mean 'length'"):
        equations(model, parameters={"lenght": 1})
    with pytest.raises(SymbolicError, match="neither a number nor an expression"):
        equations(model, parameters={"length": "1 m"})
    for wrong in (sympy.I, sympy.zoo, sympy.oo, sympy.nan, float("inf"), 1j, sympy.Float("1e400"), 2 * sympy.I):
        with pytest.raises(SymbolicError, match="is not a finite number; finite real numbers and expressions"):
            equations(model, parameters={"length": wrong})
        with pytest.raises(SymbolicError, match="is not a finite number"):
            one.subs({"mass": wrong})
    with pytest.raises(SymbolicError, match="neither a number nor"):
        equations(model, parameters={"length": sympy.Matrix([1])})
    with pytest.raises(SymbolicError, match="the value of length contains t, which changes; parameters are constant"):
        equations(model, parameters={"length": sympy.Symbol("t")})
    with pytest.raises(SymbolicError, match="is not a mapping"):
        equations(model, parameters=[1])
    with pytest.raises(SymbolicError, match="'embedded' is not possible; pendulum has no closed loops"):
        equations(model, form="embedded")


def test_large_equations_are_refused_with_their_expected_size():
    chain = "model: chain\ngravity: [0, 0, -9.81]\nparameters: {length: 1, mass: 2}\nbodies:\n"
    for k in range(20):
        parent, at = (f"link_{k - 1}", "[0, 0, -length]") if k else ("ground", "[0, 0, 0]")
        axis = "xyz"[k % 3]
        joint = f"{{type: revolute, axis: {axis}, at: {at}}}"
        chain += f"  link_{k}: {{parent: {parent}, joint: {joint}, mass: mass, com: [0, 0.1, -length]}}\n"
    with pytest.raises(TooLargeError, match=r"the equations of chain have about \de\+\d\d terms; allowed are 20000"):
        equations(codegen.parse_model(chain, "chain"))
    small = r"intermediates=True, --intermediates\), which give \d+ terms, give numbers .*force=True, --force-size"
    with pytest.raises(TooLargeError, match=r"have about \de\+\d\d terms in the embedded form; .*" + small):
        equations(read("planar_3rrr"), form="embedded")


def test_equations_are_refused_once_they_take_too_many_products(monkeypatch):
    monkeypatch.setattr(motion, "MOST_PRODUCTS", 3000)
    with pytest.raises(TooLargeError, match=r"have up to [1-9]e\+0\d terms; allowed are 20000"):
        equations(read("four_bar"))
    assert equations(read("four_bar"), force=True).terms > 200


def test_long_sums_are_computed_in_parts():
    """The compiler of Python does not take a thousand operators in a row."""
    x, k = sympy.symbols("length k", real=True)
    long = sympy.Add(*(n * x ** (n % 7) * sympy.cos(n * k) for n in range(2000)))
    found = replace(
        equations(read("pendulum"), parameters="values"), parameters=(x, k), forcing=sympy.Matrix([x * (long + 1)]),
        defaults={k: 1, x: 2},
    )  # fmt: skip
    expected = 2 * (1 + sum(n * 2 ** (n % 7) * np.cos(n) for n in range(2000)))
    assert found.lambdify()([0.1], [0.0])["forcing"][0, 0] == pytest.approx(expected, rel=1e-12)
    made: dict = {}
    exec(as_sympy(found), made)
    assert made["forcing"] == found.forcing


def test_long_sums_inside_of_others_are_named_in_latex():
    """TeX has no lines of metres: a sum of many terms within a product is printed before."""
    text = as_latex(equations(read("elements")))
    named = [int(n) for n in re.findall(r"^y_\{(\d+)\} & =", text, re.M)]
    assert named == list(range(1, len(named) + 1)) and named
    for n in named:
        first = re.search(rf"y_\{{{n}\}}", text)
        assert first is not None and text[first.end() :].startswith(" & ="), "it is used before"


@pytest.mark.campaign
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="there is no pdflatex on this machine")
@pytest.mark.parametrize("name", ["double_pendulum", "elements", "four_bar", "slider_crank", "excavator", "coupled"])
def test_latex_compiles(name, tmp_path):
    model = read(name)
    found = [as_latex(equations(model, intermediates=x)) for x in (False, True)]
    found.append(statements_latex(statements(model, functions=["accelerations"])))
    packages = "\\usepackage{amsmath}\\usepackage[a3paper,landscape,margin=1cm]{geometry}\\allowdisplaybreaks"
    body = "\n".join(found)
    text = f"\\documentclass{{article}}{packages}\\begin{{document}}\n{body}\\end{{document}}\n"
    (tmp_path / "made.tex").write_text(text)
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "made.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]


def test_names_of_intermediates_are_no_names_of_the_model():
    text = TOP.replace("height", "z1").replace("across", "zz2")
    found = equations(codegen.parse_model(text, "top"), intermediates=True)
    assert {"z1", "zz2"} <= {s.name for s in found.parameters} and next(iter(found.intermediates)).name == "zzz1"
    assert found.symbol("zzz1") in found.subs({"z1": 0.1}).intermediates


def test_a_module_of_sympy_makes_the_same_matrices(tmp_path):
    found = equations(read("four_bar"), form="embedded")
    file = tmp_path / "four_bar_equations.py"
    command = [
        sys.executable,
        "-m",
        "codegen",
        "equations",
        str(EXAMPLES / "four_bar.yaml"),
        "--form",
        "embedded",
        "--sympy",
    ]
    subprocess.run([*command, "-o", str(file)], check=True, capture_output=True)
    made: dict = {}
    exec(compile(file.read_text(), str(file), "exec"), made)
    for name, matrix in found.matrices.items():
        assert made[name] == matrix, name
    shorter: dict = {}
    of_z = equations(read("four_bar"), form="embedded", intermediates=True)
    exec(as_sympy(of_z), shorter)
    assert shorter["intermediates"] == list(of_z.intermediates.items()) and shorter["M"] == of_z.M
    assert made["defaults"] == found.defaults and made["outputs"] == dict(found.outputs)
    file.write_text("mine")
    refused = subprocess.run([*command, "-o", str(file)], check=False, capture_output=True, text=True)
    assert (
        refused.returncode == 2
        and "ordernm did not write it; give another name, or --force-file" in refused.stderr
        and file.read_text() == "mine"
    )


def test_generating_imports_no_sympy(tmp_path):
    """Sympy is for who asks for it: reading, generating and loading take none of it."""
    said = (
        "import sys, codegen, codegen.symbolic\n"
        f"model = codegen.load_model({str(EXAMPLES / 'four_bar.yaml')!r})\n"
        f"codegen.generate(model, {str(tmp_path / 'made')!r}, target='numpy', compile=False, check=False)\n"
        f"codegen.load({str(tmp_path / 'made')!r})\n"
        "print('sympy' in sys.modules)"
    )
    assert (
        subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True).stdout.split()[-1]
        == "False"
    )


BAR = "joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -1]"


def test_models_without_equations_are_named():
    def model(rest: str) -> Model:
        return codegen.parse_model(f"model: bar\nbodies:\n  bar: {{parent: ground, {BAR}}}\n{rest}", "bar")

    ends = "from: {body: bar, at: [0, 0, -1]}, to: {body: ground, at: [9, 0, 0]}"
    far = f"loops:\n  far: {{joint: {{type: revolute, axis: y}}, {ends}}}"
    with pytest.raises(ModelError, match="loop far"):
        equations(model(far))
    points = "points: {one: {body: bar, at: [0, 0, 0]}, other: {body: ground, at: [0, 0, 0]}}\n"
    spring = "forces:\n  spring: {type: spring, from: one, to: other, stiffness: 3, free_length: 1}"
    with pytest.raises(SymbolicError, match="spring spring: its two points coincide"):
        equations(model(points + spring))
    moved = equations(model("motion: {bar: sin(t)}"))
    assert moved.M.shape == (0, 0) and moved.lambdify()([], [])["forcing"].shape == (0, 1)
    for write in (as_text, as_latex, as_sympy, equations_page):
        assert "bar" in write(moved)
