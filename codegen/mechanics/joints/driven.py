"""Joints whose coordinate is prescribed: no freedom, but a motion that is a function of time, parameters and inputs.

What the coordinate, its rate and its acceleration are has been computed before the sweeps (`stores.MOTION`). The rate belongs to
V_t, what is left of velocities where all speeds are zero, the acceleration to the remainder A_t (Eqs. 12, 13, 20, 21).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Final

from ...program.block import Scope
from ...program.scalar import Value, Vector
from ...program.store import Store
from ..spatial import add
from ..stores import DMOTION, MOTION, MY_COLUMNS, MY_LANE
from .axial import Axial
from .column import Column
from .link_joint import LinkJoint
from .prismatic import Prismatic
from .revolute import Revolute
from .screw import Screw

VALUE, RATE, ACCELERATION = range(3)
"""Entries of what is known of a prescribed coordinate."""


class Driven(Axial):
    """A joint of one freedom, without that freedom.

    Attributes
    ----------
    driven : bool
        The joint's own column is none of its `columns`.
    """

    freedoms, coordinates = 0, 0
    driven: ClassVar[bool] = True

    def known(self, order: int) -> Value:
        """The coordinate, its rate or its acceleration; zero where it is that in every state."""
        return self.x.entry(MOTION, order) if self.kind.moves[order] else 0

    def change(self) -> Value:
        """The coordinate's change along a direction."""
        return self.x.entry(DMOTION, VALUE) if self.kind.moves[VALUE] else 0

    @property
    def columns(self) -> Sequence[Column]:
        return ()

    @property
    def driven_column(self) -> Column:
        return super().columns[0]

    @property
    def all_columns(self) -> Sequence[Column]:
        return (self.driven_column,)

    def speed(self, j: int) -> Value:
        return self.known(RATE)

    def along_freedom(self, j: int) -> Value:
        return self.change()

    def coordinate(self, j: int) -> Value:
        return self.known(VALUE)

    # -- in the place of coordinate, speed and seed ----------------------------------------------------------------

    def own_coordinate(self) -> Value:
        return self.known(VALUE)

    def own_speed(self) -> Value:
        return self.known(RATE)

    def own_change(self) -> Value:
        return self.change()

    @classmethod
    def turn_seed(cls, x: Scope, component: str, store: Store = MY_LANE) -> Value:
        return 0 if store is MY_COLUMNS else x.entry(DMOTION, VALUE)

    # -- motion ----------------------------------------------------------------------------------------------------

    def bias(self, carried: Vector) -> tuple[Vector, Vector]:
        angular, linear = super().bias(carried)
        column, acceleration = self.driven_column, self.known(ACCELERATION)
        turning = [self.x.let("drive", e * acceleration, "Eq. 21") for e in column.angular]
        sliding = [self.x.let("drive", e * acceleration, "Eq. 21") for e in column.linear]
        return add(angular, turning), add(linear, sliding)

    def bias_change(self, change: Vector) -> tuple[Vector, Vector]:
        return super().bias(change)


class DrivenRevolute(Driven, Revolute):
    """A hinge that turns as it is told."""


class DrivenPrismatic(Driven, Prismatic):
    """A slider that moves as it is told."""


class DrivenScrew(Driven, Screw):
    """A screw that turns as it is told."""


DRIVEN_JOINTS: Final[tuple[type[LinkJoint], ...]] = (DrivenScrew, DrivenRevolute, DrivenPrismatic)
"""The longest chains first."""
