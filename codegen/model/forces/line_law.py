"""A force law along the line between two points: a type name, coefficients and formulas.

Each law is data in one file of `line_laws`. Everything else is derived from these data: the entry in a model file, the
element (`along_line`), generated code, the engines' forces, the table in docs/model_format.md, and random tests.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from ..binding import bind
from ..entries import RESERVED
from ..errors import nearest
from ..expressions import Expression
from ..grammar import ExpressionError, Number
from ..parsing import parse

MEASURES: Final = {"distance": "m", "rate": "m/s"}
"""Names that formulas may contain besides coefficients, with their units: the distance of the points, and its time
derivative."""

MOST: Final = 8
"""Largest exponent of a polynomial of the distance that `in_squares` expands."""

_TAKEN: Final = RESERVED | MEASURES.keys() | {"type", "from", "to", "first", "last", "repeat", "name"}
_WORD: Final = re.compile("[a-z][a-z0-9_]*")


class LineLawError(ValueError):
    """Raised if the declaration of a law is inconsistent."""


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A coefficient of a law: a key of its entry in a model file, and a name in its formulas.

    Attributes
    ----------
    unit, meaning : str
        Unit and meaning, for the documentation.
    default : int or float, optional
        Value where an entry leaves it out. None: an entry has to give it.
    between : tuple of two float
        Range of ordinary values, from which checks and tests draw.

    Examples
    --------
    >>> Coefficient("N/m^3", "the pull at a distance of one metre").default is None
    True
    """

    unit: str
    meaning: str
    default: Number | None = None
    between: tuple[float, float] = (0.5, 2.0)


@dataclass(frozen=True, slots=True, eq=False)
class LineLaw:
    """A force law along the line between two points.

    Attributes
    ----------
    type : str
        Its type in a model file, and the name of its file.
    meaning : str
        Its meaning, in one or two sentences.
    coefficients : dict of str to Coefficient
        Its coefficients. If the law has an energy, their values are expressions of parameters, inputs and t; otherwise
        they may also depend on coordinates and speeds.
    force : str
        Force, N, as an expression of `MEASURES` and the coefficients. A positive force drives the points apart, so its
        power is force times rate.
    energy : str
        Potential energy, J, as an expression of the distance and the coefficients. At rate 0 the force is minus the
        derivative of the energy with respect to the distance. Empty: the law has no energy.
    misspelt : dict of str to str
        The correct key for each of some wrong keys.
    other_words : tuple of str
        Other names of the type.
    formula, potential : Expression
        `force` and `energy`, parsed; `potential` is None without an energy.

    Raises
    ------
    LineLawError
        If the declaration contradicts itself. The tests of all laws check with sympy that the force is minus the
        derivative of the energy.

    Examples
    --------
    >>> law = LineLaw("cube", "Pull = strength distance^3.", {"strength": Coefficient("N/m^3", "the pull at 1 m")},
    ...               force="-strength*distance**3", energy="strength*distance**4/4")
    >>> law.formula
    Expression('-strength*distance**3')
    """

    type: str
    meaning: str
    coefficients: Mapping[str, Coefficient]
    force: str
    energy: str = ""
    misspelt: Mapping[str, str] = field(default_factory=dict)
    other_words: tuple[str, ...] = ()
    formula: Expression = field(init=False)
    potential: Expression | None = field(init=False)

    def __post_init__(self) -> None:
        if not _WORD.fullmatch(self.type):
            raise LineLawError(f"type {self.type!r} is not a valid type; lower-case letters, digits and _ are allowed")
        for key, coefficient in self.coefficients.items():
            self._check_coefficient(key, coefficient)
        for word, key in self.misspelt.items():
            if key not in self.coefficients:
                said = f"{self.type}: misspelt takes {word!r} for {key!r}, which is not a coefficient"
                raise LineLawError(f"{said}; there are {', '.join(self.coefficients)}")
        object.__setattr__(self, "formula", self._parsed("force", self.force, MEASURES))
        potential = self._parsed("energy", self.energy, ["distance"]) if self.energy else None
        object.__setattr__(self, "potential", potential)
        unused = [key for key in self.coefficients if key not in self.formula.names]
        if unused:
            raise LineLawError(
                f"{self.type}: {unused[0]} is not in the force {self.force!r}; use it there, or leave it out"
            )

    def _check_coefficient(self, key: str, coefficient: Coefficient) -> None:
        if not _WORD.fullmatch(key) or key in _TAKEN:
            taken = f"is a reserved name; reserved names are {', '.join(sorted(_TAKEN))}"
            why = (
                taken if key in _TAKEN else "does not consist of lower-case letters, digits and _; choose another name"
            )
            raise LineLawError(f"{self.type}: coefficient {key!r} {why}")
        if not isinstance(coefficient, Coefficient):
            raise LineLawError(
                f"{self.type}: coefficient {key!r} is {coefficient!r}; Coefficient(unit, meaning) is needed"
            )
        low, high = coefficient.between
        if not low < high:
            raise LineLawError(f"{self.type}: {key} is between {low} and {high}; the lower one is needed first")

    def _parsed(self, what: str, text: str, measures: Iterable[str]) -> Expression:
        try:
            found = bind(parse(text), {})
        except ExpressionError as error:
            raise LineLawError(f"{self.type}: {what} {text!r}: {error}") from None
        known = [*measures, *self.coefficients]
        for name in sorted(found.names):
            if name not in known:
                said = f"{self.type}: {what} {text!r} contains {name}"
                raise LineLawError(f"{said}; names here: {', '.join(known)}{nearest(name, known)}")
        return found


def in_squares(formula: Expression, less: int) -> Expression | None:
    """A formula divided by a power of the distance, as a polynomial of ``square``, the squared distance.

    Such a quotient is smooth where the points coincide, though the distance has a kink and no direction there.

    Returns
    -------
    Expression or None
        None if the quotient is no such polynomial.

    Examples
    --------
    >>> in_squares(parse("k*distance + h*distance**3"), 1)
    Expression('k + h*square')
    """
    powers = _powers(formula)
    if powers is None or any(n < less or (n - less) % 2 for n in powers):
        return None
    square = Expression(("name", "square"))
    total = Expression.number(0)
    for n, factor in sorted(powers.items()):
        half = (n - less) // 2
        total = total + (factor * square**half if half else factor)
    return total


def _powers(formula: Expression) -> dict[int, Expression] | None:
    """The factors of the powers of the distance in a formula, by exponent; None if it is no polynomial of the distance."""
    if not MEASURES.keys() & formula.names:
        return {0: formula}
    kind, *operands = formula.tree
    if kind == "name":
        return {1: Expression.number(1)} if formula.tree[1] == "distance" else None
    if kind == "call":
        return None
    parts = [_powers(Expression(tree)) for tree in operands]
    a, b = parts[0], parts[-1]
    if a is None or b is None:
        return None
    if kind in ("neg", "+", "-"):
        found = {n: -e if kind == "neg" else e for n, e in a.items()}
        for n, e in b.items() if kind != "neg" else ():
            before = found.get(n, Expression.number(0))
            found[n] = before + e if kind == "+" else before - e
        return found
    if kind == "/" and b.keys() == {0}:
        return {n: e / b[0] for n, e in a.items()}
    if kind == "*":
        return _product(a, b)
    exponent = b[0].value if kind == "**" and b.keys() == {0} and b[0].is_number else None
    if not isinstance(exponent, int) or not 0 < exponent <= MOST:
        return None
    found = a
    for _ in range(exponent - 1):
        found = _product(found, a)
    return found


def _product(a: dict[int, Expression], b: dict[int, Expression]) -> dict[int, Expression]:
    found: dict[int, Expression] = {}
    for n, x in a.items():
        for m, y in b.items():
            found[n + m] = found[n + m] + x * y if n + m in found else x * y
    return found
