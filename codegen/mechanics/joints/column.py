"""Partial velocities of degrees of freedom: columns of six components, of which one is 1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

from ...program.block import Scope
from ...program.scalar import Value, Vector
from ...records import dataclass
from ..spatial import SIX
from ..stores import DP


@dataclass(frozen=True)
class Column:
    """Motion of a link per unit speed of one degree of freedom: angular and linear components, constant along the link's axes.

    Attributes
    ----------
    lead : int
        The component that is 1: 0-2 angular, 3-5 linear. Elimination uses this component.
    others : dict of int to value
        The other non-zero components.
    by : tuple of dict of int to value
        Derivatives of those components with respect to each design parameter (derivative primitives).
    """

    lead: int
    others: Mapping[int, Value] = field(default_factory=dict)
    by: tuple[Mapping[int, Value], ...] = ()

    def __getitem__(self, i: int) -> Value:
        return 1 if i == self.lead else self.others.get(i, 0)

    @property
    def angular(self) -> Vector:
        return [self[i] for i in SIX[:3]]

    @property
    def linear(self) -> Vector:
        return [self[i] for i in SIX[3:]]

    def along(self, v: Vector) -> Value:
        """Component of v along the column: ``s . v``."""
        total = v[self.lead]
        for i, s in self.others.items():
            total = total + s * v[i]
        return total

    def squares_along(self, scales: Sequence[Value]) -> Value:
        """``s . D s`` with a diagonal matrix D; `scales` are its entry for angular and its entry for linear components."""
        total = scales[self.lead // 3]
        for i, s in self.others.items():
            total = total + s * s * scales[i // 3]
        return total

    def completed(self, v: Vector, along: Value = 0) -> Value:
        """The leading component of v that makes ``s . v`` equal to `along`, given the other components of v."""
        for i, s in self.others.items():
            along = along - s * v[i]
        return along

    def remaining(self, x: Scope, i: int, v: Vector, lanes: bool) -> Value:
        """Component i of ``v - s v_lead``; it gets a name in the code unless it equals component i of v."""
        if i not in self.others:
            return v[i]
        return x.let("rest", v[i] - self.others[i] * v[self.lead], "Eq. 53", lanes=lanes)

    def change(self, x: Scope, v: Vector) -> Value:
        """Contribution of the column's change to ``s . v`` along a direction: ``ds . v``, due to the design parameters
        on which s depends."""
        total: Value = 0
        for j, changes in enumerate(self.by):
            part: Value = 0
            for i, ds in changes.items():
                part = part + ds * v[i]
            total = total + x.let("ds", part, "primitive") * x.entry(DP, j)
        return total

    def added(self, v: Vector, value: Value) -> dict[int, Value]:
        """The components of ``v + s value`` that differ from those of v."""
        found: dict[int, Value] = {self.lead: v[self.lead] + value}
        for i, s in self.others.items():
            found[i] = v[i] + s * value
        return found
