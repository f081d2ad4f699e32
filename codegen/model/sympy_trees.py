"""sympy expressions as model expressions.

sympy is never imported at the top of this module: the caller who made a sympy object has imported it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache, reduce
from typing import Any, Final

from ..elementary import TABLE
from .expressions import Expression, canonical
from .grammar import AT_LEAST, CHOICE, MAX_DEPTH, ONE, ZERO, ExpressionError, Tree, functions

MAX_SIZE: Final = 100_000
"""Largest number of operations of an expression; sympy shares repeated parts, but a tree does not."""
_CHAIN: Final = 16
"""Sums and products with more terms are written as a sum of sums, which limits the depth of the tree."""
_NAME_PARTS: Final = "name parts of it with ModelBuilder.expression"
_TOO_LARGE: Final = f"more than {MAX_SIZE} operations; {_NAME_PARTS}"
_TOO_DEEP: Final = f"operations nested too deeply; {_NAME_PARTS}"

Named = Callable[[Any], Tree]
"""The tree of a symbol, of a function of time or of a derivative; raises `ExpressionError` for an unknown one."""
Condition = tuple[Tree, Tree]
"""Two trees, 1 and 0 if the condition holds, otherwise 0 and 1."""


def is_sympy(value: object) -> bool:
    """Whether a value is a sympy expression or matrix; never imports sympy."""
    sympy: Any = sys.modules.get("sympy")
    return (
        hasattr(sympy, "Basic") and hasattr(sympy, "MatrixBase") and isinstance(value, (sympy.Basic, sympy.MatrixBase))
    )


def from_sympy_expression(value: Any, named: Named) -> Expression:
    """The model expression that equals a sympy expression.

    Integers and rationals stay exact, and pi becomes that of the grammar; a `Float` is rounded to a double.

    Parameters
    ----------
    value : sympy.Basic
    named : callable (sympy.Basic) -> tree
        See `Named`.

    Returns
    -------
    Expression

    Raises
    ------
    ExpressionError
        For functions that the grammar lacks, constants that are not real, and objects that are not numbers.
    """
    import sympy

    if not isinstance(value, sympy.Basic):
        raise ExpressionError(f"a matrix of shape {value.shape}; an expression with a real value is needed")
    if isinstance(value, sympy.Lambda):
        raise ExpressionError(f"{_shown(value)} is a Lambda; an expression with a real value is needed")
    try:
        if _size(value, {}) > MAX_SIZE:
            raise ExpressionError(_TOO_LARGE)
        return Expression(_Trees(named).tree(_real(value)))
    except RecursionError:
        raise ExpressionError(_TOO_DEEP) from None


def _size(e: Any, known: dict[Any, int]) -> int:
    """Number of nodes of an expression as a tree, in which repeated parts are not shared."""
    found = known.get(e)
    if found is None:
        found = known[e] = 1 + sum(_size(a, known) for a in e.args)
    return found


def _real(value: Any) -> Any:
    """The expression after evaluating real parts, imaginary parts and conjugates of real quantities."""
    import sympy

    if not value.has(sympy.re, sympy.im, sympy.conjugate):
        return value
    parts = {sympy.re: lambda a: a, sympy.im: lambda a: sympy.Integer(0), sympy.conjugate: lambda a: a}
    for part, taken in parts.items():
        value = value.replace(part, taken)
    return value.replace(sympy.Derivative, lambda *of: sympy.Derivative(*of).doit())


@cache
def _functions() -> dict[Any, str]:
    """Functions of sympy, with their names in the grammar."""
    import sympy

    return {getattr(sympy, e.spelled("sympy")): e.name for e in TABLE.values()}


@cache
def _formulas() -> dict[Any, Callable[..., Any]]:
    """Formulas for functions that the grammar lacks."""
    import sympy as s

    return {
        s.sec: lambda x: 1 / s.cos(x),
        s.csc: lambda x: 1 / s.sin(x),
        s.cot: lambda x: s.cos(x) / s.sin(x),
        s.sech: lambda x: 1 / s.cosh(x),
        s.csch: lambda x: 1 / s.sinh(x),
        s.coth: lambda x: 1 / s.tanh(x),
        s.asec: lambda x: s.acos(1 / x),
        s.acsc: lambda x: s.asin(1 / x),
        s.acot: lambda x: s.Piecewise((s.atan(1 / x), s.Ne(x, 0)), (s.pi / 2, True)),
        s.asech: lambda x: s.acosh(1 / x),
        s.acsch: lambda x: s.asinh(1 / x),
        s.acoth: lambda x: s.atanh(1 / x),
        s.sinc: lambda x: s.Piecewise((s.sin(x) / x, s.Ne(x, 0)), (1, True)),
        s.floor: lambda x: x - s.Mod(x, 1, evaluate=False),
        s.ceiling: lambda x: x + s.Mod(-x, 1, evaluate=False),
        s.frac: lambda x: s.Mod(x, 1, evaluate=False),
        s.Heaviside: lambda x, at_zero=s.S.Half: s.Piecewise((1, x > 0), (0, x < 0), (at_zero, True)),
        s.UnevaluatedExpr: lambda x: x,
    }


class _Trees:
    """Makes trees of the parts of an expression, each part once."""

    def __init__(self, named: Named) -> None:
        self.named = named
        self.known: dict[Any, Tree] = {}
        self.extents: dict[int, tuple[int, int]] = {}  # by the identity of trees, which `known` keeps alive

    def tree(self, e: Any) -> Tree:
        """The tree of a part of an expression."""
        found = self.known.get(e)
        if found is None:
            found = self.known[e] = self.made(e)
            depth, size = self.extents[id(found)] = self.extent(found)
            if depth > MAX_DEPTH:
                raise ExpressionError(_TOO_DEEP)
            if size > MAX_SIZE:
                raise ExpressionError(_TOO_LARGE)
        return found

    def extent(self, tree: Tree) -> tuple[int, int]:
        """Depth of a tree, and its number of nodes."""
        found = self.extents.get(id(tree))
        if found is not None:
            return found
        inner = [self.extent(part) for part in tree[1:] if isinstance(part, tuple)]
        return 1 + max((d for d, _ in inner), default=0), 1 + sum(n for _, n in inner)

    def made(self, e: Any) -> Tree:
        """The tree of a part that has not occurred before."""
        import sympy

        if getattr(e, "is_commutative", True) is False:
            raise ExpressionError(f"{_shown(e)} does not commute; a real number is needed")
        if e.is_Atom and e.is_number:
            return _number(e)
        if isinstance(e, (sympy.Symbol, sympy.core.function.AppliedUndef, sympy.Derivative)):
            return self.leaf(e)
        if not isinstance(e, sympy.Expr):
            raise ExpressionError(f"{_shown(e)} is a {type(e).__name__}; an expression with a real value is needed")
        if e.is_number and e.is_extended_real is False:
            raise ExpressionError(f"the constant {_shown(e)} is not real; constants of a model are real numbers")
        if e.is_Add:
            return self.sum(e.args)
        if e.is_Mul:
            return self.product(e)
        if e.is_Pow:
            return self.power(e.base, e.exp)
        if isinstance(e, sympy.Piecewise):
            return self.piecewise(e)
        return self.function(e)

    def leaf(self, e: Any) -> Tree:
        """The tree of a name, or of the derivative of an object that is not a name."""
        if e.is_Derivative and (done := e.doit()) != e:
            return self.tree(_real(done))
        return self.named(e)

    def evaluated(self, e: Any) -> Tree:
        """The tree of an object after sympy has evaluated it."""
        done = _real(e.doit())
        if done.func == e.func:
            raise ExpressionError(f"{_shown(e)}: sympy finds no closed form; write the result")
        return self.tree(done)

    def sum(self, terms: Sequence[Any]) -> Tree:
        """A sum; terms with a negative factor are subtracted."""
        if len(terms) > _CHAIN:
            middle = len(terms) // 2
            return ("+", self.sum(terms[:middle]), self.sum(terms[middle:]))
        minus = [t.could_extract_minus_sign() if not t.is_Add else False for t in terms]
        order = sorted(range(len(terms)), key=lambda k: minus[k])
        total = self.tree(terms[order[0]])
        for k in order[1:]:
            total = ("-", total, self.tree(-terms[k])) if minus[k] else ("+", total, self.tree(terms[k]))
        return total

    def product(self, e: Any) -> Tree:
        """A product of powers, as a quotient of two products."""
        number, rest = e.as_coeff_Mul()
        above, below = ([], []) if number in (1, -1) else _fraction(abs(number))
        for factor in rest.args if rest.is_Mul else (rest,):
            base, exponent = factor.as_base_exp() if factor.is_Pow else (factor, None)
            if exponent is not None and exponent.is_Rational and exponent.is_negative:
                below.append(self.power(base, -exponent))
            else:
                above.append(self.tree(factor))
        if number.is_negative:
            above[:1] = [("neg", above[0] if above else ONE)]
        numerator = _joined("*", above) if above else ONE
        return ("/", numerator, _joined("*", below)) if below else numerator

    def power(self, base: Any, exponent: Any) -> Tree:
        """A power; the exponent 1/2 becomes a root, and negative exponents a denominator."""
        import sympy

        if exponent.is_Rational and exponent.is_negative:
            return ("/", ONE, self.power(base, -exponent))
        if base is sympy.E:
            return ("call", "exp", self.tree(exponent))
        if exponent == 1:
            return self.tree(base)
        if exponent is sympy.S.Half:
            return ("call", "sqrt", self.tree(base))
        return ("**", self.tree(base), self.tree(exponent))

    def function(self, e: Any) -> Tree:
        """A function of the grammar, or the formula for another one."""
        import sympy

        name = _functions().get(e.func)
        if name is not None and TABLE[name].many:
            ordered = [
                self.tree(a) for a in sorted(e.args, key=sympy.default_sort_key)
            ]  # sympy's own order depends on hashes
            return reduce(lambda a, b: ("call", name, a, b), ordered)
        if name is not None:
            return ("call", name, *[self.tree(a) for a in e.args])
        if e.func in _formulas():
            return self.tree(_real(sympy.sympify(_formulas()[e.func](*e.args))))
        if isinstance(e, (sympy.Subs, sympy.Integral, sympy.Sum, sympy.Product, sympy.Limit)):
            return self.evaluated(e)
        what = f"{_shown(e)}: " if e.args else ""
        raise ExpressionError(f"{what}{type(e).__name__} is not a function of a model; {functions(type(e).__name__)}")

    def piecewise(self, e: Any) -> Tree:
        """Branches from the last to the first, each with its condition."""
        import sympy

        if e.args[-1][1] != sympy.true:
            message = "has no value if none of its conditions holds; let it end with (value, True)"
            raise ExpressionError(f"{_shown(e)} {message}")
        result = self.tree(e.args[-1][0])
        for value, condition in reversed(e.args[:-1]):
            result = ("call", CHOICE, self.condition(condition)[0], self.tree(value), result)
        return result

    def condition(self, e: Any) -> Condition:
        """A condition made of comparisons."""
        import sympy

        if e in (sympy.true, sympy.false):
            return (ONE, ZERO) if e == sympy.true else (ZERO, ONE)
        if isinstance(e, sympy.Not):
            holds, fails = self.condition(e.args[0])
            return fails, holds
        if isinstance(e, (sympy.And, sympy.Or)):
            parts = [self.condition(a) for a in sorted(e.args, key=sympy.default_sort_key)]
            if isinstance(e, sympy.Or):
                return reduce(_either, parts)
            fails, holds = reduce(_either, [(no, yes) for yes, no in parts])
            return holds, fails
        if isinstance(e, (sympy.Eq, sympy.Ne)):
            below, above = self.compared(e.lhs, e.rhs), self.compared(e.rhs, e.lhs)
            differs = _either((below[1], below[0]), (above[1], above[0]))
            return differs if isinstance(e, sympy.Ne) else (differs[1], differs[0])
        if isinstance(e, (sympy.Ge, sympy.Lt)):
            holds, fails = self.compared(e.lhs, e.rhs)
            return (holds, fails) if isinstance(e, sympy.Ge) else (fails, holds)
        if isinstance(e, (sympy.Le, sympy.Gt)):
            holds, fails = self.compared(e.rhs, e.lhs)
            return (holds, fails) if isinstance(e, sympy.Le) else (fails, holds)
        if isinstance(e, sympy.ITE):
            (holds, fails), one, other = map(self.condition, e.args)
            no, yes = _either((fails, holds), one[::-1]), _either((holds, fails), other[::-1])
            return _either(yes[::-1], no[::-1])
        raise ExpressionError(
            f"the condition {_shown(e)} is not allowed; use comparisons <, <=, >, >=, ==, != with And, Or and Not"
        )

    def compared(self, a: Any, b: Any) -> Condition:
        """The tree of the condition that a is at least b."""
        holds: Tree = ("call", AT_LEAST, self.tree(a), self.tree(b))
        return holds, ("-", ONE, holds)


def _either(one: Condition, other: Condition) -> Condition:
    """The condition that at least one of two conditions holds, in the form that the parser gives ``or``."""
    return ("call", "max", one[0], other[0]), ("*", one[1], other[1])


def _joined(kind: str, trees: Sequence[Tree]) -> Tree:
    """A chain of equal operations, split into halves if it is long."""
    if len(trees) > _CHAIN:
        middle = len(trees) // 2
        return (kind, _joined(kind, trees[:middle]), _joined(kind, trees[middle:]))
    return reduce(lambda a, b: (kind, a, b), trees)


def _fraction(number: Any) -> tuple[list[Tree], list[Tree]]:
    """The factors in the numerator and in the denominator of a positive number."""
    if not number.is_Rational or not _is_exact(number):
        return [_number(number)], []
    above = [] if number.p == 1 else [("number", canonical(number.p))]
    return above, [] if number.q == 1 else [("number", canonical(number.q))]


def _is_exact(number: Any) -> bool:
    """Whether numerator and denominator of a rational are integers that a double represents exactly."""
    return abs(int(number.p)) < 2**53 and int(number.q) < 2**53


def _number(e: Any) -> Tree:
    """The tree of a constant number."""
    import sympy

    if e is sympy.pi:
        return ("number", math.pi)
    if e is sympy.E:
        return ("call", "exp", ONE)
    if e.is_Rational and not e.is_Integer and _is_exact(e):
        return ("/", ("number", canonical(int(e.p))), ("number", canonical(int(e.q))))
    if e.is_finite is False or e in (sympy.nan, sympy.zoo):
        raise ExpressionError(f"{e} is not a finite number; only finite numbers are allowed")
    if e.is_extended_real is False:
        raise ExpressionError(f"the constant {e} is not real; constants of a model are real numbers")
    try:
        value = float(Fraction(int(e.p), int(e.q))) if e.is_Rational else float(e.evalf(40))
        return ("number", canonical(value))
    except OverflowError:
        raise ExpressionError(f"{_shown(e)} is too large; numbers up to 1.8e308 are allowed") from None


def _shown(e: Any) -> str:
    """The text of an expression for a message, shortened."""
    text = str(e)
    return text if len(text) <= 60 else text[:57] + "..."
