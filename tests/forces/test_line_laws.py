"""Laws along a line, each a declaration: properties of all, errors of wrong declarations, and two motions in closed form."""

from __future__ import annotations

import math
import pickle
import re
import textwrap
from pathlib import Path
from typing import Annotated, Any, Union

import mpmath
import numpy as np
import pytest
from force_elements import TREE, loop_errors, power, problems, tree_errors, with_elements
from line_law_energies import check_energy
from pydantic import Field
from random_models import random_state

import codegen
from codegen.mechanics.elements import LAWS as GENERATED
from codegen.mechanics.elements.along_line import AlongLineLaw
from codegen.model import parse_model
from codegen.model.forces import ALONG_LINES, FORCES, line_laws, other_words, told_apart
from codegen.model.forces.along_line import element_of, entry_of
from codegen.model.forces.line_law import Coefficient, LineLaw, LineLawError
from codegen.model.forces.line_law_table import with_table
from codegen.model.forces.line_laws import LINE_LAWS
from codegen.model.sections import elements as section
from codegen.pipeline import write_solver
from codegen.reference import DenseEngine
from codegen.reference.arithmetic import Arithmetic
from codegen.reference.forces import LAWS, End
from codegen.reference.pairs import Pair, Pairs
from codegen.runtime import SingularForceError

DOCS = Path(__file__).parents[2] / "docs"
STRETCHED = "band: {type: hardening_spring, from: tip, to: d, stiffness: k, hardening: 0.4*k, damping: 0.3*pull, free_length: l}"


def entry(law: LineLaw, n: int = 0) -> str:
    """The entry of an element on `TREE` and `LOOP`; its coefficients contain parameters, an input and time."""
    factors = ("0.3*k", "(1 + 0.1*pull)", "(1 + 0.2*sin(t))", "l")
    values = [
        f'{key}: "{sum(c.between) / 2:g}*{factors[(i + n) % len(factors)]}"'
        for i, (key, c) in enumerate(law.coefficients.items())
    ]
    return f"e_{law.type}: {{type: {law.type}, from: {{body: a, at: [0, 0.2, l]}}, to: tip, {', '.join(values)}}}"


EVERY = "\n".join(entry(law, n) for n, law in enumerate(LINE_LAWS.values()))


def test_every_law_on_a_tree(tmp_path: Path) -> None:
    errors = tree_errors(EVERY, tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


def test_every_law_in_a_loop_compiled(tmp_path: Path) -> None:
    errors = loop_errors(EVERY, tmp_path / "m", "c")
    assert max(errors.values()) < 1e-9, errors


@pytest.mark.parametrize("law", LINE_LAWS.values(), ids=list(LINE_LAWS))
def test_at_rest_it_acts_down_the_slope_of_its_energy(law: LineLaw) -> None:
    """By the engine's derivatives, not by sympy's."""
    rng = np.random.default_rng(5)
    model = with_elements(TREE, entry(law))
    (element,) = model.loads
    names = {"k": 3.0, "l": 0.5, "pull": 0.4, "t": 0.3}
    pairs = Pairs(Arithmetic(), 6, {n: Pair(x, np.zeros(6)) for n, x in names.items()})
    still = pairs.constant(np.zeros((3, 1)))
    seeds = np.eye(6).reshape(6, 2, 3, 1)
    at = [End(Pair(rng.normal(size=(3, 1)), seeds[:, i]), still, pairs.constant(np.eye(3)), still) for i in range(2)]
    found = np.concatenate([w.force.value[:, 0] for w in LAWS[type(element)].wrenches(element, pairs, at)])
    stored = LAWS[type(element)].energy(element, pairs, at)
    np.testing.assert_allclose(found[:3], -found[3:], rtol=1e-14)
    assert np.abs(found).max() > 1e-2 and (stored is not None) == bool(law.energy)
    if stored is not None:
        np.testing.assert_allclose(found, -stored.tangent, rtol=1e-13)


def test_of_a_damped_law_only_the_damper_takes_energy_away() -> None:
    models = [with_elements(TREE, STRETCHED.replace("0.3*pull", c)) for c in ("0", "1.5")]
    state = random_state(np.random.default_rng(6), models[0])
    (still, stored, _), (done, same, _) = (power(m, state) for m in models)
    assert same == stored and still == pytest.approx(-stored, rel=1e-11)
    engine = DenseEngine(
        with_elements(TREE.replace("height: {position: tip, axis: z}", "d: {distance: [tip, d]}"), STRETCHED)
    )
    q, u, p, *_ = state
    _, rate = engine.output_sensitivities(*state, dq=engine.coordinate_rates(q, u, p)[None])
    assert done - still == pytest.approx(-1.5 * rate[0, 1] ** 2, rel=1e-11)


def test_models_with_every_law_go_from_one_process_to_another() -> None:
    model = with_elements(TREE, EVERY)
    again = pickle.loads(pickle.dumps(model))
    assert [(type(e), e.name, e.values) for e in again.loads] == [(type(e), e.name, e.values) for e in model.loads]


def test_without_hardening_it_is_a_spring() -> None:
    hard = STRETCHED.replace("0.4*k", "0")
    soft = hard.replace("hardening_spring", "spring").replace("hardening: 0, ", "")
    one, other = (with_elements(TREE, e) for e in (hard, soft))
    state = random_state(np.random.default_rng(8), one)
    for name in ("accelerations", "energies", "outputs"):
        found = [np.asarray(getattr(DenseEngine(m), name)(*state)) for m in (one, other)]
        np.testing.assert_allclose(*found, rtol=1e-13, atol=1e-13)


def test_what_is_zero_leaves_nothing_in_the_code() -> None:
    """Nor do speeds of points that only a damper would need."""
    models = (with_elements(TREE, STRETCHED.replace("0.3*pull", c)) for c in ("k", "0"))
    damped, still = ("\n".join(write_solver(m, functions=["accelerations"]).files.values()) for m in models)
    assert "applied_twist" in damped
    assert "applied_twist" not in still


MOTIONS = """
model: curves
parameters: {GM: 1.7, k: 3.0, h: 40.0}
bodies:
  planet: {parent: ground, joint: {type: planar, normal: z}, mass: 1, inertia: {zz: 1}}
  block: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
points: {far: {body: ground, at: [-5, 0, 0]}}
forces:
  sun: {type: inverse_square, from: ground, to: planet, strength: GM}
  duffing: {type: hardening_spring, from: far, to: block, stiffness: k, hardening: h, free_length: 5}
outputs: {stored: potential_energy}
"""


def kepler(t: float, a: float, e: float, gm: float) -> tuple[float, float]:
    """Position on an ellipse, from the perihelion, by Kepler's equation E - e sin E = n t."""
    n = math.sqrt(gm / a**3)
    E = float(mpmath.findroot(lambda x: x - e * mpmath.sin(x) - n * t, n * t))
    return a * (math.cos(E) - e), a * math.sqrt(1 - e * e) * math.sin(E)


def duffing(t: float, x0: float, a: float, b: float) -> float:
    """Solution of x'' = -a x - b x^3 from rest at x0: x0 cn(w t, m), w^2 = a + b x0^2, m = b x0^2/(2 w^2)."""
    square = a + b * x0 * x0
    return float(x0 * mpmath.ellipfun("cn", math.sqrt(square) * t, m=b * x0 * x0 / (2 * square)))


def test_an_orbit_is_an_ellipse_and_a_hard_spring_swings_as_an_elliptic_function(tmp_path: Path) -> None:
    a, e, x0, gm, k, h = 1.3, 0.4, 0.35, 1.7, 3.0, 40.0
    solver = codegen.load(
        codegen.generate(parse_model(MOTIONS), tmp_path / "curves", target="both", compile="all").folder, "c"
    )
    speed = math.sqrt(gm * (1 + e) / (a * (1 - e)))
    q, u = np.array([a * (1 - e), 0, 0, x0]), np.array([0, speed, 0, 0])
    times = np.linspace(0, 9, 10)
    run = solver.simulate(times, q=q, u=u, rtol=1e-12, atol=1e-12)
    wanted = [[*kepler(t, a, e, gm), 0, duffing(t, x0, k / 2, h / 2)] for t in times]
    np.testing.assert_allclose(run.q, wanted, rtol=0, atol=2e-9)
    # at the start the numbers and their derivatives by parameters are those of the formulas
    r = a * (1 - e)
    udot, along = solver.sensitivities(q, u, dp=np.eye(3))
    np.testing.assert_allclose(udot, [-gm / r**2, 0, 0, -(k * x0 + h * x0**3) / 2], rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(
        along[:, [0, 3]], [[-1 / r**2, 0], [0, -x0 / 2], [0, -(x0**3) / 2]], rtol=1e-13, atol=1e-15
    )
    _, stored = solver.energies(q, u)
    assert stored == pytest.approx(-gm / r + k * x0**2 / 2 + h * x0**4 / 4, rel=1e-13)


def test_without_length_it_is_an_error_that_names_it(tmp_path: Path) -> None:
    model = parse_model("""
model: m
bodies:
  slide: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
forces:
  fall: {type: inverse_square, from: ground, to: slide, strength: 2}
""")
    solver = codegen.load(codegen.generate(model, tmp_path / "m", target="numpy").folder)
    for of, message in ((solver, "its ends coincide, so"), (DenseEngine(model), "its two points coincide, so")):
        for function in (of.accelerations, of.energies):
            with pytest.raises((SingularForceError, ValueError), match=f"inverse_square fall: {message}"):
                function([0.0], [1.0])


@pytest.mark.parametrize(
    ("entry", "path", "message"),
    [
        (
            "{type: inverse_square, from: a, to: tip}",
            "",
            "key 'strength' is missing; keys here: type, from, to, strength",
        ),
        (
            "{type: inverse_square, from: tip, to: b, strength: 1}",
            "to",
            "inverse_square 's' joins 'b' to itself, so it *",
        ),
        (
            "{type: inverse_square, from: a, to: tip, strength: u.a}",
            "strength",
            "'u.a', which changes with the motion, *",
        ),
        ("{type: inverse_square, from: a, to: tip, strenght: 1}", "strenght", "*did you mean 'strength'?"),
        (
            "{type: coulomb, from: a, to: tip, strength: 1}",
            "type",
            "unknown force type 'coulomb'; *mean 'inverse_square'?",
        ),
        ("{type: hardening_sprin, from: a, to: tip}", "type", "unknown *did you mean 'hardening_spring'?"),
    ],
)
def test_what_is_wrong_in_an_entry_is_told(entry: str, path: str, message: str) -> None:
    (found,) = problems(f"s: {entry}")
    assert found.startswith(f"forces.s{'.' if path else ''}{path}: "), found
    assert all(part in found for part in message.split("*")), found


# --- laws that are not there ------------------------------------------------------------------------------------------


def added(monkeypatch: pytest.MonkeyPatch, *laws: LineLaw) -> None:
    """Laws in all that is made of the folder's laws, as if each had a file; those that have one are there."""
    elements = [element_of(law) for law in laws if law.type not in LINE_LAWS]
    choice: Any = Annotated[Union[(*FORCES, *map(entry_of, elements))], Field(discriminator="type")]
    monkeypatch.setattr(section, "AnyForce", choice)
    for element in elements:
        monkeypatch.setitem(GENERATED, element, AlongLineLaw(element.law))
        monkeypatch.setitem(LAWS, element, LAWS[ALONG_LINES["actuator"]])
    kept.append(choice)


kept: list[Any] = []
"""Readers are remembered by the identity of these."""


def of_contributing() -> LineLaw:
    """The example of CONTRIBUTING.md in one file."""
    page = (DOCS.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```$", page[page.index("`cube.py`") :], re.DOTALL | re.MULTILINE)
    names: dict[str, Any] = {"__package__": line_laws.__name__}
    exec(compile(textwrap.dedent(code), "cube.py", "exec"), names)
    law: LineLaw = names["LAW"]
    return law


ROPE = LineLaw(
    "rope_of_a_test",
    "Pulls only, with air around it; its keys are words that Pydantic uses.",
    {
        "copy": Coefficient("N/m", "stiffness"),
        "json": Coefficient("m", "length", 0.1),
        "power": Coefficient("1", "of the stretch", 1.5),
    },
    force="-copy*max(0, distance - json)**power - abs(rate)*rate*exp(-distance/2) + tanh(rate)/(1 + distance**2)",
)


def test_the_law_that_contributing_writes_and_one_of_many_functions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    added(monkeypatch, ROPE, of_contributing())
    elements = """
    r: {type: rope_of_a_test, from: a, to: tip, copy: k*(2 + velocity.tip.x)}
    s: {type: rope_of_a_test, from: top, to: d, copy: 1, power: 2}
    c: {type: cube, from: top, to: tip, strength: 3*k}"""
    errors = tree_errors(elements, tmp_path / "m")
    assert max(errors.values()) < 1e-9, errors


def test_numbers_for_which_a_formula_has_no_value_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    coefficients = {"width": Coefficient("m", "of the well"), "depth": Coefficient("J", "of the well")}
    added(monkeypatch, LineLaw("well_of_a_test", "A well.", coefficients, "depth*sqrt(1 - width)*distance/width"))
    for width, message in (("0", "divides by zero"), ("2", "has no real value"), ("1 - 1", "divides by zero")):
        (found,) = problems(f"s: {{type: well_of_a_test, from: a, to: tip, width: {width}, depth: k}}")
        assert found.startswith("forces.s: well_of_a_test, depth*sqrt(1 - width)*distance/width: ") and message in found
    assert not problems("s: {type: well_of_a_test, from: a, to: tip, width: 0.5, depth: k}")


STIFFNESS = {"k": Coefficient("N/m", "stiffness")}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"force": "-k*distanse"}, "force '-k*distanse' contains distanse; names here: distance, rate, k; did you mean"),
        ({"force": "-k*distance*t"}, "force '-k*distance*t' contains t; names here"),
        ({"force": "-k*(distance"}, "the parenthesis is not closed"),
        ({"force": "-k/0"}, "divides by zero"),
        ({"force": "-k*distance", "energy": "k*distance**2/2 + rate"}, "contains rate; names here: distance, k"),
        ({"force": "-distance"}, "k is not in the force '-distance'; use it there, or leave it out"),
        ({"type": "My law"}, "type 'My law' is not a valid type; lower-case letters, digits and _ are allowed"),
        ({"coefficients": {"rate": Coefficient("N", "?")}}, "coefficient 'rate' is a reserved name; reserved names are abs, "),
        ({"coefficients": {"k": "N/m"}}, "coefficient 'k' is 'N/m'; Coefficient(unit, meaning) is needed"),
        ({"misspelt": {"stiffness": "kk"}}, "misspelt takes 'stiffness' for 'kk', which is not a coefficient; there are k"),
        ({"coefficients": {"q": Coefficient("N", "?")}}, "coefficient 'q' is a reserved name"),
        ({"coefficients": {"k-1": Coefficient("N", "?")}}, "coefficient 'k-1' does not consist of lower-case letters"),
        ({"coefficients": {"k": Coefficient("N", "?", between=(2, 1))}}, "k is between 2 and 1; the lower one is needed first"),
    ],
)  # fmt: skip
def test_a_wrong_declaration_is_told(given: dict[str, Any], message: str) -> None:
    with pytest.raises(LineLawError) as info:
        LineLaw(**{"type": "law", "meaning": "?", "coefficients": STIFFNESS, "force": "-k*distance", **given})
    assert message in str(info.value)


def test_a_word_that_is_taken_is_told() -> None:
    taken = entry_of(element_of(LineLaw("spring", "?", STIFFNESS, "-k*distance")))
    with pytest.raises(
        LineLawError, match=r"two types of force elements are called 'spring'; rename the law .*used names are "
    ):
        told_apart(*FORCES, taken)
    with pytest.raises(LineLawError, match="band: other_words has 'damper', which already stands for 'spring'"):
        other_words({"band": LineLaw("band", "?", STIFFNESS, "-k*distance", other_words=("damper",))})
    with pytest.raises(LineLawError, match="band: other_words has 'torque', which is a type"):
        other_words({"band": LineLaw("band", "?", STIFFNESS, "-k*distance", other_words=("torque",))})


def test_a_file_holds_one_law_that_is_called_like_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    law = "from codegen.model.forces.line_law import Coefficient as C, LineLaw\n"
    law += 'LAW = LineLaw("mine", "?", {"k": C("N", "?")}, "k")\n'
    monkeypatch.setattr(line_laws, "__path__", [*line_laws.__path__, str(tmp_path)])
    for name, text, seen in (("mine", law, ""), ("yours", law, "a law of type 'mine'"), ("notes", "", "no law")):
        (tmp_path / f"{name}.py").write_text(text)
        if not seen:
            assert list(line_laws._found()) == sorted([*LINE_LAWS, name])
            continue
        with pytest.raises(
            LineLawError, match=rf"{name}\.py in .*line_laws has {seen}; LAW = LineLaw\('{name}', \.\.\.\) is needed"
        ):
            line_laws._found()
        (tmp_path / f"{name}.py").unlink()


@pytest.mark.parametrize("energy", ["k*distance**2", "-k*distance**2/2", "k*distance**2/2 + 1e-6*distance", "0*k"])
def test_an_energy_that_is_not_the_forces_is_told(energy: str) -> None:
    law = LineLaw("law", "?", STIFFNESS, "-k*distance - k*rate", energy)
    with pytest.raises(
        LineLawError, match=r"law: at distance = .*, k = .* the force at rest is -.* do not belong together"
    ):
        check_energy(law)


def test_an_energy_that_belongs_to_the_force_is_found_to() -> None:
    check_energy(LineLaw("law", "?", STIFFNESS, "-k*max(0, distance - 1) - rate", "k*max(0, distance - 1)**2/2"))
    check_energy(LineLaw("law", "?", STIFFNESS, "-k*sin(distance)/cosh(k)", "-k*cos(distance)/cosh(k)"))
    with pytest.raises(
        LineLawError, match="have values in 0 of 100 places only; let `between` of its coefficients say where"
    ):
        check_energy(LineLaw("law", "?", STIFFNESS, "-k*acos(distance + 5)", "k*acos(distance + 5)"))


@pytest.mark.parametrize("name", sorted(LINE_LAWS))
def test_the_force_of_every_law_belongs_to_its_energy(name: str) -> None:
    check_energy(LINE_LAWS[name])


def test_the_table_of_the_page_is_that_of_the_laws() -> None:
    page = (DOCS / "model_format.md").read_text(encoding="utf-8")
    assert page == with_table(page), "python -m codegen.model.forces.line_law_table docs/model_format.md"
