"""Exact numbers with symbols: polynomials in atoms, kept expanded, with ``sin(x)**2`` replaced by ``1 - cos(x)**2``.

An atom is what sympy does not take apart: a symbol, a function such as ``sin(q)``, a square root, a sum that is divided by.
Two polynomials in symbols, sines and cosines are equal if and only if their terms are, so zeros are recognised.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
import sympy

from .errors import TooLargeError

Monomial = tuple[tuple[int, int], ...]
"""Numbers of atoms with their exponents, in the order of the atoms."""

Terms = dict[Monomial, Fraction]

DENOMINATOR, OF_PI = 100_000, 1000
"""Largest denominators with which a float that is not a short decimal is taken as a fraction, or as one of pi."""

SHORT = 15
"""A float with at least this many digits is not a short decimal."""


PER_TERM = 10
"""Products of terms that a term of the equations takes, about."""

PI = Fraction(str(sympy.pi.evalf(40)))


class UndecidedError(TypeError):
    """A formula compares symbols, so it has different values in different states."""


class Atom:
    """A factor of monomials.

    Attributes
    ----------
    expression : sympy.Expr
    square : Polynomial or None
        What the square of the atom equals: of sines and square roots.
    expanded : Polynomial or None
        The atom as a polynomial: of sums that are divided by.
    """

    __slots__ = ("expanded", "expression", "square")

    def __init__(self, expression: sympy.Expr) -> None:
        self.expression = expression
        self.square: Polynomial | None = None
        self.expanded: Polynomial | None = None


class Algebra:
    """The atoms of one computation, and the way from sympy's expressions to polynomials and back.

    Parameters
    ----------
    most_products : int, optional
        Products of terms that are formed before `TooLargeError` is raised.

    Attributes
    ----------
    made : int
        Terms that products have had so far.
    """

    def __init__(self, most_products: int | None = None) -> None:
        self.most_products = most_products
        self.atoms: list[Atom] = []
        self.made = 0
        self._special: set[int] = set()  # atoms whose first power, or its inverse, may be replaced
        self._known: dict[sympy.Expr, int] = {}
        self._converted: dict[sympy.Expr, Polynomial] = {}
        self._closed: dict[sympy.Expr, Polynomial] = {}
        self._powers: dict[tuple[int, int], Polynomial | None] = {}

    # --- polynomials ----------------------------------------------------------------------------------------------

    def constant(self, value: int | Fraction) -> Polynomial:
        """A rational number."""
        return Polynomial(self, {(): Fraction(value)} if value else {})

    def atom(self, expression: sympy.Expr) -> Polynomial:
        """The polynomial of one atom."""
        return Polynomial(self, {((self._number(expression), 1),): Fraction(1)})

    def _number(self, expression: sympy.Expr) -> int:
        found = self._known.get(expression)
        if found is None:
            found = self._known[expression] = len(self.atoms)
            self.atoms.append(atom := Atom(expression))
            if isinstance(expression, sympy.sin):
                cosine = self.atom(sympy.cos(expression.args[0]))
                atom.square = self.constant(1) - cosine * cosine
            elif isinstance(expression, sympy.Pow) and expression.exp == sympy.Rational(1, 2):
                atom.square = self.convert(expression.base)
            elif isinstance(expression, sympy.Add):
                atom.expanded = self.convert(expression)
            if atom.square is not None or atom.expanded is not None:
                self._special.add(found)
        return found

    def closed(self, p: Polynomial, most: int) -> Polynomial:
        """The same value; a polynomial of more than `most` terms as one atom that is not multiplied out."""
        if len(p.terms) <= most:
            return p
        expression = p.expression
        if expression not in self._closed:
            self.atoms.append(Atom(expression))
            self._closed[expression] = Polynomial(self, {((len(self.atoms) - 1, 1),): Fraction(1)})
            self._converted[expression] = self._closed[expression]
        return self._closed[expression]

    def convert(self, expression: sympy.Expr) -> Polynomial:
        """The polynomial of an expression of sympy's."""
        found = self._converted.get(expression)
        if found is None:
            found = self._converted[expression] = self._convert(expression)
        return found

    def _convert(self, e: sympy.Expr) -> Polynomial:
        if isinstance(e, sympy.Rational):
            return self.constant(Fraction(int(e.p), int(e.q)))
        if isinstance(e, sympy.Float):
            return self.convert(exact(float(e)))
        if isinstance(e, sympy.Add | sympy.Mul):
            total = self.convert(e.args[0])
            for part in e.args[1:]:
                total = total + self.convert(part) if e.is_Add else total * self.convert(part)
            return total
        if isinstance(e, sympy.Pow) and e.exp.is_Integer:
            return self.convert(e.base) ** int(e.exp)
        if isinstance(e, sympy.Pow) and e.exp.is_Rational and e.exp.q == 2 and e.exp.p != 1:
            return self.convert(sympy.sqrt(e.base)) ** int(e.exp.p)
        return self.atom(e)

    def evaluated(
        self, polynomials: np.ndarray[Any, Any], values: Mapping[sympy.Symbol, float]
    ) -> np.ndarray[Any, Any]:
        """Floats of an array of polynomials, with values for all symbols."""
        atoms = {a for p in polynomials.flat for m in p.terms for a, _ in m}
        known = {a: float(self.atoms[a].expression.evalf(subs=values)) for a in atoms}
        found = [
            math.fsum(float(x) * math.prod(known[a] ** e for a, e in m) for m, x in p.terms.items())
            for p in polynomials.flat
        ]
        return np.array(found).reshape(polynomials.shape)

    def rule(self, atom: int, exponent: int) -> Polynomial | None:
        """What a power of an atom is replaced by, or None."""
        key = atom, exponent
        if key not in self._powers:
            self._powers[key] = self._rule(self.atoms[atom], exponent)
        return self._powers[key]

    def _rule(self, atom: Atom, exponent: int) -> Polynomial | None:
        if atom.expanded is not None and exponent > 0:
            return atom.expanded**exponent
        if atom.square is None or (0 <= exponent < 2) or (exponent < 0 and not isinstance(atom.expression, sympy.Pow)):
            return None
        if exponent == -1 and not atom.square.is_constant:
            return None
        half, rest = divmod(exponent, 2)
        result = atom.square**half
        return result * self.atom(atom.expression) if rest else result

    def product(self, a: Terms, b: Terms) -> Terms:
        """The terms of a product."""
        self.made += len(a) * len(b)
        if self.most_products is not None and self.made > self.most_products:
            raise TooLargeError(f"more than about {self.most_products / PER_TERM:.0e} terms")
        total: Terms = {}
        for m, x in a.items():
            for n, y in b.items():
                _add(total, self._monomial(m, n), x * y)
        return {m: x for m, x in total.items() if x}

    def _monomial(self, m: Monomial, n: Monomial) -> Terms:
        if not m or not n:
            return {m or n: Fraction(1)}
        exponents = dict(m)
        for atom, e in n:
            exponents[atom] = exponents.get(atom, 0) + e
        left, replaced = [], []
        for atom, e in sorted(exponents.items()):
            if e:
                by = self.rule(atom, e) if e not in (1, -1) or atom in self._special else None
                if by is None:
                    left.append((atom, e))
                else:
                    replaced.append(by)
        result: Terms = {tuple(left): Fraction(1)}
        for by in replaced:
            result = self.product(result, by.terms)
        return result

    def reciprocal(self, p: Polynomial) -> Polynomial:
        """1/p: of a sum, after taking out common factors, by an atom."""
        if not p.terms:
            raise ZeroDivisionError("division by an expression that is zero")
        common: dict[int, int] = dict(next(iter(p.terms)))
        for m in p.terms:
            powers = dict(m)
            common = {a: min(e, powers.get(a, 0)) for a, e in common.items() if min(e, powers.get(a, 0))}
        first = p.terms[min(p.terms)]
        content = Fraction(
            math.gcd(*(x.numerator for x in p.terms.values())), math.lcm(*(x.denominator for x in p.terms.values()))
        )
        content = -content if first < 0 else content
        inverse = Polynomial(self, {tuple((a, -e) for a, e in sorted(common.items())): 1 / content})
        inverse = inverse * self.constant(1)  # rules for inverse powers
        if len(p.terms) == 1:
            return inverse
        rest = p * inverse
        return inverse * Polynomial(self, {((self._number(rest.expression), -1),): Fraction(1)})


def _add(total: Terms, terms: Mapping[Monomial, Fraction], factor: Fraction) -> None:
    for m, x in terms.items():
        total[m] = total.get(m, Fraction(0)) + x * factor


class Polynomial:
    """A sum of monomials with rational factors; see the module."""

    __slots__ = ("algebra", "terms")

    def __init__(self, algebra: Algebra, terms: Terms) -> None:
        self.algebra, self.terms = algebra, terms

    def _other(self, other: Any) -> Polynomial | None:
        if isinstance(other, Polynomial):
            return other
        if isinstance(other, int | float | Fraction):
            return self.algebra.constant(Fraction(other))
        return None

    def __add__(self, other: Any) -> Polynomial:
        b = self._other(other)
        if b is None:
            return NotImplemented
        if not self.terms or not b.terms:
            return b if not self.terms else self
        total = dict(self.terms)
        _add(total, b.terms, Fraction(1))
        return Polynomial(self.algebra, {m: x for m, x in total.items() if x})

    __radd__ = __add__

    def __neg__(self) -> Polynomial:
        return Polynomial(self.algebra, {m: -x for m, x in self.terms.items()})

    def __sub__(self, other: Any) -> Polynomial:
        b = self._other(other)
        return NotImplemented if b is None else self + -b

    def __rsub__(self, other: Any) -> Polynomial:
        return -self + other

    def __mul__(self, other: Any) -> Polynomial:
        b = self._other(other)
        if b is None:
            return NotImplemented
        if not self.terms or not b.terms:
            return self if not self.terms else b
        return Polynomial(self.algebra, self.algebra.product(self.terms, b.terms))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Polynomial:
        b = self._other(other)
        return NotImplemented if b is None else self * self.algebra.reciprocal(b)

    def __rtruediv__(self, other: Any) -> Polynomial:
        return self.algebra.reciprocal(self) * other

    def __pow__(self, exponent: int) -> Polynomial:
        base = self if exponent >= 0 else self.algebra.reciprocal(self)
        result = self.algebra.constant(1)
        for _ in range(abs(exponent)):
            result = result * base
        return result

    def __bool__(self) -> bool:
        return bool(self.terms)

    def __eq__(self, other: object) -> bool:
        b = self._other(other)
        return b is not None and self.terms == b.terms

    def __hash__(self) -> int:
        return hash(frozenset(self.terms.items()))

    def __lt__(self, other: Any) -> bool:
        return self._sign(other) < 0

    def __gt__(self, other: Any) -> bool:
        return self._sign(other) > 0

    def __le__(self, other: Any) -> bool:
        return self._sign(other) <= 0

    def __ge__(self, other: Any) -> bool:
        return self._sign(other) >= 0

    def _sign(self, other: Any) -> int:
        """The sign of a difference that has no symbols."""
        difference = (self - other).expression
        if difference.free_symbols:
            raise UndecidedError("symbols are compared")
        return int(sympy.sign(difference))

    @property
    def is_constant(self) -> bool:
        """Whether it is a rational number."""
        return not self.terms.keys() - {()}

    @property
    def expression(self) -> sympy.Expr:
        """The same as an expression of sympy's; terms with one divisor have it in common."""
        above: dict[Monomial, list[sympy.Expr]] = {}
        for m, x in self.terms.items():
            divisor = tuple((a, e) for a, e in m if self.algebra.atoms[a].expanded is not None)
            factors = self._product(tuple(pair for pair in m if pair not in divisor))
            above.setdefault(divisor, []).append(sympy.Mul(sympy.Rational(x.numerator, x.denominator), factors))
        return sympy.Add(*(sympy.Mul(sympy.Add(*terms), self._product(m)) for m, terms in above.items()))

    def _product(self, m: Monomial) -> sympy.Expr:
        return sympy.Mul(*(self.algebra.atoms[a].expression ** e for a, e in m))


def exact(x: float) -> sympy.Expr:
    """The number that an int or a float stands for: the decimal of the file, a fraction of small whole numbers, or one of pi.

    The value of the result differs from the float by at most four units in the last place, and that of a decimal not at all.

    >>> exact(0.02), exact(1 / 3), exact(0.5235987755982988)
    (1/50, 1/3, pi/6)
    """
    if isinstance(x, int):
        return sympy.Integer(x)
    text = repr(float(x))
    decimal = sympy.Rational(text)
    digits = len(text.partition("e")[0].strip("-0.").replace(".", ""))
    if digits < SHORT:
        return decimal
    near = Fraction(x).limit_denominator(DENOMINATOR)
    if near and float(near) == x:
        return sympy.Rational(near.numerator, near.denominator)
    turns = (Fraction(x) / PI).limit_denominator(OF_PI)
    of_pi = sympy.Rational(turns.numerator, turns.denominator) * sympy.pi
    return of_pi if turns and abs(float(of_pi.evalf(30)) - x) <= 4 * math.ulp(x) else decimal
