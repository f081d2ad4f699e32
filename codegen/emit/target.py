"""The interface of a target: names of scalars and functions, vector sizes, reserved words.

A target is a folder beside this file with a `Target` in its ``__init__.py``; `registry.TARGETS` lists them. Everything that
depends on the scalar type, such as literals, margins for rounding and the dtype of arrays in Python, follows from its `Scalar`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field

from ..elementary import TABLE
from ..program.limits import Limits
from ..records import dataclass


def spelled(where: str, prefix: str = "") -> dict[str, str]:
    """Maps the names of elementary functions in statements to their text in the target; see `codegen.elementary`."""
    names = {e.spelled("symbol"): e.spelled(where) for e in TABLE.values()}
    return {symbol: f"{prefix}{name}" for symbol, name in names.items() if symbol and name}


class TargetError(ValueError):
    """Raised if a target cannot write a model: it lacks a function, or its scalar type cannot hold a number."""


class UnwritableError(TargetError):
    """An error of a target that cannot write a model; `place` is the entry of the model file, if known."""

    def __init__(self, target: str, what: str, error: TargetError):
        super().__init__(f"{what}: {error} (target {target})")
        self.place = what.partition(" ")[0].rstrip(",")


@dataclass(frozen=True, slots=True)
class Scalar:
    """A scalar type of a target.

    Attributes
    ----------
    name : str
        Name for users, and NumPy's dtype of its arrays.
    word, words : str
        Name in the language; plural name in comments.
    bytes : int
        Size of a number.
    limits : Limits
        Rounding error and smallest normal number.
    largest : float
        Largest number.
    suffix : str
        Suffix of literals, such as ``f``.
    integer : str
        Integer type of the same size, for masks of vectors; empty if vectors hold no such scalars.
    agreement : float
        Largest relative difference from the generic engine that the self-check of `generate` accepts.
    moves : bool
        Whether motions are integrated in this type.

    Examples
    --------
    >>> from codegen.emit.c import FLOAT32
    >>> FLOAT32.per_line
    16
    """

    name: str
    word: str
    words: str
    bytes: int
    limits: Limits
    largest: float
    suffix: str = ""
    integer: str = ""
    agreement: float = 1e-9
    moves: bool = True

    @property
    def per_line(self) -> int:
        """Number of scalars in a cache line."""
        return 64 // self.bytes

    def literal(self, text: str) -> str:
        """Return a number as the language writes it.

        Parameters
        ----------
        text : str
            The number in decimal digits.

        Returns
        -------
        str
            The literal.

        Raises
        ------
        TargetError
            If the type cannot hold the number.

        Examples
        --------
        >>> from codegen.emit.c import FLOAT32
        >>> FLOAT32.literal("0.5")
        '0.5f'
        """
        size = abs(float(text))
        if size and not self.limits.smallest <= size <= self.largest and math.isfinite(size):
            raise TargetError(
                f"the number {text} is beyond {self.name}, which holds {self.limits.smallest:.3g} to {self.largest:.3g}; "
                f"use other units, or --scalar float64"
            )
        return f"{text}{self.suffix}"


@dataclass(frozen=True, slots=True)
class InstructionSet:
    """Vectors of a processor.

    Attributes
    ----------
    macro : str
        Macro of the preprocessor that is defined where there are such vectors; empty if they always exist.
    bytes : int
        Size of a vector.
    """

    macro: str
    bytes: int


@dataclass(frozen=True, slots=True)
class Target:
    """A language in which solvers are written.

    Attributes
    ----------
    name : str
        Name for users.
    scalars : tuple of Scalar
        Scalar types, the usual one first.
    functions : mapping of str to str
        Spelling of elementary functions, by their names in `program.functions`.
    reserved : frozenset of str
        Words that are not allowed as names of variables.
    vectors : tuple of InstructionSet
        Vectors, the widest first; empty if the language has none.
    """

    name: str
    scalars: tuple[Scalar, ...]
    functions: Mapping[str, str]
    reserved: frozenset[str]
    vectors: tuple[InstructionSet, ...] = field(default=())

    def scalar(self, name: str) -> Scalar:
        """Return the scalar type of a name.

        Parameters
        ----------
        name : str
            Such as ``"float32"``.

        Returns
        -------
        Scalar
            The scalar type.

        Raises
        ------
        TargetError
            If the target has no type of that name.

        Examples
        --------
        >>> from codegen.emit.c import C
        >>> C.scalar("float32").bytes
        4
        """
        found = next((s for s in self.scalars if s.name == name), None)
        if found is None:
            known = ", ".join(s.name for s in self.scalars)
            raise TargetError(f"the target {self.name} has no scalar type {name!r}; it has {known}")
        return found

    def function(self, name: str) -> str:
        """Return the spelling of an elementary function.

        Parameters
        ----------
        name : str
            Name of the function in `program.functions`.

        Returns
        -------
        str
            Its name in the language.

        Raises
        ------
        TargetError
            If the target lacks the function.

        Examples
        --------
        >>> from codegen.emit.c import C
        >>> C.function("tan")
        'tan'
        """
        if name not in self.functions:
            raise TargetError(f"the target {self.name} lacks the function {name}; it has {', '.join(self.functions)}")
        return self.functions[name]


__all__ = ["InstructionSet", "Scalar", "Target", "TargetError", "UnwritableError", "spelled"]
