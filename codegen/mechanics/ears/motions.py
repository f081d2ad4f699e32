"""Motion of a link: its twist, and its accelerations.

Angular parts come first; linear parts are those of the link's origin. The code that uses a motion states its axes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...program.block import Scope
from ...program.field import SixField
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from ...records import dataclass
from ..fields import MotionFields
from ..spatial import ZERO, add, cross, is_zero, matvec, minus, scale


@dataclass(slots=True)
class Twist:
    """Angular and linear part of a velocity, of a displacement, or of a change of acceleration."""

    angular: Vector
    linear: Vector

    @staticmethod
    def load(x: Scope, store: Store, field: SixField) -> Twist:
        """The twist that a field of six components contains."""
        return Twist.of(x.load(store, field))

    @staticmethod
    def of(six: Sequence[Value]) -> Twist:
        """The twist with the six given components."""
        return Twist(list(six[:3]), list(six[3:]))

    @staticmethod
    def zero() -> Twist:
        """The zero twist."""
        return Twist(list(ZERO), list(ZERO))

    @property
    def six(self) -> Vector:
        """All six components, angular first."""
        return [*self.angular, *self.linear]

    @property
    def vanishes(self) -> bool:
        """Whether the twist is zero in every state."""
        return all(is_zero(v) for v in self.six)

    def at(self, lever: Vector) -> Vector:
        """Linear part of the twist at a point of the link."""
        return add(self.linear, cross(self.angular, lever))

    def plus(self, other: Twist) -> Twist:
        """The sum of two twists."""
        return Twist(add(self.angular, other.angular), add(self.linear, other.linear))

    def minus(self, other: Twist) -> Twist:
        """The difference of two twists."""
        return Twist(minus(self.angular, other.angular), minus(self.linear, other.linear))

    def times(self, s: Value) -> Twist:
        """A multiple of the twist."""
        return Twist(scale(s, self.angular), scale(s, self.linear))


@dataclass(slots=True)
class Motion:
    """Angular velocity, angular acceleration, acceleration of the origin, and ``B = alpha x + omega x omega x``. Eqs. 18-21."""

    w: Vector
    al: Vector
    a: Vector
    B: Matrix

    @staticmethod
    def load(x: Scope, store: Store, fields: MotionFields) -> Motion:
        """The motion that four fields contain."""
        w, al, a = (x.load(store, field) for field in (fields.w, fields.al, fields.a))
        return Motion(w, al, a, x.load(store, fields.B))

    @staticmethod
    def falling(a: Vector) -> Motion:
        """A motion with an acceleration but without rotation."""
        return Motion(list(ZERO), list(ZERO), a, [list(ZERO) for _ in range(3)])

    def store(self, x: Scope, store: Store, fields: MotionFields) -> None:
        """Store the motion in four fields."""
        for field, v in ((fields.w, self.w), (fields.al, self.al), (fields.a, self.a)):
            x.store(store, field, v)
        x.store(store, fields.B, self.B)

    def at(self, lever: Vector) -> Vector:
        """Acceleration of a point of the link."""
        return add(self.a, matvec(self.B, lever))


FaceMotion = Callable[[int, int], tuple[Vector, Vector, Vector]]
"""Angular velocity, angular and linear acceleration of a face, by loop and side, along region axes."""
