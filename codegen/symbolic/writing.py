"""Equations as text: lines to read, LaTeX, a module for sympy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import sympy
from sympy.printing.latex import LatexPrinter
from sympy.printing.str import StrPrinter

from .entries import LONGEST
from .motion import Equations
from .names import identifiers, latex_name, unused_prefix

SMALL = 240
"""A matrix of at most this many characters in sympy's notation is printed as a whole, a longer one entry by entry."""

PER_LINE = 4
"""Number of terms of a sum in a line of LaTeX."""

NESTED = 8
"""In LaTeX, a sum of more terms within a product or function gets a name, and is printed before the equation."""

LAWS = {
    "tree": ("M*udot = forcing",),
    "multipliers": ("M*udot + J.T*multipliers = forcing", "J*udot = -rate"),
    "embedded": ("M*udot_i = forcing", "u = S*u_i + s", "udot = S*udot_i + remainder"),
}
"""Equations that the matrices of each form satisfy."""

LATEX_LAWS = {
    "tree": (r"M\,\dot{u} = f",),
    "multipliers": (r"M\,\dot{u} + J^{T}\lambda = f", r"J\,\dot{u} = -b", r"J\,u = -d"),
    "embedded": (r"M\,\dot{u}_i = f", r"u = S\,u_i + s", r"\dot{u} = S\,\dot{u}_i + r"),
}

LETTERS = {"M": "M", "forcing": "f", "qdot": "\\dot{q}", "position": "\\Phi", "J": "J", "rate": "b", "drift": "d", "S": "S",
           "s": "s", "remainder": "r"}  # fmt: skip
"""Letters of the matrices in typeset equations."""


def entries(found: Equations, name: str) -> Iterator[tuple[int, int, sympy.Expr]]:
    """Row, column and value of the entries of a matrix; of the mass matrix, only entries on and above the diagonal."""
    of = found.matrices[name]
    for i in range(of.rows):
        for j in range(i if name == "M" else 0, of.cols):
            yield i, j, of[i, j]


def is_small(matrix: sympy.Matrix) -> bool:
    """Whether a matrix is printed as a whole."""
    return sum(len(str(x)) for x in matrix) <= SMALL


def as_text(found: Equations) -> str:
    """The equations in sympy's notation, one entry a line."""
    lines = [f"{found.name}: {', '.join(LAWS[found.form])}"]
    lines += [f"{name} = ({', '.join(s.name for s in of)})" for name, of in vectors(found).items()]
    lines += [f"{s.name} = {value}" for s, value in found.intermediates.items()]
    for name in found.matrices:
        for i, j, value in entries(found, name):
            place = f"{i + 1}, {j + 1}" if found.matrices[name].cols > 1 or name in ("M", "J", "S") else f"{i + 1}"
            lines.append(f"{name}[{place}] = {value}")
    lines += [f"output {name} = {value}" for name, value in found.outputs.items()]
    lines += [f"output {name} is left out: {reason}" for name, reason in found.outputs.refused.items()]
    return "\n".join(lines) + "\n"


def vectors(found: Equations) -> dict[str, tuple[sympy.Symbol, ...]]:
    """The symbols in each vector, by the name of the vector."""
    every = {"q": found.q, "u": found.u, "u_i": found.independent, "multipliers": found.multipliers,
             "parameters": found.parameters, "inputs": found.inputs}  # fmt: skip
    if found.form != "embedded":
        del every["u_i"]
    return {name: of for name, of in every.items() if of}


def latex_names(*of: object) -> dict[sympy.Symbol, str]:
    """The names of all symbols of expressions and matrices."""
    symbols = {s for x in of for s in getattr(x, "free_symbols", ())}
    return {s: latex_name(s.name) for s in symbols}


def as_latex(found: Equations) -> str:
    """The equations in LaTeX, for a document with the package amsmath."""
    names = latex_names(*found.matrices.values(), *found.outputs.values(), *found.intermediates.values())
    lines = [f"% equations of motion of {found.name}, form {found.form}"]
    lines += ["\\begin{gather*}", " \\\\\n".join(LATEX_LAWS[found.form]), "\\end{gather*}"]
    for name, of in vectors(found).items():
        if name in ("q", "u", "u_i", "multipliers"):
            letter = {"multipliers": "\\lambda"}.get(name, name)
            column = " \\\\ ".join(latex_name(s.name) for s in of)
            lines.append(f"\\[ {letter} = \\begin{{bmatrix}} {column} \\end{{bmatrix}} \\]")
    written = _Latex(names)
    lines += [line for s, value in found.intermediates.items() for line in written(names[s], value)]
    for name, of in found.matrices.items():
        letter = LETTERS[name]
        if is_small(of):
            text = sympy.latex(of, symbol_names=names, mat_str="bmatrix", mat_delim="")
            lines.append(f"\\[ {letter} = {text} \\]")
            continue
        for i, j, value in entries(found, name):
            place = f"{i + 1}{j + 1}" if of.cols > 1 else f"{i + 1}"
            lines += written(f"{letter}_{{{place}}}", value)
    for name, value in found.outputs.items():
        lines += written(f"\\text{{{name}}}".replace("_", "\\_"), value)
    return "\n".join(lines) + "\n"


class _Latex:
    """Prints equations in LaTeX: a sum of many terms over several lines, and long sums inside of others by names y1, y2, ...

    Parameters
    ----------
    names : dict of Symbol to str
        LaTeX of the symbols.
    """

    def __init__(self, names: dict[sympy.Symbol, str]) -> None:
        self.names = dict(names)
        self.prefix = unused_prefix("y", (s.name for s in names))
        self.parts: dict[sympy.Expr, sympy.Symbol] = {}

    def __call__(self, left: str, value: sympy.Expr) -> list[str]:
        """The lines of an equation, preceded by definitions of its named parts that have not been printed."""
        known = len(self.parts)
        if not value.is_Add:
            value = self._named(value)
        else:
            value = sympy.Add(*map(self._named, value.args))
        found = [self._broken(self.names[s], part) for part, s in list(self.parts.items())[known:]]
        return [*found, self._broken(left, value)]

    def _named(self, e: Any) -> Any:
        if not any(len(x.args) > NESTED for x in e.atoms(sympy.Add)):
            return e
        e = e.func(*map(self._named, e.args))
        if not (e.is_Add and len(e.args) > NESTED):
            return e
        if e not in self.parts:
            symbol = sympy.Symbol(f"{self.prefix}{len(self.parts) + 1}", real=True)
            self.parts[e], self.names[symbol] = symbol, latex_name(symbol.name)
        return self.parts[e]

    def _broken(self, left: str, value: sympy.Expr) -> str:
        printer = LatexPrinter({"symbol_names": self.names})
        terms = [printer.doprint(x) for x in value.as_ordered_terms()]
        signed = [x if x.startswith("-") or not k else f"+ {x}" for k, x in enumerate(terms)]
        lines = [" ".join(signed[k : k + PER_LINE]) for k in range(0, len(signed), PER_LINE)]
        body = " \\\\\n & \\quad ".join(lines)
        return f"\\begin{{align*}}\n{left} & = {body}\n\\end{{align*}}"


class _PythonPrinter(StrPrinter):
    """Prints expressions as Python code: symbols as identifiers, and exact fractions."""

    def __init__(self, names: dict[sympy.Symbol, str]) -> None:
        super().__init__()
        self._names = names

    def _print_Symbol(self, expr: sympy.Symbol) -> str:
        return self._names.get(expr, expr.name)

    def _print_Add(self, expr: sympy.Add, order: str | None = None) -> str:
        if len(expr.args) <= LONGEST:
            return str(super()._print_Add(expr, order))
        return f"Add({', '.join(map(self._print, expr.args))})"

    def _print_Rational(self, expr: sympy.Rational) -> str:
        return f"Rational({expr.p}, {expr.q})"


def as_sympy(found: Equations) -> str:
    """A module of Python that makes the same matrices with sympy alone."""
    of = {name: s for name, s in vectors(found).items() if name != "u_i"}
    every = [*(s for symbols in of.values() for s in symbols), *found.udot, found.t, *found.intermediates]
    names = identifiers(every, taken=[*dir(sympy), *MODULE, *found.matrices])
    printer = _PythonPrinter(names)
    lines = [f'"""Equations of motion of {found.name}: {", ".join(LAWS[found.form])}."""', "",
             "from sympy import *", ""]  # fmt: skip
    lines += [f'{names[s]} = Symbol("{s.name}", real=True)' for s in dict.fromkeys(every)]
    for name, symbols in {**of, "udot": found.udot, "independent": found.independent}.items():
        lines.append(f"{name} = ({', '.join(names[s] for s in symbols)}{',' * (len(symbols) == 1)})")
    lines.append(f"t = {names[found.t]}")
    if found.intermediates:
        pairs = [f"    ({names[s]}, {printer.doprint(value)}),\n" for s, value in found.intermediates.items()]
        lines.append(f"intermediates = [\n{''.join(pairs)}]")
    for name, matrix in found.matrices.items():
        rows = [f"    [{', '.join(printer.doprint(x) for x in matrix[i, :])}],\n" for i in range(matrix.rows)]
        lines.append(
            f"{name} = Matrix([\n{''.join(rows)}])" if matrix else f"{name} = zeros({matrix.rows}, {matrix.cols})"
        )
    values = {s: v for s, v in found.defaults.items() if s in names}
    lines.append(f"defaults = {{{', '.join(f'{names[s]}: {printer.doprint(v)}' for s, v in values.items())}}}")
    outputs = ", ".join(f'"{name}": {printer.doprint(value)}' for name, value in found.outputs.items())
    lines.append(f"outputs = {{{outputs}}}")
    return "\n".join(lines) + "\n"


MODULE = ("q", "u", "udot", "independent", "multipliers", "parameters", "inputs", "t", "defaults", "outputs",
          "intermediates")  # fmt: skip
"""Names that a module of `as_sympy` defines besides the matrices."""

__all__ = ["as_latex", "as_sympy", "as_text", "entries"]
