"""Products of expressions, written as products of powers so that powers of the same base are combined; see `slopes`."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from fractions import Fraction

from ..elementary import LIKE_ITS_ARGUMENT, TABLE, named
from .expressions import Expression, canonical
from .expressions import combine as combine_numbers
from .expressions import combine_exactly as combine
from .grammar import AT_LEAST, CHOICE, VANISHING, ExpressionError, Tree

ZERO: Tree = ("number", 0)
ONE: Tree = ("number", 1)
TWO: Tree = ("number", 2)
MINUS_ONE: Tree = ("number", -1)
HALF: Tree = ("number", 0.5)

NORM = "norm"
"""Key of a power of a vector's length: ``(NORM, ((weight, component), ...))``, the root of the weighted sum of squares."""

SIZE = "size"
"""Key of a power of an absolute value: ``(SIZE, ((1, x),))``."""

HELD = "held_"
"""Prefix of functions that take a mode as their last argument: ``held_max(a, b, mode)``."""

NOT_NEGATIVE = (AT_LEAST, *named("name", lambda e: e.positive == LIKE_ITS_ARGUMENT))
"""Functions that are never negative and may be zero."""

Factors = list[tuple[Tree, Tree]]
"""Trees, or keys, each with an exponent."""


_MOST_MOVES = 64
_LARGEST = 2.0**1000


def plus(a: Tree, b: Tree, times: float = 1) -> Tree:
    """Sum of two exponents, the second times a number. Equal terms are combined, so n + (1 - n) is 1."""
    terms: dict[Tree, Fraction] = {}
    _add_terms(a, Fraction(times), terms)
    _add_terms(b, Fraction(times), terms)
    found, number = ZERO, terms.pop(ONE, Fraction(0))
    for term, factor in terms.items():
        size = combine("*", _number(abs(factor)), term)
        found = combine("+" if factor > 0 else "-", found, size)
    found = combine("+" if number > 0 else "-", found, _number(abs(number)))
    left = number - Fraction(float(number))
    return ("+", found, _number(left)) if left else found  # exact, evaluated later with any number of digits


def _add_terms(e: Tree, factor: Fraction, terms: dict[Tree, Fraction]) -> None:
    """Add the terms of an exponent, with their coefficients, to given terms."""
    match e:
        case ("number", value):
            terms[ONE] = terms.get(ONE, Fraction(0)) + factor * Fraction(value)
        case ("neg", a):
            _add_terms(a, -factor, terms)
        case ("+" | "-", a, b):
            _add_terms(a, factor, terms)
            _add_terms(b, factor if e[0] == "+" else -factor, terms)
        case ("*", ("number", value), a) | ("*", a, ("number", value)):
            _add_terms(a, factor * Fraction(value), terms)
        case _:
            terms[e] = terms.get(e, Fraction(0)) + factor
    for term in [t for t, n in terms.items() if n == 0]:
        del terms[term]


def _number(value: Fraction) -> Tree:
    if value > sys.float_info.max:
        raise ExpressionError("the sum of exponents in a product is too large; up to 1.8e308 is allowed")
    return Expression.number(float(value)).tree


def product(*factors: tuple[Tree, Tree]) -> Tree:
    """A product of trees with exponents, in a form that is finite wherever possible."""
    return Product().with_all(factors).tree()


class Product:
    """A product of powers of trees.

    Attributes
    ----------
    number : Tree
    powers : dict of Tree to Tree
        Exponents by base, which is a tree, or the key of a norm or of an absolute value.
    choices : list of Tree
        Factors with branches.
    merges : bool
        Whether powers of the same base were combined, at least one of which may be infinite.
    """

    __slots__ = ("choices", "merges", "number", "powers")

    def __init__(self) -> None:
        self.number: Tree = ONE
        self.powers: dict[Tree, Tree] = {}
        self.choices: list[Tree] = []
        self.merges = False

    def copy(self) -> Product:
        found = Product()
        found.number, found.powers, found.choices = self.number, dict(self.powers), list(self.choices)
        return found

    def without(self, key: Tree) -> Product:
        """The product without one of its powers."""
        found = self.copy()
        found.powers.pop(key, None)
        return found

    def with_all(self, factors: Iterable[tuple[Tree, Tree]]) -> Product:
        """The product with more factors: trees or keys, and their exponents."""
        for tree, e in factors:
            self.times(tree, e)
        return self

    def times(self, tree: Tree, e: Tree = ONE) -> Product:
        """The product with one more factor, a tree or a key, with its exponent."""
        kind, is_whole = tree[0], e[0] == "number" and isinstance(e[1], int)
        if kind in (NORM, SIZE):
            self._add(tree, e)
        elif kind == "number" and is_whole and (number := self._number_times(tree[1], e[1])):
            self.number = number
        elif kind == "number" and is_whole and tree[1] < 0:
            self.times(("neg", ("number", -tree[1])), e)
        elif kind == "neg" and is_whole:
            self.number = combine("neg", self.number) if e[1] % 2 else self.number
            self.times(tree[1], e)
        elif kind == "*" and is_whole:
            self.times(tree[1], e).times(tree[2], e)
        elif kind == "/" and is_whole:
            self.times(tree[1], e).times(tree[2], combine("neg", e))
        elif kind == "**" and (is_whole or self._is_positive(tree)):
            self.times(tree[1], combine_numbers("*", tree[2], e))
        elif tree[:2] == ("call", "sqrt"):
            self.times(tree[2], plus(e, ZERO, 0.5))
        elif tree[:2] == ("call", "abs"):
            self._add_size(tree[2], e)
        elif tree[:2] == ("call", VANISHING) and is_whole:
            self.times(tree[2], e).times(tree[3], e)
        elif tree[:2] == ("call", CHOICE) and e == ONE:
            self.choices.append(tree)
        elif kind == "*" and tree[1][0] == "number" and tree[1][1] > 0 and e[0] == "number":
            self._add(tree[1], e)
            self.times(tree[2], e)
        elif (parts := squares(tree)) and not (len(parts) == 1 and is_whole):
            self._add((NORM, tuple(sorted(parts, key=repr))), plus(e, ZERO, 2))
        else:
            self._add(tree, e)
        return self

    def _number_times(self, value: float, e: int) -> Tree | None:
        """The number of the product times a power of another number; None if rounding would change it."""
        if value == 0 < e:
            return ZERO
        if value == 0 or not 0 < abs(e) <= 16:
            return None
        exact = Fraction(self.number[1]) * Fraction(value) ** e
        if abs(exact) >= _LARGEST or Fraction(float(exact)) != exact:
            return None
        return ("number", canonical(float(exact)))

    @staticmethod
    def _is_positive(tree: Tree) -> bool:
        """Whether the base of a power cannot be negative, so that exponents may be multiplied."""
        return tree[1][:2] in (("call", "abs"), ("call", "sqrt")) or is_positive(tree[1])

    def _add_size(self, x: Tree, e: Tree) -> None:
        """Add an absolute value with an exponent; for a product, the absolute value of each factor."""
        of = Product().times(x)
        if of.choices or any(k[0] in (NORM, SIZE) or n[0] != "number" for k, n in of.powers.items()):
            self._add((SIZE, ((ONE, x),)), e)
            return
        if of.number != ONE:
            self._add(combine("abs", of.number), e)
        for key, n in of.powers.items():
            self._add(key if key[0] == "number" else (SIZE, ((ONE, key),)), plus(e, ZERO, n[1]))

    def _add(self, key: Tree, e: Tree) -> None:
        before = self.powers.get(key)
        if before is not None:
            self.merges = self.merges or _may_be_negative(before) or _may_be_negative(e)
            e = plus(before, e)
        self.powers[key] = e
        if e == ZERO:
            del self.powers[key]

    # -- the product as a tree -------------------------------------------------------------------------------------

    @property
    def may_be_infinite(self) -> bool:
        """Whether an exponent may be negative, or a base is a logarithm."""
        return any(_may_be_negative(e) or k[:2] == ("call", "log") for k, e in self.powers.items())

    @property
    def is_better(self) -> bool:
        """Whether combining powers and separating bounded factors can make a value finite."""
        logarithm = any(k[:2] == ("call", "log") for k in self.powers) and len(self.powers) + len(self.choices) > 1
        chosen = self.may_be_infinite and any(ZERO in c[3:] for c in self.choices)
        return self.merges or logarithm or chosen or bool(self._split()[1])

    def _split(self) -> tuple[dict[Tree, Tree], list[Tree], list[Tree]]:
        """Powers, bounded factors, and signs. If a vector's length is a divisor, the vector's components are divided by it."""
        powers, bounded, signs = dict(self.powers), [], []
        for key in [k for k in powers if k[0] in (NORM, SIZE)]:
            e = powers[key]
            moves: list[Tree] = []
            left = dict(powers)
            while _may_be_negative(e) and len(moves) < _MOST_MOVES:
                x = next((x for _, x in key[1] if _take(left, x)), None)
                if x is None:
                    break
                moves.append(x)
                e = plus(e, ONE)
            if not moves or (e[0] == "number" and e[1] < 0):
                continue  # the whole product is infinite in any case
            powers = left | {key: e}
            for x in moves:
                of, number = Product().times(x), Product()
                number.number, of.number = of.number, ONE
                for n in [n for n in of.powers if n[0] == "number"]:
                    number.times(n, of.powers.pop(n))
                if key[0] == SIZE:
                    signs.append(combine("/", combine("sign", x), number.tree()))
                else:
                    bounded.append(combine("/", of.tree(), power_of(key, ONE)))
        return {k: e for k, e in powers.items() if e != ZERO}, bounded, signs

    def tree(self) -> Tree:
        """The product as a tree."""
        if self.number[1] <= 0:
            if self.number == ZERO:
                return ZERO
            opposite = self.copy()
            opposite.number = combine("neg", self.number)
            return combine("neg", opposite.tree())
        for i, (_, _, condition, x, y) in enumerate(self.choices):
            if ZERO in (x, y):
                rest = self.copy()
                del rest.choices[i]
                return _chosen(rest, condition, x, y)
        powers, slow, signs = self._split()
        above, below = self.number, ONE
        for key, e in powers.items():
            if key[:2] == ("call", "log") and e[0] == "number" and e[1] > 0:
                slow.append(power_of(key, e))
            elif key[:2] == ("call", "sign"):
                signs.append(power_of(key, e))
            elif e[0] == "number" and e[1] < 0:
                below = _multiplied(below, power_of(key, combine("neg", e)))
            else:
                above = _multiplied(above, power_of(key, e))
        for factor in (*self.choices, *([] if slow else signs)):
            above = combine("*", above, factor)
        are_numbers = above[0] == below[0] == "number" and below != ONE
        found = ("/", above, below) if are_numbers else combine("/", above, below)
        if not slow:
            return found
        slow += signs  # a sign is zero at a kink, where the product need not be zero
        factor = slow[0]
        for more in slow[1:]:
            factor = combine("*", factor, more)
        return combine(VANISHING, found, factor)


def _chosen(rest: Product, condition: Tree, x: Tree, y: Tree) -> Tree:
    """A product with a factor that is zero in one of its branches; in this branch the other factors have no effect."""
    if y == ZERO:
        return combine(CHOICE, condition, rest.times(x).tree(), ZERO)
    if condition[:2] == ("call", AT_LEAST) and rest.may_be_infinite:
        # at the switch itself, where both arguments are equal, the other factors are kept, since they may be infinite
        # there
        edge = combine("*", rest.copy().tree(), combine(CHOICE, condition, ZERO, y))
        return combine(CHOICE, combine(AT_LEAST, condition[3], condition[2]), edge, ZERO)
    return combine(CHOICE, condition, ZERO, rest.times(y).tree())


def _take(powers: dict[Tree, Tree], x: Tree) -> bool:
    """Whether a tree, up to a numerical factor, is a factor of a product of powers; if so, it is removed from them."""
    of = Product().times(x)
    have = [(key, e, powers.get(key, ZERO)) for key, e in of.powers.items() if key[0] != "number"]
    if not have or of.choices or not all(e[0] == n[0] == "number" and n[1] >= e[1] > 0 for _, e, n in have):
        return False
    for key, e, n in have:
        powers[key] = plus(n, plus(ZERO, e, -1))
    return True


def _may_be_negative(e: Tree) -> bool:
    return bool(e[0] != "number" or e[1] < 0)


def power_of(key: Tree, e: Tree) -> Tree:
    """A power as a tree."""
    if key[0] == SIZE:
        base = combine("abs", key[1][0][1])
    elif key[0] == NORM:
        square = ZERO
        for weight, x in key[1]:
            square = combine("+", square, combine("*", weight, combine("**", x, TWO)))
        if e[0] == "number" and isinstance(e[1], int) and e[1] % 2 == 0:
            return combine("**", square, ("number", e[1] // 2))
        base = combine("sqrt", square)
    elif key[0] == "number":
        return key if e == ONE else ("**", key, e)  # the power is evaluated later, with any number of digits
    elif e == HALF:
        return combine("sqrt", key)
    else:
        base = key
    return combine("**", base, e)


def _multiplied(a: Tree, b: Tree) -> Tree:
    """A product of trees; a product of numbers is evaluated later, with any number of digits."""
    return ("*", a, b) if a[0] == b[0] == "number" and ONE not in (a, b) else combine("*", a, b)


def squares(tree: Tree) -> tuple[tuple[Tree, Tree], ...]:
    """Weights and squared terms of a weighted sum of squares; empty for any other tree."""
    if tree[0] == "+":
        one = squares(tree[1])
        other = squares(tree[2]) if one else ()
        return one + other if other else ()
    if tree[0] not in ("*", "**"):
        return ()
    of = Product().times(tree) if tree[0] == "*" else None
    powers = of.powers if of is not None else {tree[1]: tree[2]}
    root, weight = Product(), Product()
    weight.number = ONE if of is None else of.number
    for key, e in powers.items():
        if e[0] == "number" and isinstance(e[1], int) and e[1] > 0 and e[1] % 2 == 0:
            root.times(key, ("number", e[1] // 2))
        else:
            weight.times(key, e)
    if of is not None and (of.choices or of.number[1] < 0):
        return ()
    return ((weight.tree(), root.tree()),) if root.powers else ()


def is_positive(tree: Tree) -> bool:
    """Whether a tree is known to be positive for all values of its names."""
    kind = tree[0]
    if kind == "number":
        return bool(tree[1] > 0)
    if kind == "+":
        a, b = tree[1:]
        return (is_positive(a) and _is_not_negative(b)) or (_is_not_negative(a) and is_positive(b))
    if kind in ("*", "/"):
        return is_positive(tree[1]) and is_positive(tree[2])
    if kind == "**":
        return is_positive(tree[1])
    positive = TABLE[tree[1]].positive if kind == "call" and tree[1] in TABLE else ""
    return positive == "always" or (positive == LIKE_ITS_ARGUMENT and is_positive(tree[2]))


def _is_not_negative(tree: Tree) -> bool:
    kind = tree[0]
    if kind in ("+", "*"):
        return _is_not_negative(tree[1]) and _is_not_negative(tree[2])
    if kind == "**" and tree[2][0] == "number" and isinstance(tree[2][1], int) and tree[2][1] % 2 == 0:
        return True
    return tree == ZERO or is_positive(tree) or (kind == "call" and tree[1] in NOT_NEGATIVE)
