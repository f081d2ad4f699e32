"""Statements in sympy: their number equals the program's, each has a number and a tag, and they give the solver's results."""

import re
import xml.dom.minidom
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import sympy

import codegen
from codegen.cli import main
from codegen.loops.partition import partition
from codegen.mechanics.statements import expanded, laid_out
from codegen.program.procedure import Formulas, walk
from codegen.reference import RecursiveEngine
from codegen.symbolic import SymbolicError, statements
from codegen.symbolic.pages import statements_page
from codegen.symbolic.recursion_writing import as_latex

EXAMPLES = Path(__file__).parents[2] / "examples"


def of_program(model, functions) -> int:
    """The number of statements and stores of a model's program."""
    chosen = partition(model) if model.loops else None
    if chosen is not None:
        model = model.with_turned(chosen.turned)
    system, _ = laid_out(model, "auto", chosen, turning=True)
    program, plan, asked = expanded(system, False, functions=functions)
    backwards = {t for p in asked for s in walk(p.steps) if isinstance(s, Formulas) and s.backwards for t in s.targets}
    blocks = [b for of in program.blocks.values() for b in of.values()] + [
        s.block for s in plan.shapes if s.block.stores
    ]
    blocks += [b for f in plan.formulas for b in (f.value, f.tangent)]
    blocks += [f.transposed for f in plan.formulas if f.target in backwards]
    return sum(len(b.statements) + len(b.stores) for b in blocks)


@pytest.mark.parametrize(
    ("name", "functions"), [("double_pendulum", None), ("four_bar", None), ("chain", ["accelerations", "gradients"])]
)
def test_a_page_has_every_statement_with_its_number(name, functions):
    model = codegen.load_model(EXAMPLES / f"{name}.yaml")
    found = statements(model, functions=functions)
    assert found.count == of_program(model, functions)
    assert [a.number for a in found] == list(range(1, found.count + 1))
    assert all(a.tag for a in found)
    page = statements_page(found)
    assert page.count('<div class="eq') == found.count and f"{found.count} statements" in page
    formulas = re.findall(r"<math .*?</math>", page)
    assert len(formulas) == found.count
    for formula in formulas:
        xml.dom.minidom.parseString(formula)
    assert not re.search(r"<script|<link|<img|src=|@import", page)
    assert set(re.findall(r"https?://[^\"]*", page)) == {"http://www.w3.org/1998/Math/MathML"}
    assert as_latex(found).count("\\tag*{") == found.count


def test_statements_of_forward_dynamics_give_its_accelerations():
    """Memory is known by its owner: what a link stores for its parent is what the parent reads."""
    model = codegen.load_model(EXAMPLES / "double_pendulum.yaml")
    found = statements(model, functions=["accelerations"])
    rng = np.random.default_rng(4)
    q, u = rng.normal(size=2), rng.normal(size=2)
    known = {f"q.{n}": x for n, x in zip(model.coordinate_names, q, strict=True)}
    known |= {f"u.{n}": x for n, x in zip(model.speed_names, u, strict=True)} | model.defaults
    memory: dict = defaultdict(float)
    memory["ground", "a.z", False] = 9.81
    sweeps = {sweep.name: sweep for sweep in found.sweeps}
    for name in ("constants", "formulas", "kinematics", "triangularize", "back_substitute"):
        for unit in sweeps[name].units:
            local: dict = {}
            for a in unit.assignments:
                if a.each_direction:
                    continue
                values = {}
                for symbol in a.value.free_symbols:
                    of = unit.kept.get(symbol)
                    if of is not None:
                        values[symbol] = memory[of.owner, of.component.replace("yy", "xx"), of.each_direction]
                    else:
                        values[symbol] = local.get(symbol.name, known.get(symbol.name, 0.0))
                value = float(a.value.subs(values))
                of = unit.kept.get(a.target)
                if of is not None:
                    key = of.owner, of.component.replace("yy", "xx"), of.each_direction
                    memory[key] = memory[key] + value if a.adds else value
                elif "." in a.target.name:
                    known[a.target.name] = value
                else:
                    local[a.target.name] = value
    udot = [known[f"udot.{n}"] for n in model.speed_names]
    assert np.abs(udot - RecursiveEngine(model).accelerations(q, u)).max() < 1e-12


def test_primitives_are_derivatives_of_statements():
    """The primitives of a link's constants are sympy's derivatives of its constants."""
    (sweep,) = (s for s in statements(codegen.load_model(EXAMPLES / "four_bar.yaml")).sweeps if s.name == "constants")
    checked = 0
    for unit in sweep.units:
        values: dict = {}
        for a in unit.assignments:
            values[a.target] = a.value.subs(values)
        for target, value in values.items():
            field, slash, parameter = target.name.partition("/")
            if slash:
                of = values[sympy.Symbol(field, real=True)]
                assert sympy.expand(sympy.diff(of, sympy.Symbol(parameter, real=True)) - value) == 0
                checked += 1
    assert checked > 5


def test_commands_write_pages_and_name_what_is_wrong(tmp_path, capsys):
    model, page = str(EXAMPLES / "pendulum.yaml"), tmp_path / "page.html"
    assert main(["statements", model, "--html", "-o", str(page)]) == 0
    assert "wrote" in capsys.readouterr().out and "statements" in page.read_text(encoding="utf-8")
    assert main(["statements", model, "--html", "-o", str(page)]) == 0  # its own file
    capsys.readouterr()
    page.write_text("mine")
    assert main(["statements", model, "--html", "-o", str(page)]) == 2
    assert "ordernm did not write it" in capsys.readouterr().err and page.read_text() == "mine"
    assert main(["statements", model, "--functions", "acelerations"]) == 1
    assert "acelerations" in capsys.readouterr().err
    for flag in ("--html", "--mathml", "--latex"):
        assert main(["equations", model, flag]) == 0
        assert "bar" in capsys.readouterr().out
    assert main(["equations", model, "--form", "embedded"]) == 1
    assert "no closed loops" in capsys.readouterr().err
    assert main(["equations", model, "--set", "length"]) == 2
    assert "give NAME=VALUE" in capsys.readouterr().err
    assert main(["equations", model, "--set", "lenght=2"]) == 1
    assert "did you mean 'length'" in capsys.readouterr().err
    with pytest.raises(SymbolicError, match="acelerations"):
        statements(codegen.load_model(model), functions=["acelerations"])
