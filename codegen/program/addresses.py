"""Addresses: where a component of a store lies in memory, decided once for every target.

An address has three parts: a region of memory (or an argument), a row of this region, and a place in the row. The row belongs
to the unit whose memory is accessed. A generated function is called for several units; its argument ``i`` is the number of the
unit. In the function, numbers of rows are expressions in i. Numbers that are not a linear function of i are stored in a column
of a table (`IndexTable`). So kinds that differ only in the numbers of rows share a function.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Sequence
from typing import Protocol

from ..records import dataclass
from .store import Store


class Kind(Hashable, Protocol):
    """Units of equal structure, which share every block: `members` by number, `units` by place in the order."""

    index: int
    members: list[int]
    units: list[int]


@dataclass(frozen=True, slots=True)
class Row:
    """An integer for each unit for which a function is called, and the column of a table that may store it."""

    column: str
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Address:
    """Place of a component in memory.

    Attributes
    ----------
    variable : str
        Name of the variable that points to the row.
    region : str
        Region of memory, ``numbers``, ``constants``, or an argument or result.
    row : Row or None
        Number of the row; of an argument, its first entry. None if there is only one row.
    component : str or Row
        Name of the component. For arguments, results and ``numbers`` an integer, which may differ between units.
    form : int
        For constants: the set of components; see `layout.Layout.forms`.
    """

    variable: str
    region: str
    row: Row | None
    component: str | Row
    form: int = -1

    @property
    def form_of_code(self) -> tuple[object, ...]:
        """The properties that must be equal in the addresses of two kinds that share a function."""
        component = "" if isinstance(self.component, Row) else self.component
        return self.variable, self.region, self.row is None, component, self.form


@dataclass(frozen=True, slots=True)
class Placed:
    """An address whose rows are expressions in i."""

    variable: str
    region: str
    row: str
    component: str
    form: int = -1


class IndexTable:
    """A table of integers with a row for each link or unit.

    A column is added when a function needs it. Integers of a kind that are equal, or grow in equal steps, need no column.

    Parameters
    ----------
    name : str
        Name of the table.
    rows : int
    """

    def __init__(self, name: str, rows: int):
        self.name = name
        self.count = rows
        self.columns: dict[str, list[int]] = {}

    def entry(self, column: str, instances: list[int], values: list[int]) -> str:
        """Return an expression in i for values that belong to the instances i of a kind."""
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
        """All tables of the program, each once."""

    @abstractmethod
    def table(self, sweep: str) -> IndexTable:
        """Return the table of the units of a sweep."""

    @abstractmethod
    def of_units(self, sweep: str) -> bool:
        """Return whether i is a place in the order of units; otherwise it is the number of a member."""

    @abstractmethod
    def find(self, kind: Kind, sweep: str, store: Store, name: str) -> Address:
        """Return the address of a component in the functions of a kind, without the cache of `address`."""

    @abstractmethod
    def number(self, kind: Kind, sweep: str) -> Row:
        """Return the numbers of the links for which the functions of a kind are called."""

    @abstractmethod
    def stopped_at(self, kind: Kind, sweep: str, name: str) -> Row:
        """Return the number to report when a margin, given by name, is not positive."""

    def instances(self, kind: Kind, sweep: str) -> list[int]:
        """Return the values of i in the functions of a kind."""
        return kind.units if self.of_units(sweep) else kind.members

    def address(self, kind: Kind, sweep: str, store: Store, name: str) -> Address:
        """Return the address of a component in the functions of a kind."""
        key = kind, sweep, store, name
        if key not in self._addresses:
            self._addresses[key] = self.find(kind, sweep, store, name)
        return self._addresses[key]

    def placed(self, kinds: Sequence[Kind], sweep: str, store: Store, name: str) -> Placed:
        """Return the address of a component in a function that several kinds share."""
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
        """Return a function from the name of a margin to the expression of the number to report when it is not positive."""
        return lambda name: self.expression(kinds, sweep, [self.stopped_at(kind, sweep, name) for kind in kinds])

    def expression(self, kinds: Sequence[Kind], sweep: str, rows: Sequence[Row]) -> str:
        """Return an expression in i for integers that are given for each kind; results are cached."""
        key = (self.table(sweep).name, self.of_units(sweep), *kinds, *map(id, rows))
        if key not in self._expressions:  # the entry keeps the rows alive, so that their identities stay unique
            instances = [i for kind in kinds for i in self.instances(kind, sweep)]
            pairs = sorted(zip(instances, (v for row in rows for v in row.values), strict=True))
            entry = self.table(sweep).entry(rows[0].column, [i for i, _ in pairs], [v for _, v in pairs])
            self._expressions[key] = rows, entry
        return self._expressions[key][1]
