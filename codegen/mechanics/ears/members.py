"""Links of an ear in its blocks: functions of their coordinates, and motions by their joints."""

from __future__ import annotations

from collections.abc import Sequence

from ...program.algebra import Number
from ...program.block import Scope, V, V_co
from ...program.field import Field, Readable
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from ...records import dataclass
from ..joints import LinkJoint
from ..joints.driven import ACCELERATION, Driven
from ..spatial import add, dot, is_zero, scale
from ..structure.kinds import LinkKind


class MemberView(Scope):
    """The scope of one link of an ear: it provides the constants, coordinates and records of this link."""

    def __init__(self, x: Scope, place: int):
        super().__init__(x.title, x.tangents, x.units)
        self.x = x
        self.place = place
        self.structural = x.structural
        self.reads = x.reads
        self.writes = x.writes

    def load(self, store: Store, field: Readable[V_co]) -> V_co:
        return self.x.load(store[self.place], field)

    def component(self, store: Store, name: str) -> Value:
        return self.x.component(store[self.place], name)

    def set_component(self, store: Store, name: str, value: Value) -> None:
        self.x.set_component(store[self.place], name, value)

    def recall(self, store: Store, field: Field[V], value: V) -> None:
        self.x.recall(store[self.place], field, value)

    def let(self, name: str, value: Value, tag: str = "", lanes: bool = False) -> Value:
        return self.x.let(name, value, tag, lanes=lanes)

    def number(self, value: float | Number) -> Value:
        return self.x.number(value)

    def sqrt(self, value: Value) -> Value:
        return self.x.sqrt(value)

    def call(self, function: str, *arguments: Value) -> Value:
        return self.x.call(function, *arguments)

    def name(self, name: str, value: Value, tag: str = "") -> Value:
        return self.x.name(name, value, tag)


@dataclass(slots=True)
class Freedom:
    """Motion of a link per unit of one degree of freedom of its joint, along region axes.

    Attributes
    ----------
    angular, linear : Vector or None
        None without rotation, or without translation.
    index : int
        Index among the joint's degrees of freedom.
    """

    angular: Vector | None
    linear: Vector | None
    index: int

    def along(self, angular: Vector, linear: Vector) -> Value:
        """Power of a moment and a force along this motion."""
        total: Value = 0
        for own, v in ((self.angular, angular), (self.linear, linear)):
            if own is not None:
                total = total + dot(own, v)
        return total


def joint_motion(freedoms: Sequence[Freedom], values: Sequence[Value]) -> tuple[Vector | None, Vector | None]:
    """Angular and linear part of a joint's motion with given rates; None for a part that is zero."""
    angular: Vector | None = None
    linear: Vector | None = None
    for f, value in zip(freedoms, values, strict=True):
        if is_zero(value):
            continue
        if f.angular is not None:
            part = scale(value, f.angular)
            angular = part if angular is None else add(angular, part)
        if f.linear is not None:
            part = scale(value, f.linear)
            linear = part if linear is None else add(linear, part)
    return angular, linear


@dataclass(slots=True)
class Member:
    """A link of an ear: functions of its coordinates.

    Attributes
    ----------
    W : Matrix
        Region components from link components.
    rho : Vector
        From the parent's origin to the link's, along region axes.
    r : Vector
        From the parent's origin to the link's, along the parent link's axes.
    freedoms : list of Freedom
    """

    view: MemberView
    kind: LinkKind
    joint: LinkJoint
    W: Matrix
    rho: Vector
    r: Vector
    freedoms: list[Freedom]
    parent: int

    @property
    def speeds(self) -> Vector:
        """Speeds of the joint's degrees of freedom, or of a prescribed joint's coordinate."""
        return [self.joint.speed(f.index) for f in self.freedoms]

    @property
    def given_accelerations(self) -> Vector | None:
        """Acceleration of a prescribed joint's coordinate; None for other joints."""
        return [self.joint.known(ACCELERATION)] if isinstance(self.joint, Driven) else None
