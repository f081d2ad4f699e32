"""The contract of a target: what its language calls scalars and functions, what its vectors hold, which words it reserves.

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
    """Spelling of the elementary functions by their names in statements; see `codegen.elementary`."""
    names = {e.spelled("symbol"): e.spelled(where) for e in TABLE.values()}
    return {symbol: f"{prefix}{name}" for symbol, name in names.items() if symbol and name}


class TargetError(ValueError):
    """A target cannot write what a model needs: it lacks a function, or its scalar type cannot hold a number."""


class UnwritableError(TargetError):
    """The same for a model: `place` is the entry of its file, where that is known."""

    def __init__(self, target: str, what: str, error: TargetError):
        super().__init__(f"{what}: {error} (target {target})")
        self.place = what.partition(" ")[0].rstrip(",")


@dataclass(frozen=True, slots=True)
class Scalar:
    """A scalar type.

    Attributes
    ----------
    name : str
        What users call it, and NumPy's dtype of its arrays.
    word, words : str
        What it is called in the language, and in comments, in the plural.
    bytes : int
    limits : Limits
    largest : float
    suffix : str
        Ends literals.
    integer : str
        Integers of the same size, for masks of vectors; empty where vectors hold no such scalars.
    agreement : float
        Relative difference from the generic engine up to which the self-check of `generate` calls a solver right.
    moves : bool
        Whether motions are integrated in it.

    Examples
    --------
    >>> from codegen.emit.c import FLOAT32
    >>> FLOAT32.literal("0.5")
    '0.5f'
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
        """How many fill a cache line."""
        return 64 // self.bytes

    def literal(self, text: str) -> str:
        """A number as the language writes it.

        Raises
        ------
        TargetError
            The type cannot hold it.
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
    """Vectors of a machine: the macro that says that there are such, none for those that are always there, and their bytes."""

    macro: str
    bytes: int


@dataclass(frozen=True, slots=True)
class Target:
    """A language that solvers are written in.

    Attributes
    ----------
    name : str
        What users call it.
    scalars : tuple of Scalar
        The first is the usual one.
    functions : mapping of str to str
        Spelling of elementary functions, by their names in `program.functions`.
    reserved : frozenset of str
        Words that variables cannot be called.
    vectors : tuple of InstructionSet
        Widest first; none where the language has no vectors.
    """

    name: str
    scalars: tuple[Scalar, ...]
    functions: Mapping[str, str]
    reserved: frozenset[str]
    vectors: tuple[InstructionSet, ...] = field(default=())

    def scalar(self, name: str) -> Scalar:
        """The scalar type of a name.

        Raises
        ------
        TargetError
            The target has none of that name.
        """
        found = next((s for s in self.scalars if s.name == name), None)
        if found is None:
            known = ", ".join(s.name for s in self.scalars)
            raise TargetError(f"the target {self.name} has no scalar type {name!r}; it has {known}")
        return found

    def function(self, name: str) -> str:
        """How an elementary function is spelled.

        Raises
        ------
        TargetError
            The target lacks it.
        """
        if name not in self.functions:
            raise TargetError(f"the target {self.name} lacks the function {name}; it has {', '.join(self.functions)}")
        return self.functions[name]


__all__ = ["InstructionSet", "Scalar", "Target", "TargetError", "UnwritableError", "spelled"]
