"""What several hand to one: the first to come, in the order of a sweep, writes a field, the others add to it."""

from __future__ import annotations

from typing import TypeVar

from ..program.block import Scope
from ..program.field import AnyField, Field
from ..program.scalar import Vector
from ..program.store import Store
from .spatial import is_zero

V = TypeVar("V")


def accumulate(
    x: Scope, store: Store, field: Field[V], value: V, first: bool, tag: str, lanes: bool = False, name: str = "acc"
) -> None:
    """Add to a field of somebody else, component by component; who is `first` writes it."""
    for part, v in zip(field.scalars(), (v for _, v in field.parts(value)), strict=True):
        if first:
            x.store(store, part, v)
        elif not is_zero(v):
            x.store(store, part, x.let(name, x.load(store, part) + v, tag, lanes=lanes))


def accumulate_force(
    x: Scope, store: Store, field: Field[Vector], value: Vector, first: bool, tag: str, lanes: bool = False
) -> None:
    """The same of a moment and a force, their components taken by turns."""
    parts = field.scalars()
    for i in (0, 3, 1, 4, 2, 5):
        accumulate(x, store, parts[i], value[i], first, tag, lanes)


def add_to_sum(x: Scope, store: Store, field: Field[V], value: V, name: str, tag: str, lanes: bool = False) -> None:
    """Add to what several sum up, component by component."""
    for part, (_, v) in zip(field.scalars(), field.parts(value), strict=True):
        x.store(store.sum, part, x.let(name, v, tag, lanes=lanes))


def clear(x: Scope, store: Store, field: AnyField) -> None:
    """Nothing is summed up yet."""
    for part in field.scalars():
        x.store(store, part, 0)
