"""Expressions, and the energies that engines know."""

from __future__ import annotations

from ...model.outputs import Output
from ..pairs import Pair
from .seen import Seen


def value(output: Output, seen: Seen) -> Pair:
    assert output.expression is not None
    return seen.pairs.expression(output.expression)


def kinetic_energy(output: Output, seen: Seen) -> Pair:
    return seen.energies()[0]


def potential_energy(output: Output, seen: Seen) -> Pair:
    return seen.energies()[1]
