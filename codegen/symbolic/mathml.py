"""Expressions of sympy as presentation MathML, as complete XML without external resources."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from html import escape

import sympy
from sympy.core.relational import Relational
from sympy.logic.boolalg import And, BooleanFalse, BooleanTrue, Not, Or

from .names import GREEK_LETTERS, parts_of

SUM, PRODUCT, ATOM = range(3)
"""Strengths with which expressions bind: that of sums is least, that of atoms greatest."""

NAMES = {"Abs": "abs", "asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "atan2", "Max": "max", "Min": "min",
         "Mod": "mod", "log": "ln", "sign": "sign", "floor": "floor"}  # fmt: skip
"""Names of functions in MathML that differ from sympy's."""

RELATIONS = {">=": "≥", "<=": "≤", ">": "&gt;", "<": "&lt;", "==": "=", "!=": "≠"}


def row(*parts: str) -> str:
    """MathML of several elements in one row."""
    return parts[0] if len(parts) == 1 else f"<mrow>{''.join(parts)}</mrow>"


def operator(sign: str) -> str:
    """MathML of an operator."""
    return f"<mo>{sign}</mo>"


def table(rows: Iterable[Iterable[str]], attributes: str) -> str:
    """MathML of a table, from rows of cells."""
    lines = "".join(f"<mtr>{''.join(f'<mtd>{cell}</mtd>' for cell in cells)}</mtr>" for cells in rows)
    return f'<mtable displaystyle="true" {attributes}>{lines}</mtable>'


LARGEST = 100_000
"""Largest denominator of a fraction that is printed as a fraction."""

TIMES = '<mo lspace="0" rspace="0.17em">\u2062</mo>'
"""The thin space between factors."""


def word(text: str) -> str:
    """The MathML of a name: single letters are italic, words upright, and names of Greek letters become these
    letters."""
    if text in GREEK_LETTERS:
        return f"<mi>{GREEK_LETTERS[text]}</mi>"
    if text.isdigit():
        return f"<mn>{text}</mn>"
    return f"<mi>{escape(text)}</mi>" if len(text) == 1 else f'<mi mathvariant="normal">{escape(text)}</mi>'


def scripts(base: str, below: str = "", above: str = "") -> str:
    """MathML of a base with a subscript and a superscript."""
    if below and above:
        return f"<msubsup>{base}{below}{above}</msubsup>"
    if below:
        return f"<msub>{base}{below}</msub>"
    return f"<msup>{base}{above}</msup>" if above else base


def symbol_of_model(symbol: sympy.Symbol) -> str:
    """MathML of a symbol, from its name in the model: ``q.crank`` is q with the subscript crank."""
    base, below, is_rate, is_seed = parts_of(symbol.name)
    letter = word(base)
    if is_rate:
        letter = f'<mover accent="true">{letter}<mo>˙</mo></mover>'
    found = scripts(letter, word(below) if below else "")
    return row("<mi>δ</mi>", found) if is_seed else found


def is_decimal(e: sympy.Rational) -> bool:
    """Whether a decimal is more readable than a fraction of large numbers."""
    return bool(e.q > LARGEST)


def decimal_parts(e: sympy.Rational) -> tuple[str, int]:
    """The digits of a fraction in double precision, and the exponent of ten."""
    digits, _, exponent = repr(float(e)).partition("e")
    return digits, int(exponent or 0)


class MathML:
    """Prints sympy expressions as MathML.

    Parameters
    ----------
    symbol : callable
        The MathML of a symbol.
    """

    def __init__(self, symbol: Callable[[sympy.Symbol], str] = symbol_of_model) -> None:
        self.symbol = symbol

    def __call__(self, e: sympy.Basic) -> str:
        """The MathML element of an expression."""
        return self._printed(e)[0]

    def formula(self, *parts: str) -> str:
        """MathML of a formula on a line of its own."""
        return f'<math xmlns="http://www.w3.org/1998/Math/MathML" displaystyle="true">{row(*parts)}</math>'

    def matrix(self, of: sympy.MatrixBase) -> str:
        """MathML of a matrix in round brackets, drawn as borders because brackets of fonts do not always grow."""
        if len(of) == 1:
            return self(of[0])
        rows = [[self(of[i, j]) for j in range(of.cols)] for i in range(of.rows)]
        return table(
            rows, 'style="border-left: .07em solid; border-right: .07em solid; border-radius: .6em; padding: 0 .4em"'
        )

    def _bound(self, e: sympy.Basic, strength: int) -> str:
        """The text of an expression, in brackets if it binds more weakly than `strength`."""
        text, own = self._printed(e)
        return row(operator("("), text, operator(")")) if own < strength else text

    def _printed(self, e: sympy.Basic) -> tuple[str, int]:
        if isinstance(e, sympy.Symbol):
            return self.symbol(e), ATOM
        if isinstance(e, sympy.MatrixBase):
            return self.matrix(e), ATOM
        if isinstance(e, sympy.Rational):
            return self._rational(e)
        if e is sympy.pi:
            return "<mi>π</mi>", ATOM
        if isinstance(e, sympy.Number):
            return f"<mn>{e}</mn>", ATOM if e >= 0 else SUM
        if isinstance(e, sympy.Add):
            return self._sum(e), SUM
        if isinstance(e, sympy.Mul):
            return self._product(e)
        if isinstance(e, sympy.Pow):
            return self._power(e)
        if isinstance(e, sympy.Piecewise):
            return self._cases(e), ATOM
        if isinstance(e, Relational | And | Or | Not | BooleanTrue | BooleanFalse):
            return self._condition(e), SUM
        if isinstance(e, sympy.Function | sympy.Max | sympy.Min):
            return self._function(e), ATOM
        return f"<mi>{escape(str(e))}</mi>", SUM

    def _rational(self, e: sympy.Rational) -> tuple[str, int]:
        if is_decimal(e):
            size = self._decimal(abs(e))
        else:
            size = f"<mn>{abs(e.p)}</mn>" if e.q == 1 else f"<mfrac><mn>{abs(e.p)}</mn><mn>{e.q}</mn></mfrac>"
        return (row(operator("−"), size), SUM) if e < 0 else (size, ATOM)

    def _decimal(self, e: sympy.Rational) -> str:
        digits, exponent = decimal_parts(e)
        if not exponent:
            return f"<mn>{digits}</mn>"
        return row(f"<mn>{digits}</mn>", operator("·"), f"<msup><mn>10</mn>{self(sympy.Integer(exponent))}</msup>")

    def _sum(self, e: sympy.Add) -> str:
        return row(*self.terms(e))

    def terms(self, e: sympy.Expr) -> list[str]:
        """The terms of a sum, each with its sign before it."""
        found: list[str] = []
        for term in e.as_ordered_terms():
            negative = term.could_extract_minus_sign()
            text = self._bound(-term if negative else term, PRODUCT)
            sign = "−" if negative else "+" if found else ""
            found.append(row(operator(sign), text) if sign else text)
        return found

    def _product(self, e: sympy.Mul) -> tuple[str, int]:
        if e.could_extract_minus_sign():
            return row(operator("−"), self._bound(-e, PRODUCT)), SUM
        number, rest = e.as_coeff_Mul()
        if number.is_Rational and is_decimal(number):
            return row(self(number), TIMES, self._bound(rest, PRODUCT)), PRODUCT
        above, below = sympy.fraction(e)
        if below != 1:
            return f"<mfrac>{self(above)}{self(below)}</mfrac>", ATOM
        factors = [self._bound(x, PRODUCT) for x in e.as_ordered_factors()]
        return row(*[x for factor in factors for x in (TIMES, factor)][1:]), PRODUCT

    def _power(self, e: sympy.Pow) -> tuple[str, int]:
        base, exponent = e.as_base_exp()
        if exponent == sympy.Rational(1, 2):
            return f"<msqrt>{self(base)}</msqrt>", ATOM
        if exponent.could_extract_minus_sign():
            return f"<mfrac><mn>1</mn>{self(base**-exponent)}</mfrac>", ATOM
        raised = self(exponent)
        if isinstance(base, sympy.Function) and not isinstance(base, sympy.Abs | sympy.floor | sympy.Piecewise):
            return self._function(base, raised), ATOM
        text = self._bound(base, ATOM if base.is_Symbol or base.is_Number else ATOM + 1)
        if text.startswith("<msub>"):
            return f"<msubsup>{text.removeprefix('<msub>').removesuffix('</msub>')}{raised}</msubsup>", ATOM
        if base.is_Symbol and text.startswith(("<msubsup>", "<mrow>", "<mfrac>")):
            text = row(operator("("), text, operator(")"))
        return f"<msup>{text}{raised}</msup>", ATOM

    def _function(self, e: sympy.Expr, raised: str = "") -> str:
        name, arguments = e.func.__name__, [self(a) for a in e.args]
        if name == "Abs":
            return row(operator("|"), *arguments, operator("|"))
        if name == "floor":
            return row(operator("⌊"), *arguments, operator("⌋"))
        called = scripts(f'<mi mathvariant="normal">{escape(NAMES.get(name, name))}</mi>', "", raised)
        separated = [x for a in arguments for x in (operator(","), a)][1:]
        return row(called, operator("\u2061"), row(operator("("), *separated, operator(")")))

    def _cases(self, e: sympy.Piecewise) -> str:
        rows = []
        for value, holds in e.args:
            when = "<mtext>otherwise</mtext>" if holds is sympy.true else row("<mtext>if\u00a0</mtext>", self(holds))
            rows.append((self(value), when))
        return table(rows, 'columnalign="left" style="border-left: .07em solid; padding: 0 .3em"')

    def _condition(self, e: sympy.Basic) -> str:
        if isinstance(e, Relational):
            return row(self(e.lhs), operator(RELATIONS[e.rel_op]), self(e.rhs))
        if isinstance(e, Not):
            return row(operator("¬"), self._bound(e.args[0], ATOM))
        if isinstance(e, And | Or):
            sign = operator("∧" if isinstance(e, And) else "∨")
            return row(*[x for a in e.args for x in (sign, self._bound(a, ATOM))][1:])
        return f"<mtext>{'always' if e == sympy.true else 'never'}</mtext>"


__all__ = ["MathML", "operator", "row", "scripts", "symbol_of_model", "word"]
