"""Addresses: where a component of a store lies, decided once for every target.

An address is the name of a region of memory (or of an argument), the row in it that belongs to the unit whose memory is accessed,
and the place in the row. Rows are known for each unit that a function is called for, whose number is ``i`` there; they become an
expression in i where the function is written, and integers that are not a function of i stand in tables (`IndexTable`), which
grow by what is asked for. So kinds that differ by nothing but rows can share a function.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Sequence
from typing import Protocol

from ..records import dataclass
from .store import Store


class Kind(Hashable, Protocol):
    """Units of equal structure, which share every block: `members` by their numbers, `units` by their places in the order."""

    index: int
    members: list[int]
    units: list[int]


@dataclass(frozen=True, slots=True)
class Row:
    """An integer for each of the units that a function is called for, and the column of a table that may hold it."""

    column: str
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Address:
    """Where a component lies.

    Attributes
    ----------
    variable : str
        A name for the row.
    region : str
        Region of memory, ``numbers``, ``constants`` or an argument or result.
    row : Row or None
        Number of the row, or, of arguments, where it begins; none where there is one row.
    component : str or Row
        Name of the component; of arguments, ``numbers`` and results an integer, which may differ.
    form : int
        Of constants: which components there are; see `layout.Layout.forms`.
    """

    variable: str
    region: str
    row: Row | None
    component: str | Row
    form: int = -1

    @property
    def form_of_code(self) -> tuple[object, ...]:
        """What functions that are to be one must agree in."""
        component = "" if isinstance(self.component, Row) else self.component
        return self.variable, self.region, self.row is None, component, self.form


@dataclass(frozen=True, slots=True)
class Placed:
    """An address with expressions in i in the place of rows."""

    variable: str
    region: str
    row: str
    component: str
    form: int = -1


class IndexTable:
    """A table of integers with a row for each link or unit: a column is added when something uses it, and none where the
    integers of a kind are the same, or go up in equal steps.

    Parameters
    ----------
    name : str
        The table's.
    rows : int
    """

    def __init__(self, name: str, rows: int):
        self.name = name
        self.count = rows
        self.columns: dict[str, list[int]] = {}

    def entry(self, column: str, instances: list[int], values: list[int]) -> str:
        """Expression, in i, of the values that belong to the instances i of a kind."""
        if len(set(values)) == 1:
            return str(values[0])
        step, rest = divmod(values[1] - values[0], instances[1] - instances[0])
        offset = values[0] - step * instances[0]
        if not rest and step > 0 and all(v == step * i + offset for i, v in zip(instances, values, strict=True)):
            term = "i" if step == 1 else f"{step}*i"
            return f"{term} {'+' if offset > 0 else '-'} {abs(offset)}" if offset else term
        known = self.columns.setdefault(column, [0] * self.count)
        for i, v in zip(instances, values, strict=True):
            known[i] = v
        return f"{self.name}[i][{self.name.upper()}_{column}]"

    def rows(self) -> list[str]:
        return [", ".join(str(c[i]) for c in self.columns.values()) for i in range(self.count)]


class Addresses(ABC):
    """Addresses of a program, and the tables that they need."""

    def __init__(self) -> None:
        self._addresses: dict[tuple[Kind, str, Store, str], Address] = {}
        self._expressions: dict[tuple[object, ...], tuple[Sequence[Row], str]] = {}

    @property
    @abstractmethod
    def tables(self) -> list[IndexTable]:
        """All tables, once each."""

    @abstractmethod
    def table(self, sweep: str) -> IndexTable:
        """The table of what a sweep goes over."""

    @abstractmethod
    def of_units(self, sweep: str) -> bool:
        """Whether i is a place in the order of units, not a number of a member."""

    @abstractmethod
    def find(self, kind: Kind, sweep: str, store: Store, name: str) -> Address:
        """Where a component of a store lies, in the functions of a kind; see `address`."""

    @abstractmethod
    def number(self, kind: Kind, sweep: str) -> Row:
        """Numbers of the links that a kind's functions are called for."""

    @abstractmethod
    def stopped_at(self, kind: Kind, sweep: str, name: str) -> Row:
        """Number to report when a margin is not positive, by the margin's name."""

    def instances(self, kind: Kind, sweep: str) -> list[int]:
        """The values that i takes in the functions of a kind."""
        return kind.units if self.of_units(sweep) else kind.members

    def address(self, kind: Kind, sweep: str, store: Store, name: str) -> Address:
        """Where a component of a store lies, in the functions of a kind."""
        key = kind, sweep, store, name
        if key not in self._addresses:
            self._addresses[key] = self.find(kind, sweep, store, name)
        return self._addresses[key]

    def placed(self, kinds: Sequence[Kind], sweep: str, store: Store, name: str) -> Placed:
        """Where a component of a store lies, in the function that kinds share."""
        found = [self.address(kind, sweep, store, name) for kind in kinds]
        first = found[0]
        rows = [a.row for a in found if a.row is not None]
        components = [a.component for a in found if isinstance(a.component, Row)]
        return Placed(
            first.variable,
            first.region,
            self.expression(kinds, sweep, rows) if rows else "",
            first.component if isinstance(first.component, str) else self.expression(kinds, sweep, components),
            first.form,
        )

    def culprit(self, kinds: Sequence[Kind], sweep: str) -> Callable[[str], str]:
        """Expression of the number to report when a margin is not positive."""
        return lambda name: self.expression(kinds, sweep, [self.stopped_at(kind, sweep, name) for kind in kinds])

    def expression(self, kinds: Sequence[Kind], sweep: str, rows: Sequence[Row]) -> str:
        """Expression of integers that belong to the instances of kinds, from those of each; each is looked for once."""
        key = (self.table(sweep).name, self.of_units(sweep), *kinds, *map(id, rows))
        if key not in self._expressions:  # which keeps the rows, so that no others get their identities
            instances = [i for kind in kinds for i in self.instances(kind, sweep)]
            pairs = sorted(zip(instances, (v for row in rows for v in row.values), strict=True))
            entry = self.table(sweep).entry(rows[0].column, [i for i, _ in pairs], [v for _, v in pairs])
            self._expressions[key] = rows, entry
        return self._expressions[key][1]
