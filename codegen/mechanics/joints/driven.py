"""Joints with a prescribed coordinate: no degree of freedom, but a motion that depends on time, parameters and inputs.

The coordinate, its rate and its acceleration are computed before the sweeps (`stores.MOTION`). The rate belongs to V_t, the
velocities with all speeds at zero. The acceleration belongs to the remainder A_t (Eqs. 12, 13, 20, 21).
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
"""Entries of a prescribed motion: the coordinate, its rate, its acceleration."""


class Driven(Axial):
    """A joint whose single coordinate is prescribed.

    Attributes
    ----------
    driven : bool
        True: `columns` does not contain the column of the prescribed coordinate.
    """

    freedoms, coordinates = 0, 0
    driven: ClassVar[bool] = True

    def known(self, order: int) -> Value:
        """The coordinate (`order` 0), its rate (1) or its acceleration (2); the number 0 if this is zero in every state."""
        return self.x.entry(MOTION, order) if self.kind.moves[order] else 0

    def change(self) -> Value:
        """Change of the prescribed coordinate along a direction."""
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

    # -- replacing coordinate, speed and seed ----------------------------------------------------------------------

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
    """A revolute joint with prescribed motion."""


class DrivenPrismatic(Driven, Prismatic):
    """A prismatic joint with prescribed motion."""


class DrivenScrew(Driven, Screw):
    """A screw joint with prescribed motion."""


DRIVEN_JOINTS: Final[tuple[type[LinkJoint], ...]] = (DrivenScrew, DrivenRevolute, DrivenPrismatic)
"""Joint classes with prescribed motion, longest chain first."""
