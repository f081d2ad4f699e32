"""Exact numbers with symbols: polynomials in atoms, kept expanded, with ``sin(x)**2`` replaced by ``1 - cos(x)**2``.

An atom is an expression that is not expanded: a symbol, a function such as ``sin(q)``, a square root, a sum in a denominator. Two
polynomials in symbols, sines and cosines are equal if and only if their terms are, so zeros are recognised. With intermediate
variables, a sum that is a factor becomes a symbol instead of being multiplied out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np
import sympy

from .errors import TooManyProductsError

Monomial = tuple[tuple[int, int], ...]
"""Exponents of the atoms in a product, with the numbers of the atoms, in the order of the atoms."""

Rational = int | Fraction

Terms = dict[Monomial, Rational]
"""The monomials of a polynomial, each with its rational factor. Whole numbers are ints, which are faster than
fractions."""

DENOMINATOR, OF_PI = 100_000, 1000
"""Largest denominators of fractions and of multiples of pi that replace floats which are not short decimals."""

SHORT = 15
"""Number of digits from which a float is not a short decimal."""


LONGEST_FACTOR, LONGEST_SUM = 2, 40
"""With intermediate variables: largest number of terms of a factor, and of a sum, that gets no symbol."""

PI = Fraction(str(sympy.pi.evalf(40)))


class UndecidedError(TypeError):
    """Raised if a formula compares symbols, so that its branch differs between states."""


class Atom:
    """A factor of monomials.

    Attributes
    ----------
    expression : sympy.Expr
    square : Polynomial or None
        The square of the atom, for sines and square roots.
    expanded : Polynomial or None
        The atom as a polynomial, for sums in denominators.
    """

    __slots__ = ("expanded", "expression", "square")

    def __init__(self, expression: sympy.Expr) -> None:
        self.expression = expression
        self.square: Polynomial | None = None
        self.expanded: Polynomial | None = None


class Algebra:
    """The atoms of one computation, and the conversion between sympy's expressions and polynomials.

    Parameters
    ----------
    most_products : int, optional
        Products of terms that are formed before `TooManyProductsError` is raised.
    intermediate : str, optional
        Long sums become symbols, whose names are this prefix and a number. Default: no sum becomes a symbol.

    Attributes
    ----------
    made : int
        Number of terms of all products so far.
    definitions : dict of int to Polynomial
        By the number of an atom that is an intermediate variable: its value, which has earlier atoms only.
    factored : set of int
        Numbers in `definitions` whose sums would stay factors even without intermediate variables.
    """

    def __init__(self, most_products: int | None = None, intermediate: str = "") -> None:
        self.most_products, self.intermediate = most_products, intermediate
        self.atoms: list[Atom] = []
        self.made = 0
        self.definitions: dict[int, Polynomial] = {}
        self.factored: set[int] = set()
        self._special: set[int] = set()  # atoms whose first power, or its inverse, may be replaced
        self._known: dict[sympy.Expr, int] = {}
        self._converted: dict[sympy.Expr, Polynomial] = {}
        self._closed: dict[sympy.Expr, Polynomial] = {}
        self._symbols: dict[frozenset[tuple[Monomial, Rational]], sympy.Symbol] = {}
        self._powers: dict[tuple[int, int], Polynomial | None] = {}

    # --- polynomials ----------------------------------------------------------------------------------------------

    def constant(self, value: int | Fraction) -> Polynomial:
        """The polynomial of a rational number."""
        return Polynomial(self, {(): value} if value else {})

    def atom(self, expression: sympy.Expr) -> Polynomial:
        """The polynomial that consists of one atom."""
        return Polynomial(self, {((self._number(expression), 1),): 1})

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
        """The polynomial, or with more than `most` terms a single atom for it, which is not multiplied out."""
        if len(p.terms) <= most:
            return p
        if self.intermediate:
            found = self.named(p, most)
            self.factored |= {a for m in found.terms for a, _ in m}
            return found
        expression = p.expression
        if expression not in self._closed:
            self.atoms.append(Atom(expression))
            self._closed[expression] = Polynomial(self, {((len(self.atoms) - 1, 1),): 1})
            self._converted[expression] = self._closed[expression]
        return self._closed[expression]

    def named(self, p: Polynomial, most: int) -> Polynomial:
        """The polynomial itself; if it has more than `most` terms, an intermediate variable for it or for its negative."""
        if len(p.terms) <= most:
            return p
        factor = 1 if p.terms[min(p.terms)] > 0 else -1
        terms: Terms = {m: x * factor for m, x in p.terms.items()}
        key = frozenset(terms.items())
        if key not in self._symbols:
            symbol = sympy.Symbol(f"{self.intermediate}{len(self._symbols) + 1}", real=True)
            self.definitions[self._number(symbol)] = Polynomial(self, terms)
            self._symbols[key] = symbol
        return Polynomial(self, {((self._number(self._symbols[key]), 1),): factor})

    def convert(self, expression: sympy.Expr) -> Polynomial:
        """The polynomial of an expression of sympy's."""
        found = self._converted.get(expression)
        if found is None:
            found = self._converted[expression] = self._convert(expression)
        return found

    def _convert(self, e: sympy.Expr) -> Polynomial:
        if isinstance(e, sympy.Rational):
            return self.constant(int(e.p) if e.q == 1 else Fraction(int(e.p), int(e.q)))
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
        """Floats of an array of polynomials, with values for all symbols but intermediate variables."""
        known: dict[int, float] = {}
        at: dict[sympy.Expr, float] = dict(values)

        def value(p: Polynomial) -> float:
            return math.fsum(float(x) * math.prod(known[a] ** e for a, e in m) for m, x in p.terms.items())

        wanted = self.reached(polynomials.flat)
        for a in wanted:
            if a in self.definitions:
                at[self.atoms[a].expression] = known[a] = value(self.definitions[a])
            else:
                known[a] = float(self.atoms[a].expression.evalf(subs=at))
        return np.array([value(p) for p in polynomials.flat]).reshape(polynomials.shape)

    def reached(self, polynomials: Iterable[Polynomial]) -> list[int]:
        """The atoms of some polynomials and of their intermediate variables; each atom follows those in its own
        value."""
        found: set[int] = set()
        left = {a for p in polynomials for m in p.terms for a, _ in m}
        while left:
            found |= left
            needed = set()
            for a in left:
                inner = self.definitions[a].terms if a in self.definitions else {}
                needed |= {b for m in inner for b, _ in m}
                needed |= {self._known[x] for x in self.atoms[a].expression.free_symbols if x in self._known}
            left = needed - found
        return sorted(found)

    def rule(self, atom: int, exponent: int) -> Polynomial | None:
        """The replacement of a power of an atom, or None."""
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
        """The terms of the product of two polynomials."""
        self.made += len(a) * len(b)
        if self.most_products is not None and self.made > self.most_products:
            raise TooManyProductsError
        total: Terms = {}
        for m, x in a.items():
            for n, y in b.items():
                _add(total, self._monomial(m, n), x * y)
        return {m: x for m, x in total.items() if x}

    def _monomial(self, m: Monomial, n: Monomial) -> Terms:
        if not m or not n:
            return {m or n: 1}
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
        result: Terms = {tuple(left): 1}
        for by in replaced:
            result = self.product(result, by.terms)
        return result

    def reciprocal(self, p: Polynomial) -> Polynomial:
        """1/p. For a sum p, common factors are taken out, and an atom stands for the reciprocal of the rest."""
        if not p.terms:
            raise ZeroDivisionError("division by an expression that is zero")
        if self.intermediate:
            p = self.named(p, 1)
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
        inverse = inverse * self.constant(1)  # needed to apply the rules for inverse powers
        if len(p.terms) == 1:
            return inverse
        rest = p * inverse
        return inverse * Polynomial(self, {((self._number(rest.expression), -1),): 1})


def _add(total: Terms, terms: Terms, factor: Rational) -> None:
    for m, x in terms.items():
        total[m] = total.get(m, 0) + x * factor


class Polynomial:
    """A sum of monomials with rational factors; see the module."""

    __slots__ = ("algebra", "terms")

    def __init__(self, algebra: Algebra, terms: Terms) -> None:
        self.algebra, self.terms = algebra, terms

    def _other(self, other: Any) -> Polynomial | None:
        if isinstance(other, Polynomial):
            return other
        if isinstance(other, int | float | Fraction):
            return self.algebra.constant(other if isinstance(other, int) else Fraction(other))
        return None

    def __add__(self, other: Any) -> Polynomial:
        b = self._other(other)
        if b is None:
            return NotImplemented
        if not self.terms or not b.terms:
            return b if not self.terms else self
        total = dict(self.terms)
        _add(total, b.terms, 1)
        found = Polynomial(self.algebra, {m: x for m, x in total.items() if x})
        return self.algebra.named(found, LONGEST_SUM) if self.algebra.intermediate else found

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
        a = self
        if self.algebra.intermediate and not (a.is_constant or b.is_constant):
            a, b = (self.algebra.named(x, LONGEST_FACTOR) for x in (a, b))
        return Polynomial(self.algebra, self.algebra.product(a.terms, b.terms))

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
        """Whether the polynomial is a rational number."""
        return not self.terms.keys() - {()}

    @property
    def short(self) -> sympy.Expr:
        """The expression; with intermediate variables, a symbol for a long sum."""
        return self.algebra.named(self, LONGEST_FACTOR).expression if self.algebra.intermediate else self.expression

    @property
    def expression(self) -> sympy.Expr:
        """The polynomial as an expression of sympy; terms with the same divisor are collected over it."""
        above: dict[Monomial, list[sympy.Expr]] = {}
        for m, x in self.terms.items():
            divisor = tuple((a, e) for a, e in m if self.algebra.atoms[a].expanded is not None)
            factors = self._product(tuple(pair for pair in m if pair not in divisor))
            above.setdefault(divisor, []).append(sympy.Mul(sympy.Rational(x.numerator, x.denominator), factors))
        return sympy.Add(*(sympy.Mul(sympy.Add(*terms), self._product(m)) for m, terms in above.items()))

    def _product(self, m: Monomial) -> sympy.Expr:
        return sympy.Mul(*(self.algebra.atoms[a].expression ** e for a, e in m))


def exact(x: float) -> sympy.Expr:
    """The exact number that an int or float stands for: a short decimal, a fraction of small integers, or such a fraction of pi.

    The result differs from the float by at most four units in the last place; a short decimal is converted exactly.

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
