"""Contributions of several links to one field: the first one is assigned, and the others are added."""

from __future__ import annotations

from typing import TypeVar

from ..program.block import Scope
from ..program.field import AnyField, Field
from ..program.scalar import Vector
from ..program.store import Store
from .spatial import is_zero

V = TypeVar("V")


def accumulate(x: Scope, store: Store, field: Field[V], value: V, first: bool, tag: str, lanes: bool = False) -> None:
    """Adds `value` to a field of another object, component by component; the `first` contribution is assigned."""
    for part, v in zip(field.scalars(), (v for _, v in field.parts(value)), strict=True):
        if first:
            x.store(store, part, v)
        elif not is_zero(v):
            x.store(store, part, x.let("acc", x.load(store, part) + v, tag, lanes=lanes))


def accumulate_force(
    x: Scope, store: Store, field: Field[Vector], value: Vector, first: bool, tag: str, lanes: bool = False
) -> None:
    """Adds a moment and a force to a field of another object; the statements for moment and force alternate."""
    parts = field.scalars()
    for i in (0, 3, 1, 4, 2, 5):
        accumulate(x, store, parts[i], value[i], first, tag, lanes)


def add_to_sum(x: Scope, store: Store, field: Field[V], value: V, name: str, tag: str) -> None:
    """Add `value` to a sum over links, component by component."""
    for part, (_, v) in zip(field.scalars(), field.parts(value), strict=True):
        x.store(store.sum, part, x.let(name, v, tag))


def clear(x: Scope, store: Store, field: AnyField) -> None:
    """Set a field to zero before contributions are added."""
    for part in field.scalars():
        x.store(store, part, 0)
