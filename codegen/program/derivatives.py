"""Derivative primitives of statements, and the tangent statements made of them.

The derivative primitives of a statement are the partial derivatives of its right side with respect to its own operands.
They are small, computed once, and shared by all directions. A tangent statement is the sum ``d symbol = sum_i
primitive_i * d operand_i``, without zero terms.

Some operands are functions of other operands and carry no tangent of their own: the sine and cosine of an angle, the
entries of a rotation matrix, the constants of a body. These operands are *transparent*: a statement is differentiated with
respect to the quantities on which they depend, here the angle q. So ``d(c x + s y)`` is ``c dx + s dy + (c y - s x) dq``. This
has one product with dq where the plain chain rule needs two, and the factor in brackets often has a name already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from . import algebra
from .algebra import Expr, Function, Symbol
from .block import Expansion, Statement
from .functions import Along, Choice, Vanishing
from .scalar import Value


def partials(expression: Expr) -> dict[Symbol, Expr]:
    """Partial derivatives of a statement's right side with respect to each of its symbols."""
    result: dict[Symbol, Expr] = {}
    terms = expression.args if expression.is_Add else (expression,)
    for term in terms:
        if isinstance(term, Symbol):
            _add(result, term, algebra.ONE)
            continue
        factors = term.args if term.is_Mul else (term,)
        for i, factor in enumerate(factors):
            if factor.is_Number:
                continue
            rest = factors[:i] + factors[i + 1 :]
            if isinstance(factor, Symbol):
                _add(result, factor, algebra.multiply(*rest))
            else:
                for s in sorted(factor.free_symbols, key=str):
                    _add(result, s, algebra.multiply(*rest, algebra.derivative(factor, s)))
    return result


def _add(into: dict[Symbol, Expr], key: Symbol, value: Expr) -> None:
    into[key] = into[key] + value if key in into else value


Primitives = Mapping[Value, Mapping[Value, Value]]
"""Derivatives of values (outer keys) with respect to values (inner keys)."""


def of_symbols(primitives: Primitives) -> dict[Symbol, dict[Symbol, Expr]]:
    """Derivatives of symbols with respect to symbols, see `Tangents`."""
    return {
        s: {root: algebra.expression(d) for root, d in inner.items() if isinstance(root, Symbol)}
        for s, inner in primitives.items()
        if isinstance(s, Symbol)
    }


class Tangents:
    """Writes tangent statements into an expansion.

    Parameters
    ----------
    expansion : Expansion
        Receives the tangent statements, and the primitives as scalar statements.
    seeds : mapping of Symbol to Expr
        The tangent of each symbol that has one. Tangents have one value per direction.
    transparent : dict of Symbol to dict of Symbol to Expr
        For each transparent symbol, its derivatives with respect to the symbols on which it depends. Those symbols need no
        statement, only an entry in `seeds`.
    lanes : bool
        Whether tangents have one value per direction.
    known : dict of Symbol to list of (Expr, Expr)
        For targets with known derivatives: pairs of an operand and the derivative with respect to it, which may be infinite.
    """

    def __init__(
        self,
        expansion: Expansion,
        seeds: Mapping[Symbol, Value],
        transparent: dict[Symbol, dict[Symbol, Expr]],
        lanes: bool = True,
        known: Mapping[Symbol, Sequence[tuple[Expr, Expr]]] = MappingProxyType({}),
    ):
        self.known = known
        self.expansion = expansion
        self.of = {s: algebra.expression(v) for s, v in seeds.items()}
        self.transparent = transparent
        self.lanes = lanes

    def expression(self, value: Expr) -> Expr:
        """Tangent of an expression: a sum of primitives times tangents of its operands."""
        primitives: dict[Symbol, Expr] = {}
        for s, d in partials(value).items():
            inner = self.transparent.get(s)
            if inner is not None:
                for root, d_inner in inner.items():
                    if root in self.of:
                        _add(primitives, root, d * d_inner)
            elif s in self.of:
                _add(primitives, s, d)
        terms = []
        for s, d in primitives.items():
            factor = self.expansion.let("d", d, "primitive")
            terms.append(factor * self.of[s])
        return algebra.add(*terms)

    def statement(self, statement: Statement) -> None:
        """Write the tangent of one statement, unless it is zero."""
        known, e = self.known.get(statement.target), statement.expression
        if known is not None:
            value = self._by(known)
        elif isinstance(e, Function) and not self.lanes and e.name == "Choice":
            value = Choice(e.args[0], *(self.value(a) for a in e.args[1:]))
        elif isinstance(e, Function) and not self.lanes and e.name == "Vanishing":
            a, b = e.args
            value = Vanishing(self.value(a), b) + Vanishing(a, self.value(b))
        else:
            value = self.expression(e)
        if value is not algebra.ZERO:
            tag = f"d {statement.tag}" if statement.tag else ""
            self.of[statement.target] = self.expansion.let(f"d_{statement.target.name}", value, tag, lanes=self.lanes)

    def _by(self, operands: Sequence[tuple[Expr, Expr]]) -> Expr:
        """Tangent of a value from its known derivatives with respect to operands."""
        terms = []
        for operand, slope in operands:
            along = self.value(operand)
            sign, symbol = (algebra.ONE, along) if along.is_Symbol else algebra.coefficient(along)
            terms.append(
                Along(symbol, self.expansion.let("d", sign * slope, "primitive"))
                if along is not algebra.ZERO
                else algebra.ZERO
            )
        return algebra.add(*terms)

    def value(self, expression: Value, name: str = "d") -> Expr:
        """Tangent of an expression of named values, as a symbol or number."""
        return self.expansion.let(name, self.expression(algebra.expression(expression)), "", lanes=self.lanes)
