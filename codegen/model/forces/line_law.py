"""What a force law along the line between two points is: a word, coefficients, formulas.

A law is data. Each stands in a file of `line_laws`; all else is made of it: the entry that a model file may have, the element
(`along_line`), what is generated, what the engines compute, the table in docs/model_format.md, what random tests draw.
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
"""What a formula may contain beside the coefficients, and its unit: the distance of the points, and its derivative by time."""

_TAKEN: Final = RESERVED | MEASURES.keys() | {"type", "from", "to", "first", "last", "repeat", "name"}
_WORD: Final = re.compile("[a-z][a-z0-9_]*")


class LineLawError(ValueError):
    """A law that cannot be: whoever wrote it has to change it."""


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A number of a law: a key of its entry in a model file, a name in its formulas.

    Attributes
    ----------
    unit, meaning : str
        For people.
    default : int or float, optional
        What it is where an entry leaves it out; None where it has to be given.
    between : (float, float)
        Ordinary values: checks and tests draw from these.
    """

    unit: str
    meaning: str
    default: Number | None = None
    between: tuple[float, float] = (0.5, 2.0)


@dataclass(frozen=True, slots=True, eq=False)
class LineLaw:
    """A force along the line between two points.

    Attributes
    ----------
    type : str
        What a model file calls it, and people too; the name of its file.
    meaning : str
        What it is, in a sentence or two.
    coefficients : dict of str to Coefficient
        Where the law has an energy they are expressions of parameters, inputs and t, else of everything that moves too.
    force : str
        In the grammar of model files, of `MEASURES` and the coefficients, N. Positive drives the points apart, so that its
        power is force times rate.
    energy : str
        Likewise, of the distance and the coefficients, J: without rate, the force is minus its derivative by the distance.
        Empty where there is none.
    misspelt : dict of str to str
        Keys, by others that are taken for them.
    other_words : tuple of str
        What some call its type.
    formula, potential : Expression
        `force` and `energy`, parsed; the latter None where there is none.

    Raises
    ------
    LineLawError
        If the declaration contradicts itself. That the force is minus the derivative of the energy is checked by the tests
        of all laws, with sympy.
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
                said = f"{self.type}: misspelt takes {word!r} for {key!r}, which is no coefficient"
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
            taken = f"has a meaning of its own; taken are {', '.join(sorted(_TAKEN))}"
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
