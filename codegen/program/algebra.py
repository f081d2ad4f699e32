"""Expressions of statements: sums, products, powers and functions of symbols and numbers, each kept once.

Statements are short, and there are many. A general algebra system would spend most of the generation time on questions
such as whether a product commutes. Only a few operations are needed here: terms and factors are sorted, equal terms and
equal factors are combined, zeros and ones are dropped. Equal expressions are the same object, so comparison and lookup
are fast.

The rules of simplification are those of sympy. Terms that differ only in their numerical factor are combined, and so are
powers of one base. A product of a number and a sum is multiplied out; other products are not. Results of `raw_sum` and
`raw_product` keep their order until something is substituted into them.
"""
# long: the operators of expressions call the rules for sums, products and powers, and these create expressions

from __future__ import annotations

import math
import operator
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from typing import ClassVar, Protocol, TypeVar
from weakref import WeakValueDictionary

import mpmath

from ..records import dataclass

Real = int | Fraction | float
"""A number: an integer, a fraction, or a double; with extended precision an ``mpmath.mpf`` replaces the double."""

T = TypeVar("T")
_SYMBOL, _POWER, _PRODUCT, _SUM, _FUNCTION = range(13, 18)


class Expr:
    """An expression.

    Attributes
    ----------
    args : tuple of Expr
    key : tuple
        Sort key, by which terms and factors are ordered.
    free_symbols : frozenset of Symbol
    """

    __slots__ = ("args", "free_symbols", "key")
    is_Symbol: ClassVar[bool] = False
    is_Number: ClassVar[bool] = False
    is_Add: ClassVar[bool] = False
    is_Mul: ClassVar[bool] = False
    is_Pow: ClassVar[bool] = False
    is_Function: ClassVar[bool] = False
    args: tuple[Expr, ...]
    key: tuple[object, ...]
    free_symbols: frozenset[Symbol]

    def __add__(self, other: object) -> Expr:
        return add(self, expression(other))

    __radd__ = __add__

    def __sub__(self, other: object) -> Expr:
        return add(self, negative(expression(other)))

    def __rsub__(self, other: object) -> Expr:
        return add(expression(other), negative(self))

    def __mul__(self, other: object) -> Expr:
        return multiply(self, expression(other))

    __rmul__ = __mul__

    def __truediv__(self, other: object) -> Expr:
        return multiply(self, power(expression(other), MINUS_ONE))

    def __rtruediv__(self, other: object) -> Expr:
        return multiply(expression(other), power(self, MINUS_ONE))

    def __pow__(self, other: object) -> Expr:
        return power(self, expression(other))

    def __neg__(self) -> Expr:
        return negative(self)

    def __repr__(self) -> str:
        return _text(self)

    def __reduce__(self) -> tuple[object, ...]:
        raise TypeError("expressions cannot be pickled: they are unique within one process")

    def xreplace(self, rule: Mapping[Symbol, Expr]) -> Expr:
        """Return the expression with symbols replaced by other expressions."""
        if self.free_symbols.isdisjoint(rule):
            return self
        args = [a.xreplace(rule) for a in self.args]
        return self if all(a is b for a, b in zip(args, self.args, strict=True)) else self.rebuilt(args)

    def rebuilt(self, args: list[Expr]) -> Expr:
        """Return the expression with the same operation on other operands."""
        raise NotImplementedError


class Symbol(Expr):
    """A symbol; each name has exactly one."""

    __slots__ = ("__weakref__", "name")
    is_Symbol = True
    name: str

    def __new__(cls, name: str) -> Symbol:
        found = _symbols.get(name)
        if found is None:
            found = object.__new__(cls)
            found.name, found.args, found.key = name, (), (_SYMBOL, "", 0, name)
            found.free_symbols = frozenset((found,))
            with _changing:
                found = _symbols.setdefault(name, found)
        return found

    def xreplace(self, rule: Mapping[Symbol, Expr]) -> Expr:
        return rule.get(self, self)

    def __str__(self) -> str:
        return self.name


def _compared(by: Callable[[Real, Real], bool]) -> Callable[[Number, object], bool]:
    """A comparison of a symbolic number with another symbolic number, or with a Python number."""
    return lambda number, other: by(number.value, _value(other))


class Number(Expr):
    """A number. A double with an integer value is stored as the integer.

    A number equals plain numbers of the same value and has their hash. Two numbers of the same type and value are the
    same object. A double and a fraction of the same value are different numbers, because sums with them round
    differently.
    """

    __slots__ = ("hash", "value")
    is_Number = True
    value: Real
    hash: int

    def __new__(cls, value: object) -> Number:
        number = value if type(value) is int else _plain(value)
        entry = type(number), number
        found = _numbers.get(entry)
        if found is None:
            found = object.__new__(cls)
            found.value, found.args, found.free_symbols = number, (), _NONE
            found.key, found.hash = _number_key(number), hash(number)
            found = _numbers.setdefault(entry, found)
        return found

    @property
    def is_Integer(self) -> bool:
        return isinstance(self.value, int)

    @property
    def is_finite(self) -> bool:
        """Return whether a double can represent the number."""
        try:
            return math.isfinite(float(self.value))
        except OverflowError:
            return False

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Number):
            return self is other
        return self.value == other if isinstance(other, (int, float, Fraction, mpmath.mpf)) else NotImplemented

    def __hash__(self) -> int:
        return self.hash

    def __float__(self) -> float:
        return float(self.value)

    def __int__(self) -> int:
        return int(self.value)

    def __bool__(self) -> bool:
        return self.value != 0

    def __abs__(self) -> Number:
        return Number(abs(self.value))

    __lt__ = _compared(operator.lt)
    __le__ = _compared(operator.le)
    __gt__ = _compared(operator.gt)
    __ge__ = _compared(operator.ge)

    def xreplace(self, rule: Mapping[Symbol, Expr]) -> Expr:
        return self


class Add(Expr):
    """A sum of expressions."""

    __slots__ = ()
    is_Add = True

    def rebuilt(self, args: list[Expr]) -> Expr:
        return add(*args)


class Mul(Expr):
    """A product of expressions; a numerical factor comes first."""

    __slots__ = ()
    is_Mul = True

    def rebuilt(self, args: list[Expr]) -> Expr:
        return multiply(*args)


class Pow(Expr):
    """A power of an expression, with a number as exponent."""

    __slots__ = ()
    is_Pow = True

    @property
    def base(self) -> Expr:
        return self.args[0]

    @property
    def exp(self) -> Number:
        found = self.args[1]
        assert isinstance(found, Number)
        return found

    def rebuilt(self, args: list[Expr]) -> Expr:
        return power(*args)


class Function(Expr):
    """An elementary function applied to operands."""

    __slots__ = ("name",)
    is_Function = True
    name: str

    def rebuilt(self, args: list[Expr]) -> Expr:
        return MEANINGS[self.name].make(*args)


class Made(Protocol):
    """A function that returns the value of an elementary function for its operands, which are expressions or
    numbers."""

    def __call__(self, *arguments: object) -> Expr: ...


@dataclass(frozen=True, slots=True)
class Meaning:
    """Definition of an elementary function.

    Attributes
    ----------
    make : callable
        Returns the value for expressions or numbers.
    value : callable (numbers) -> number
    slope : callable (Function, int) -> Expr
        Returns the derivative with respect to one argument.
    """

    make: Made
    value: Callable[[Sequence[float]], float]
    slope: Callable[[Function, int], Expr]


MEANINGS: dict[str, Meaning] = {}
"""Elementary functions by name; `functions` fills the table."""

_NONE: frozenset[Symbol] = frozenset()
_symbols: WeakValueDictionary[str, Symbol] = WeakValueDictionary()
_numbers: dict[tuple[type, object], Number] = {}
_made: dict[tuple[object, ...], Expr] = {}
"""Caches of sums, products, powers and functions by their operands, and of results of `add` and `multiply`."""
_remembered: list[Callable[[], None]] = []
_users, _changing = 0, threading.Lock()


def remembered(f: Callable[[Expr], T]) -> Callable[[Expr], T]:
    """Decorate a function of an expression: inside `expressions_kept`, each value is computed only once."""
    known: dict[Expr, T] = {}
    _remembered.append(known.clear)

    def of(e: Expr) -> T:
        found = known.get(e)
        if found is None:
            found = known[e] = f(e)
        return found

    return of


@contextmanager
def expressions_kept() -> Iterator[None]:
    """Inside the context, equal expressions are kept as one object; they are released when the outermost context
    ends."""
    global _users
    with _changing:
        _users += 1
    try:
        yield
    finally:
        with _changing:
            _users -= 1
            if not _users:
                for clear in (_made.clear, *_remembered):
                    clear()
                _numbers.clear()
                _numbers.update({(type(n.value), n.value): n for n in _COMMON})


def _plain(value: object) -> Real:
    if isinstance(value, Number):
        return value.value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, Fraction):
        return int(value) if value.denominator == 1 else value
    if isinstance(value, mpmath.mpf):
        whole = mpmath.isint(value) and abs(value) < 2**53
        found: Real = int(value) if whole else value
        return found
    if not isinstance(value, float):
        raise TypeError(f"{value!r} is not a number")
    return int(value) if value.is_integer() and abs(value) < 2**53 else float(value)


def _value(other: object) -> float:
    found: float = other.value if isinstance(other, Number) else other  # type: ignore[assignment]
    return found


def _number_key(value: Real) -> tuple[object, ...]:
    """The sort key of a number."""
    place = (
        {0: 0, 1: 1, Fraction(1, 2): 2, -1: 5}.get(value) if not isinstance(value, float) or value == value else None
    )
    if place is not None:
        return (place, "", 0)
    if isinstance(value, int):
        return (7, "", 2, value, 1)
    if isinstance(value, Fraction):
        return (8, "", 2, value.numerator, value.denominator)
    if not math.isfinite(value):
        return (10, "", 1, str(value))
    return (9, "", 1, mpmath.mpf(value)._mpf_)


def _node(kind: type[Expr], rank: int, args: tuple[Expr, ...]) -> Expr:
    entry = (rank, *args)
    found: Expr | None = _made.get(entry)
    if found is None:
        found = object.__new__(kind)
        found.args = args
        found.key = (rank, "", len(args), *[a.key for a in args])
        found.free_symbols = _NONE.union(*[a.free_symbols for a in args])
        found = _made.setdefault(entry, found)
    return found


def function(name: str, *args: Expr) -> Expr:
    """The value of an elementary function, without simplification."""
    entry = (_FUNCTION, name, *args)
    found = _made.get(entry)
    if found is None:
        made = object.__new__(Function)
        made.name, made.args = name, args
        made.key = (_FUNCTION, name, len(args), *[a.key for a in args])
        made.free_symbols = _NONE.union(*[a.free_symbols for a in args])
        found = _made.setdefault(entry, made)
    return found


def expression(value: object) -> Expr:
    """Convert a number to an expression; expressions are returned unchanged."""
    if isinstance(value, Expr):
        return value
    if isinstance(value, (int, float, Fraction, mpmath.mpf)):
        return Number(value)
    raise TypeError(f"{value!r} is not an expression")


def _key(e: Expr) -> tuple[object, ...]:
    return e.key


def raw_sum(*args: Expr) -> Expr:
    """A sum of terms in the given order, without simplification."""
    return _node(Add, _SUM, args)


def raw_product(*args: Expr) -> Expr:
    """A product of factors in the given order, without simplification."""
    return _node(Mul, _PRODUCT, args)


def replaced_in_order(e: Expr, rule: Mapping[Symbol, Expr]) -> Expr:
    """Substitute as `Expr.xreplace` does, but keep the order of terms and factors, so that rounding does not change."""
    if isinstance(e, Symbol) or e.free_symbols.isdisjoint(rule):
        return e.xreplace(rule)
    args = [replaced_in_order(a, rule) for a in e.args]
    found = e.rebuilt(args)
    is_sum = e.is_Add and found.is_Add
    if (not is_sum and not (e.is_Mul and found.is_Mul)) or sorted(found.args, key=_key) != sorted(args, key=_key):
        return found
    return raw_sum(*args) if is_sum else raw_product(*args)


def coefficient(e: Expr) -> tuple[Number, Expr]:
    """Split an expression into its numerical factor and the rest."""
    if isinstance(e, Number):
        return e, ONE
    if e.is_Mul:
        first = e.args[0]
        if isinstance(first, Number):
            rest = e.args[1:]
            return first, rest[0] if len(rest) == 1 else raw_product(*rest)
    return ONE, e


def add(*args: Expr) -> Expr:
    """A sum of expressions, simplified."""
    args = tuple([a for a in args if a is not ZERO])
    if len(args) < 2:
        return args[0] if args else ZERO
    entry = ("+", *args)
    found: Expr | None = _made.get(entry)
    if found is None:
        found = _made[entry] = _sum(args)
    return found


def _sum(args: tuple[Expr, ...]) -> Expr:
    if _are_apart(args):
        return raw_sum(*sorted(args, key=_key))
    terms: dict[Expr, Real] = {}
    number: Real = 0
    waiting = list(args)
    for e in waiting:
        if isinstance(e, Number):
            number = _with_digits(number, e.value, add=True)
        elif e.is_Add:
            waiting.extend(e.args)
        else:
            c, rest = coefficient(e)
            terms[rest] = _with_digits(terms[rest], c.value, add=True) if rest in terms else c.value
    found = []
    for rest, times in terms.items():
        if times == 0:
            continue
        if times == 1:
            found.append(rest)
        elif rest.is_Mul:
            found.append(raw_product(Number(times), *rest.args))
        elif rest.is_Add:
            found.append(raw_product(Number(times), rest))
        else:
            found.append(multiply(Number(times), rest))
    found.sort(key=_key)
    if number != 0:
        found.insert(0, Number(number))
    if len(found) < 2:
        return found[0] if found else ZERO
    return raw_sum(*found)


def _are_apart(terms: tuple[Expr, ...]) -> bool:
    """Return whether the terms of a sum need no combining: none is a number or a sum, and no two differ only in a number."""
    found = set()
    for e in terms:
        if e.is_Add or e.is_Number:
            return False
        factors = e.args if e.is_Mul else (e,)
        first = factors[0]
        if isinstance(first, Number):
            if first is ZERO or first is ONE:
                return False
            factors = factors[1:]
        found.add(factors)
    return len(found) == len(terms)


def _with_digits(a: Real, b: Real, add: bool) -> Real:
    """The sum (`add`) or product of two numbers; if one is a double, a fraction becomes a double first."""
    if isinstance(a, (float, mpmath.mpf)) and isinstance(b, (Fraction, int)):
        b = _as_double(b, a)
    elif isinstance(b, (float, mpmath.mpf)) and isinstance(a, (Fraction, int)):
        a = _as_double(a, b)
    found = a + b if add else a * b
    return _plain(found)


def _as_double(value: Fraction | int, like: Real) -> Real:
    if isinstance(like, mpmath.mpf):
        quotient: float = mpmath.mpf(value.numerator) / value.denominator
        return quotient
    try:
        return float(value)
    except OverflowError:
        return math.copysign(math.inf, value)


def negative(e: Expr) -> Expr:
    """The negative of an expression."""
    if isinstance(e, Number):
        return Number(-e.value)
    if e.is_Add:
        return multiply(MINUS_ONE, e)
    if not e.is_Mul:
        return raw_product(MINUS_ONE, e)
    c, rest = coefficient(e)
    c = Number(-c.value)
    if c is ONE:
        return rest
    if rest.is_Add:
        return multiply(c, rest)
    return raw_product(c, *(rest.args if rest.is_Mul else (rest,)))


def multiply(*args: Expr) -> Expr:
    """A product of expressions, simplified."""
    args = tuple([a for a in args if a is not ONE])
    if len(args) < 2:
        return args[0] if args else ONE
    entry = ("*", *args)
    found: Expr | None = _made.get(entry)
    if found is None:
        found = _made[entry] = _product(args)
    return found


def _keep(c: Number, e: Expr) -> Expr:
    """A number times one term of a sum."""
    if isinstance(e, Number):
        return Number(_with_digits(c.value, e.value, add=False))
    if c is MINUS_ONE:
        return negative(e)
    if e.is_Add:
        return raw_product(c, e)
    if e.is_Mul:
        of, rest = coefficient(e)
        c = Number(_with_digits(c.value, of.value, add=False))
        factors = rest.args if rest.is_Mul else (rest,)
        return raw_product(c, *factors) if c is not ONE else rest
    return multiply(c, e)


def _product(args: tuple[Expr, ...]) -> Expr:
    if len(args) == 2:
        a, b = args
        if a is not b and not (a.is_Number or a.is_Mul or a.is_Pow or b.is_Number or b.is_Mul or b.is_Pow):
            return raw_product(a, b) if a.key <= b.key else raw_product(b, a)
        if isinstance(b, Number):
            a, b = b, a
        if isinstance(a, Number) and a is not ZERO:
            c, rest = coefficient(b)
            if rest.is_Add:
                if c is not ONE:
                    both = Number(_with_digits(a.value, c.value, add=False))
                    return rest if both is ONE else raw_product(both, rest)
                return add(*[_keep(a, term) for term in rest.args])
    number: Real = 1
    powers: dict[Expr, Real] = {}
    waiting = list(args)
    for e in waiting:
        if isinstance(e, Number):
            number = _with_digits(number, e.value, add=False)
        elif e.is_Mul:
            waiting.extend(e.args)
        elif isinstance(e, Pow):
            powers[e.base] = powers.get(e.base, 0) + e.exp.value
        else:
            powers[e] = powers.get(e, 0) + 1
    if number == 0:
        return ZERO
    factors: list[Expr] = []
    again = False
    for base, exponent in powers.items():
        if exponent == 0:
            continue
        p = base if exponent == 1 else power(base, Number(exponent))
        if isinstance(p, Number):
            number = _with_digits(number, p.value, add=False)
            continue
        again = again or p.is_Mul or (isinstance(p, Pow) and p.base is not base)
        factors.append(p)
    if again:
        return multiply(Number(number), *factors)
    factors.sort(key=_key)
    c = Number(number)
    if c is not ONE:
        factors.insert(0, c)
    if len(factors) < 2:
        return factors[0] if factors else ONE
    if len(factors) == 2 and c is not ONE and factors[1].is_Add and c.is_finite:
        return add(*[multiply(c, term) for term in factors[1].args])
    return raw_product(*factors)


def power(base: Expr, exponent: Expr) -> Expr:
    """A power with a numerical exponent, simplified."""
    if not isinstance(exponent, Number):
        raise TypeError(f"{base}**{exponent}: exponents are numbers")
    n = exponent.value
    if n == 0:
        return ONE
    if n == 1 or base is ONE:
        return base
    if isinstance(base, Number):
        return _power_of_number(base, exponent)
    if isinstance(base, Pow):
        inner: Real = base.exp.value
        if isinstance(n, int) or -1 < inner < 1:
            return power(base.base, Number(inner * n))
    elif base.is_Mul:
        if isinstance(n, int):
            return multiply(*[power(f, exponent) for f in base.args])
        c, rest = coefficient(base)
        if c is not ONE and c.value > 0:
            return multiply(power(c, exponent), power(rest, exponent))
    return _node(Pow, _POWER, (base, exponent))


def _power_of_number(base: Number, exponent: Number) -> Expr:
    a, n = base.value, exponent.value
    if a == 0:
        return ZERO if n > 0 else Number(math.inf)
    if isinstance(n, int) and isinstance(a, (int, Fraction)):
        return Number(Fraction(a) ** n)
    if isinstance(n, Fraction) and isinstance(a, (int, Fraction)) and a > 0:
        root = Fraction(a) ** n.numerator
        parts = (
            [round(x ** (1 / n.denominator)) for x in (root.numerator, root.denominator)]
            if root.numerator < 2**52
            else []
        )
        if parts and parts[0] ** n.denominator == root.numerator and parts[1] ** n.denominator == root.denominator:
            return Number(Fraction(*parts))
        return _node(Pow, _POWER, (base, exponent))
    if a < 0 and not isinstance(n, int):
        return Number(math.nan)
    try:
        if isinstance(a, mpmath.mpf) or isinstance(n, mpmath.mpf):
            return Number(mpmath.mpf(a) ** n)
        if n == -1:
            return Number(1.0 / a)
        if n == Fraction(1, 2):
            return Number(math.sqrt(a))
        with mpmath.workprec(53):
            return Number(float(mpmath.mpf(a) ** (n if isinstance(n, int) else float(n))))
    except OverflowError:
        return Number(math.inf)


def ratio(a: Number, b: Number) -> Number:
    """The quotient of two numbers."""
    found = multiply(a, power(b, MINUS_ONE))
    assert isinstance(found, Number)
    return found


def numbers_of(e: Expr) -> Iterator[Number]:
    """All numbers that occur in an expression."""
    if isinstance(e, Number):
        yield e
    for a in e.args:
        yield from numbers_of(a)


def value_of_number(e: Expr) -> float:
    """The value of an expression without symbols, as a double or, if it contains numbers of higher precision, as an
    ``mpmath`` number."""
    long = mpmath.mp.prec > 53
    if isinstance(e, Number):
        if long and isinstance(e.value, Fraction):
            quotient: float = mpmath.mpf(e.value.numerator) / e.value.denominator
            return quotient
        return e.value if isinstance(e.value, (int, mpmath.mpf)) else float(e.value)
    values = [value_of_number(a) for a in e.args]
    if e.is_Add:
        return sum(values)
    if e.is_Mul:
        return math.prod(values)
    if isinstance(e, Pow):
        a, n = values
        if e.exp is HALF:
            root: float = mpmath.sqrt(a) if long else math.sqrt(a)
            return root
        power: float = (mpmath.mpf(a) if long else float(a)) ** n
        return power
    assert isinstance(e, Function)
    return MEANINGS[e.name].value(values)


def sqrt(e: object) -> Expr:
    """The square root of an expression, simplified."""
    return power(expression(e), HALF)


def derivative(e: Expr, by: Symbol) -> Expr:
    """The derivative of an expression with respect to one of its symbols."""
    if by not in e.free_symbols:
        return ZERO
    if e is by:
        return ONE
    if e.is_Add:
        return add(*[derivative(a, by) for a in e.args])
    if e.is_Mul:
        terms = []
        for i, a in enumerate(e.args):
            d = derivative(a, by)
            if d is not ZERO:
                product: Expr = ONE
                for f in (*e.args[:i], d, *e.args[i + 1 :]):
                    product = multiply(product, f)
                terms.append(product)
        return add(*terms)
    if isinstance(e, Pow):
        return e * (derivative(e.base, by) * e.exp / e.base)
    assert isinstance(e, Function)
    slope = MEANINGS[e.name].slope
    return add(*[slope(e, i) * derivative(a, by) for i, a in enumerate(e.args) if by in a.free_symbols])


def _text(e: Expr) -> str:
    """The expression in Python syntax, for messages and tests."""
    if isinstance(e, Number):
        return f"({e.value})" if isinstance(e.value, Fraction) or e.value < 0 else str(e.value)
    if isinstance(e, Symbol):
        return e.name
    inside = [_text(a) if not a.args else f"({_text(a)})" for a in e.args]
    if isinstance(e, Function):
        return f"{e.name}({', '.join(map(_text, e.args))})"
    return {Add: " + ", Mul: "*", Pow: "**"}[type(e)].join(inside)


ZERO, ONE, MINUS_ONE, HALF = Number(0), Number(1), Number(-1), Number(Fraction(1, 2))
_COMMON = (ZERO, ONE, MINUS_ONE, HALF)
