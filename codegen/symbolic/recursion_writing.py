"""Statements of a solver as text and in LaTeX, and the typeset form of the symbols in them."""

from __future__ import annotations

import re

import sympy
from sympy.printing.latex import LatexPrinter
from sympy.printing.precedence import PRECEDENCE

from .kept import Kept
from .mathml import decimal_parts, is_decimal, operator, row, scripts, symbol_of_model, word
from .names import latex_name, latex_word
from .recursion import Assignment, Recursion, Unit

COMPONENT = re.compile(r"(.+?)(?:\.([xyz]{1,2}|\d+))?(?:/(\S+))?")
LOCAL = re.compile(r"(.+?)(?:_([xyz]{1,2}|\d+))?")
ARGUMENT = re.compile(r"(d?(q|u|tau|p)|(d?udot|d?qdot|b))\..+")


def parts_of_component(component: str) -> tuple[str, str, str]:
    """Field, entry, and the parameter of a constant's derivative: ``J.xx/mass`` is J, xx, mass."""
    found = COMPONENT.fullmatch(component)
    assert found is not None
    return found[1], found[2] or "", found[3] or ""


def as_text(found: Recursion) -> str:
    """All statements, one a line, with number and tag."""
    out = [f"{found.name}: {found.count} statements"]
    for sweep in found.sweeps:
        out += ["", f"{sweep.name}: {sweep.title}{', ' + sweep.direction if sweep.direction else ''}"]
        for unit in sweep.units:
            out.append(f"  {unit.what}: {', '.join(unit.members)}")
            for a in unit.assignments:
                out.append(f"    ({a.number}) {a.target} {'+=' if a.adds else '='} {a.value}    [{a.tag}]")
    return "\n".join(out) + "\n"


def mathml_symbol(unit: Unit, symbol: sympy.Symbol) -> str:
    """A symbol of a statement: entry as subscript, owner as superscript; a delta marks values per direction."""
    of = unit.kept.get(symbol)
    if of is None:
        if ARGUMENT.fullmatch(symbol.name) or "." in symbol.name:
            return symbol_of_model(symbol)
        base, below = _local(symbol.name)
        return scripts(word(base), word(below) if below else "")
    base, below, by = parts_of_component(of.component)
    found = scripts(word(base), word(below) if below else "", word(of.owner) if of.owner else "")
    if by:
        return f"<mfrac>{row(operator('∂'), found)}{row(operator('∂'), symbol_of_model(sympy.Symbol(by)))}</mfrac>"
    return row("<mi>δ</mi>", found) if of.each_direction else found


def latex_symbol(unit: Unit, symbol: sympy.Symbol) -> str:
    """The typeset form of a statement's symbol, in LaTeX."""
    of = unit.kept.get(symbol)
    if of is None:
        if ARGUMENT.fullmatch(symbol.name) or "." in symbol.name:
            return latex_name(symbol.name)
        base, below = _local(symbol.name)
        return latex_word(base) + (f"_{{{latex_word(below)}}}" if below else "")
    base, below, by = parts_of_component(of.component)
    found = latex_word(base) + (f"_{{{latex_word(below)}}}" if below else "")
    found += f"^{{{latex_word(of.owner)}}}" if of.owner else ""
    if by:
        return f"\\frac{{\\partial {found}}}{{\\partial {latex_name(by)}}}"
    return f"\\delta {found}" if of.each_direction else found


def _local(name: str) -> tuple[str, str]:
    found = LOCAL.fullmatch(name)
    assert found is not None
    return found[1], found[2] or ""


def as_latex(found: Recursion) -> str:
    """All statements in LaTeX, for a document with amsmath: numbered, each with its tag."""
    out = [f"% {found.count} statements of {found.name}"]
    for sweep in found.sweeps:
        direction = f", {sweep.direction}" if sweep.direction else ""
        out += [f"\\section*{{{_plain(sweep.name)}{direction}}}", _plain(sweep.title), ""]
        for unit in sweep.units:
            out.append(f"\\subsection*{{{_plain(unit.what)}: {_plain(', '.join(unit.members))}}}")
            out.append("\\begin{align*}")
            out.append(" \\\\\n".join(_latex_line(unit, a) for a in unit.assignments))
            out.append("\\end{align*}")
    return "\n".join(out) + "\n"


class StatementPrinter(LatexPrinter):
    """Prints expressions, with fractions of large numbers as decimals."""

    def _print_Rational(self, expr: sympy.Rational) -> str:
        if not is_decimal(expr):
            return str(super()._print_Rational(expr))
        digits, exponent = decimal_parts(expr)
        return f"{digits} \\cdot 10^{{{exponent}}}" if exponent else digits

    def _print_Mul(self, expr: sympy.Mul) -> str:
        number, rest = expr.as_coeff_Mul()
        if not (number.is_Rational and is_decimal(number)):
            return str(super()._print_Mul(expr))
        return f"{self._print(number)} \\, {self.parenthesize(rest, PRECEDENCE['Mul'])}"


def _latex_line(unit: Unit, a: Assignment) -> str:
    names = {s: latex_symbol(unit, s) for s in a.value.free_symbols | {a.target}}
    printer = StatementPrinter({"symbol_names": names})
    sign = "\\mathrel{{+}{=}}" if a.adds else "="
    return f"{names[a.target]} & {sign} {printer.doprint(a.value)} \\tag*{{({a.number})\\quad {_plain(a.tag)}}}"


def _plain(text: str) -> str:
    return re.sub(r"([_&%#$])", r"\\\1", text)


__all__ = ["Kept", "as_latex", "as_text", "mathml_symbol", "parts_of_component"]
