"""Pages of equations: HTML with MathML, in one file without external resources."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from html import escape

import sympy

from .mathml import MathML, operator, row, scripts, table, word
from .motion import Equations
from .recursion import Recursion, SweepOfUnits, Unit
from .recursion_writing import mathml_symbol
from .writing import entries, is_small, vectors

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 72rem; padding: 0 1rem; color: #222; }
h1, h2, h3 { line-height: 1.2; } h2 { margin: 0; display: inline; font-size: 1.2rem; } h3 { font-size: 1rem; }
details { border-top: 1px solid #ccc; padding: .6rem 0; } summary { cursor: pointer; }
.eq { display: grid; grid-template-columns: 4.5rem 1fr 11rem; align-items: center; padding: .15rem 0; }
.eq > span, .formula { overflow-x: auto; overflow-y: hidden; padding: .15rem 0; } math { font-size: 1.1em; }
.number, .tag { color: #666; font-size: .85rem; } .tag { text-align: right; } .sum mtd { text-align: left; }
.direction { background: #f2f6fb; } .primitive { background: #fbf6ec; }
.names { border-collapse: collapse; } .names td, .names th { border-bottom: 1px solid #ddd; padding: .2rem .6rem; }
.names { text-align: left; }
@media print { body { max-width: none; margin: 0; font-size: 11pt; } .eq { break-inside: avoid; } }
"""

OPEN = 1500
"""Maximum number of statements of a page that shows all sweeps; on a larger page, the reader opens sweeps."""

WIDTH = 110
"""Number of characters of a sum, in sympy's notation, on one line."""


def page(title: str, body: Iterable[str]) -> str:
    """The text of a page of HTML with a title."""
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n" + "\n".join(body) + "\n</body>\n</html>\n"
    )


def _sum(printer: MathML, value: sympy.Expr) -> str:
    """The MathML of a value; a long sum takes several lines."""
    if not value.is_Add:
        return printer(value)
    rows: list[list[str]] = [[]]
    width = 0
    for term, text in zip(value.as_ordered_terms(), printer.terms(value), strict=True):
        width += len(str(term))
        if rows[-1] and width > WIDTH:
            rows.append([])
            width = len(str(term))
        rows[-1].append(text)
    if len(rows) == 1:
        return row(*rows[0])
    return table([[row(*parts)] for parts in rows], 'class="sum" columnalign="left"')


# --- statements -------------------------------------------------------------------------------------------------------


def statements_page(found: Recursion) -> str:
    """The page of all statements: a section for each sweep, a part for each link, the names at the end."""
    body = [f"<h1>{escape(found.name)}: {found.count} statements</h1>", *NOTATION]
    body.append("<p>" + " · ".join(f'<a href="#{s.name}">{escape(s.name)}</a>' for s in found.sweeps) + "</p>")
    is_open = " open" if found.count <= OPEN else ""
    for sweep in found.sweeps:
        body += [f'<details id="{sweep.name}"{is_open}><summary><h2>{escape(sweep.name)}</h2> {_said(sweep)}</summary>']
        for unit in sweep.units:
            body += _unit(unit)
        body.append("</details>")
    if found.fields:
        body += [
            "<h2>Names</h2>",
            "<table><tr><th>name</th><th>in generated code</th><th>unit</th><th>axes of</th><th>meaning</th></tr>",
        ]
        for name, of in found.fields.items():
            body.append("<tr>" + "".join(f"<td>{escape(x)}</td>" for x in (name, *of)) + "</tr>")
        body.append("</table>")
    return page(f"Statements of {found.name}", body)


def _table_row(cell: str, texts: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<{cell}>{escape(x)}</{cell}>' for x in texts)}</tr>"


NOTATION = (
    "<p>Every statement of the solver, sweep by sweep and body by body. The number on the left counts the statements; on the "
    "right is the equation of the paper or the word of docs/theory.md: <i>d Eq. 45</i> is the derivative of Eq. 45 along a "
    "direction, <i>T d Eq. 45</i> the transpose of that, <i>primitive</i> the derivative of a statement with respect to an "
    "operand (Eq. 10).</p>",
    "<p>The index above a symbol is the body, loop or region whose memory holds it, and δ precedes a quantity that is computed "
    "for each direction (shaded). Symbols without an index above are local to their part, or coordinates q, speeds u, joint "
    "forces τ and parameters of the model. The table at the end explains the names.</p>",
)


def _said(sweep: SweepOfUnits) -> str:
    count = sum(len(unit.assignments) for unit in sweep.units)
    direction = f", {sweep.direction}" if sweep.direction else ""
    return f"{escape(sweep.title)}{direction}; {count} statements"


def _unit(unit: Unit) -> list[str]:
    """The statements of a unit, with the names of all units that share them."""
    printer = MathML(partial(mathml_symbol, unit))
    body = [f"<h3>{escape(unit.what)}: {escape(', '.join(unit.members))}</h3>"]
    for a in unit.assignments:
        kind = " primitive" if a.is_primitive else " direction" if a.each_direction else ""
        formula = printer.formula(printer(a.target), operator("+=" if a.adds else "="), _sum(printer, a.value))
        body.append(
            f'<div class="eq{kind}" id="s{a.number}"><span class="number">({a.number})</span><span>{formula}</span>'
            f'<span class="tag">{escape(a.tag)}</span></div>'
        )
    return body


# --- equations of motion ------------------------------------------------------------------------------------------------

LETTERS = {"M": "M", "forcing": "f", "qdot": "qdot", "position": "Phi", "J": "J", "rate": "b", "drift": "d", "S": "S",
           "s": "s", "remainder": "r"}  # fmt: skip


def _letter(name: str, below: str = "") -> str:
    base = '<mover accent="true"><mi>q</mi><mo>˙</mo></mover>' if name == "qdot" else word(LETTERS[name])
    return scripts(base, f"<mrow>{below}</mrow>" if below else "")


def _udot(below: str = "") -> str:
    return scripts('<mover accent="true"><mi>u</mi><mo>˙</mo></mover>', word(below) if below else "")


def _laws(found: Equations) -> list[Sequence[str]]:
    equal, plus, minus = map(operator, "=+−")
    if found.form == "tree":
        return [("<mi>M</mi>", _udot(), equal, "<mi>f</mi>")]
    if found.form == "embedded":
        speeds = [scripts("<mi>u</mi>", word("i"))] + ([plus, "<mi>s</mi>"] if found.s is not None else [])
        return [
            ("<mi>M</mi>", _udot("i"), equal, "<mi>f</mi>"),
            ("<mi>u</mi>", equal, "<mi>S</mi>", *speeds),
            (_udot(), equal, "<mi>S</mi>", _udot("i"), plus, "<mi>r</mi>"),
        ]
    drift = [minus, "<mi>d</mi>"] if found.drift is not None else ["<mn>0</mn>"]
    return [
        ("<mi>M</mi>", _udot(), plus, "<msup><mi>J</mi><mi>T</mi></msup>", "<mi>λ</mi>", equal, "<mi>f</mi>"),
        ("<mi>J</mi>", _udot(), equal, minus, "<mi>b</mi>"),
        ("<mi>J</mi>", "<mi>u</mi>", equal, *drift),
        ("<mi>Φ</mi>", equal, "<mn>0</mn>"),
    ]


def equation_lines(found: Equations) -> list[tuple[str, str]]:
    """Headings and formulas in MathML, in the order of a page."""
    printer = MathML()
    out = [("law", printer.formula(*law)) for law in _laws(found)]
    for name, symbols in vectors(found).items():
        if name in ("q", "u", "u_i", "multipliers"):
            left = {"multipliers": "<mi>λ</mi>", "u_i": scripts("<mi>u</mi>", word("i"))}.get(name, f"<mi>{name}</mi>")
            out.append(("vectors", printer.formula(left, operator("="), printer.matrix(sympy.Matrix(symbols)))))
    for symbol, value in found.intermediates.items():
        out.append(("intermediates", printer.formula(printer(symbol), operator("="), _sum(printer, value))))
    for name, of in found.matrices.items():
        if is_small(of):
            out.append((name, printer.formula(_letter(name), operator("="), printer.matrix(of))))
            continue
        for i, j, value in entries(found, name):
            place = f"<mn>{i + 1}</mn>" + (f"<mo>,</mo><mn>{j + 1}</mn>" if of.cols > 1 else "") if len(of) > 1 else ""
            out.append((name, printer.formula(_letter(name, place), operator("="), _sum(printer, value))))
    for name, value in found.outputs.items():
        out.append(("outputs", printer.formula(word(name), operator("="), _sum(printer, value))))
    return out


HEADINGS = {"law": "Equations", "vectors": "Coordinates and speeds",
            "intermediates": "Intermediate variables", "M": "Mass matrix", "forcing": "Right side",
            "qdot": "Rates of the coordinates", "position": "Constraints", "J": "Constraint Jacobian",
            "rate": "Rate of the Jacobian times the speeds", "drift": "Contribution of prescribed motion",
            "S": "Speeds from the independent ones", "s": "Contribution of prescribed motion",
            "remainder": "Acceleration remainder", "outputs": "Outputs"}  # fmt: skip


def equations_page(found: Equations) -> str:
    """The page of the equations of motion, as HTML."""
    body, before = [f"<h1>Equations of motion of {escape(found.name)}</h1>"], ""
    for heading, formula in equation_lines(found):
        if heading != before:
            body.append(f"<h3>{HEADINGS[heading]}</h3>")
        before = heading
        body.append(f'<div class="formula">{formula}</div>')
    body += [f"<p>Output {escape(n)} is left out: {escape(why)}.</p>" for n, why in found.outputs.refused.items()]
    if found.parameters:
        values = ", ".join(f"{escape(s.name)} = {escape(str(found.defaults[s]))}" for s in found.parameters)
        body.append(f"<p>Values of the model: {values}.</p>")
    return page(f"Equations of motion of {found.name}", body)


def equations_mathml(found: Equations) -> str:
    """The formulas of the equations in MathML, one on each line."""
    return "\n".join(formula for _, formula in equation_lines(found)) + "\n"


__all__ = ["equations_mathml", "equations_page", "statements_page"]
