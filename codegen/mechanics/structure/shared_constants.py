"""Constants of owners of one form: numbers that are equal for all owners are literals, and all others are data."""

from __future__ import annotations

from dataclasses import field
from typing import ClassVar

from ...program import algebra
from ...program.algebra import Expr
from ...program.digits import number
from ...program.shape import Constants, Shape
from ...program.store import Store
from ...records import dataclass


@dataclass(slots=True, eq=False)
class SharedConstants:
    """Constants of owners with the same shape.

    Attributes
    ----------
    shape : Shape
    literal : dict of str to Expr
        Constants that are the same number for all owners.
    data : dict of str to int
        Constants that differ among owners: index among an owner's numbers.
    """

    store: ClassVar[Store]
    """The store of the constants of this kind of units."""

    shape: Shape
    literal: dict[str, Expr] = field(default_factory=dict, kw_only=True)
    data: dict[str, int] = field(default_factory=dict, kw_only=True)

    @property
    def parameters(self) -> int:
        """The number of design parameters on which the constants depend."""
        return self.shape.parameters

    def number(self, name: str) -> Expr | None:
        """Value of a constant that is the same for all owners; None if it is read from the owner's data."""
        if name in self.shape.varying:
            return None
        if name in self.shape.fixed:
            return self.shape.fixed[name]
        if "/" in name:
            return algebra.ZERO
        return self.literal.get(name)

    def number_of(self, store: Store, name: str) -> Expr | None:
        """`number` of the field if it is one of the constants; otherwise None."""
        return self.number(name) if store is self.store else None

    def alias_of(self, store: Store, name: str) -> str:
        """Name of the first constant with the value of this one."""
        return self.shape.varying.get(name, name) if store is self.store else name

    def fold(self, owned: list[Constants]) -> None:
        """Separates the numbers that are equal for all owners from those that are data of each owner."""
        distinct = list({id(c): c for c in owned}.values())
        for name in self.shape.fields:
            if name in self.shape.varying:
                continue
            values = {c.values.get(name, 0.0) for c in distinct}
            if len(values) == 1:
                self.literal[name] = number(values.pop())
            else:
                self.data[name] = len(self.data)


def pattern(c: Constants) -> tuple[str, ...]:
    """Names of the nonzero constants."""
    return tuple(sorted(n for n, v in c.values.items() if v != 0))
