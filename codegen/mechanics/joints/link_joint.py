"""The interface of a link's joint to the sweeps.

A link has one joint, whose partial velocities are constant along the link's axes. The joint of a body becomes one link or
several (`structure/links.py`). The class of a joint writes the statements that convert vectors and inertias between the axes of
link and parent, and that add the joint's velocities and accelerations. It also provides the derivatives of the joint's sine,
cosine and rotation matrix.

The constant rotation ``R`` leads from the joint's frame at q = 0 to the parent's frame. It is mostly the identity.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import ClassVar, Protocol

from ...model.motions import Ball, Motion, Slide, Turn
from ...program.block import Scope
from ...program.field import XYZ
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..spatial import add, matmul, matvec, transpose
from ..stores import CONSTANTS, COORDINATES, DQ, MY_LANE, SPEEDS
from .column import Column
from .inertia import rotate_all

Primitives = dict[Value, dict[Value, Value]]
"""Derivatives of named values with respect to the angle or the rotation vector of a joint."""


class Jointed(Protocol):
    """The properties of a kind of links that its joint reads.

    Attributes
    ----------
    axis : int
        The coordinate axis of the link's frame that the joint rotates about or slides along.
    aligned : bool
        The link's axes coincide with its parent's at q = 0.
    moves : tuple of bool
        For a prescribed coordinate: whether the coordinate, its rate and its acceleration can differ from zero.
    """

    axis: int
    aligned: bool
    moves: tuple[bool, ...]

    @property
    def parameters(self) -> int:
        """The number of design parameters on which the link's constants depend."""


class LinkJoint(ABC):
    """The joint of a link, which writes its statements to an expansion.

    Parameters
    ----------
    x : Expansion or StructuralExpansion
    kind : LinkKind
    lanes : bool
        Whether the given vectors have one value per direction.

    Attributes
    ----------
    motion : tuple of Motion
        The joint's chain of elementary motions (`structure.links`). Axes are counted from the link's own axis.
    freedoms, coordinates : int
        The number of degrees of freedom and of coordinates.
    angle : int or None
        The coordinate that is an angle with a sine and a cosine.
    quaternion : int or None
        The first coordinate of a quaternion.
    swings : bool
        Whether the rotation of the joint changes the direction in which it slides.
    driven : bool
        The joint's coordinate is prescribed.
    """

    motion: ClassVar[tuple[Motion, ...]]
    freedoms: ClassVar[int]
    coordinates: ClassVar[int]
    angle: ClassVar[int | None] = None
    quaternion: ClassVar[int | None] = None
    swings: ClassVar[bool] = False
    driven: ClassVar[bool] = False

    @classmethod
    def speeds(cls) -> int:
        """The number of speeds of the joint, including a prescribed one."""
        return cls.freedoms + cls.driven

    def __init__(self, x: Scope, kind: Jointed, lanes: bool = False):
        self.x = x
        self.kind = kind
        self.lanes = lanes

    @classmethod
    def moved_by(cls, freedoms: Sequence[int]) -> list[int]:
        """The coordinates that change with any of these degrees of freedom."""
        return list(freedoms)

    @cached_property
    def fixed(self) -> Matrix | None:
        """Constant rotation from joint components to parent components; None for the identity."""
        return None if self.kind.aligned else self.x.load(CONSTANTS, fields.joint_attitude)

    def _let(self, name: str, value: Value, tag: str) -> Value:
        return self.x.let(name, value, tag, lanes=self.lanes)

    # -- degrees of freedom ---------------------------------------------------------------------------------------

    @property
    def columns(self) -> Sequence[Column]:
        """Partial velocities of the degrees of freedom."""
        return self._columns

    @cached_property
    def _columns(self) -> list[Column]:
        """Unit columns, for a joint in which each degree of freedom is one motion of the chain."""
        found: dict[int, Column] = {}
        for m in self.motion:
            first = 0 if isinstance(m, Turn | Ball) else 3
            if isinstance(m, Turn | Slide):
                found[m.index] = Column(first + (self.kind.axis + m.axis) % 3)
            else:
                found |= {m.speed + i: Column(first + i) for i in range(3)}
        return [found[j] for j in sorted(found)]

    @property
    def all_columns(self) -> Sequence[Column]:
        """The partial velocities, including that of a prescribed coordinate."""
        return self.columns

    @property
    def driven_column(self) -> Column:
        """The partial velocity of the prescribed coordinate."""
        raise TypeError(f"{type(self).__name__} is not prescribed")

    # -- place and attitude ----------------------------------------------------------------------------------------

    def way(self) -> Vector | None:
        """Displacement of the link's origin from that at q = 0, along the joint's axes; None if the joint does not slide."""
        return None

    def way_by(self, parameter: int) -> Vector | None:
        """Derivative of `way` with respect to a design parameter; None if the joint does not slide."""
        return None

    def offset(self) -> Vector:
        """Origin of the link in its parent's frame."""
        r, way = self.x.load(CONSTANTS, fields.joint_place), self.way()
        if way is None:
            return r
        return self.x.let_vector("r", add(r, way if self.fixed is None else matvec(self.fixed, way)), "Eq. 22")

    def attitude(self, W: Matrix) -> Matrix:
        """Rotation matrix of the link from that of its parent."""
        if self.fixed is not None:
            W = [[self.x.let("W", e, "Eq. 22") for e in row] for row in matmul(W, self.fixed)]
        return self._turned(W)

    def _turned(self, W: Matrix) -> Matrix:
        """``W`` times the joint's own rotation matrix."""
        return W

    # -- vectors and inertias --------------------------------------------------------------------------------------

    def to_child(self, v: Vector, name: str, tag: str) -> Vector:
        """Components along the link's axes of a vector given along the parent's axes."""
        v = [self._let(f"{name}_p{i}", v[k], tag) for k, i in enumerate(XYZ)]
        if self.fixed is not None:
            v = matvec(transpose(self.fixed), v)
            v = [self._let(f"{name}_f{i}", v[k], tag) for k, i in enumerate(XYZ)]
        return self._behind(v, name, tag)

    def to_parent(self, v: Vector, name: str, tag: str) -> Vector:
        """Components along the parent's axes of a vector given along the link's axes."""
        v = [self._let(f"{name}_c{i}", v[k], tag) for k, i in enumerate(XYZ)]
        v = self._before(v, name, tag)
        if self.fixed is not None:
            v = matvec(self.fixed, v)
            v = [self._let(f"{name}_f{i}", v[k], tag) for k, i in enumerate(XYZ)]
        return v

    def inertia_to_parent(self, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
        """The blocks of a generalised inertia along the parent's axes, about the same point."""
        J, H, M = self._inertia_before(J, H, M, tag)
        if self.fixed is not None:
            J, H, M = rotate_all(self.x, self.fixed, J, H, M, tag)
        return J, H, M

    def _behind(self, v: Vector, name: str, tag: str) -> Vector:
        """Components of a vector along the link's axes, from those along the axes of the joint's frame at q = 0."""
        return v

    def _before(self, v: Vector, name: str, tag: str) -> Vector:
        """Components of a vector along the axes of the joint's frame at q = 0, from those along the link's axes."""
        return v

    def _inertia_before(self, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
        """Blocks of an inertia along the axes of the joint's frame at q = 0, from those along the link's axes."""
        return J, H, M

    # -- motion ----------------------------------------------------------------------------------------------------

    @abstractmethod
    def turning(self, carried: Vector) -> Vector:
        """Angular velocity of a link from that of its parent (`carried`), along the link's axes. Eq. 18."""

    @abstractmethod
    def sliding(self, carried: Vector) -> Vector:
        """Velocity of the link's origin along its axes; `carried` is this velocity with the joint locked. Eq. 18."""

    @abstractmethod
    def bias(self, carried: Vector) -> tuple[Vector, Vector]:
        """Angular and linear acceleration due to the joint with udot = 0; `carried` is the parent's angular velocity along the
        link's axes. Eqs. 20, 21."""

    def bias_change(self, change: Vector) -> tuple[Vector, Vector]:
        """Change of `bias` due to a change of the parent's angular velocity; by default `bias` is linear in that
        velocity."""
        return self.bias(change)

    def rates(self) -> Vector:
        """Time derivatives of the joint's coordinates. Eq. 1."""
        return [self.x.entry(SPEEDS, i) for i in range(self.freedoms)]

    def speed(self, j: int) -> Value:
        """The speed of a degree of freedom, or the prescribed speed."""
        return self.x.entry(SPEEDS, j)

    def coordinate(self, j: int) -> Value:
        """The coordinate whose rate is speed j, for a joint without quaternion; or the prescribed coordinate."""
        return self.x.entry(COORDINATES, j)

    # -- displacements along directions ----------------------------------------------------------------------------

    @abstractmethod
    def displacement(self) -> tuple[Vector, Vector]:
        """Rotation vector and displacement due to the joint's own dq, along the link's axes."""

    def along_freedom(self, j: int) -> Value:
        """Displacement along one degree of freedom due to dq of the joint."""
        return self.x.entry(DQ, j)

    def coordinate_changes(self, found: Mapping[int, Value], lanes: bool) -> dict[int, Value]:
        """Changes of coordinates due to displacements along degrees of freedom; unaffected coordinates are left out."""
        return dict(found)

    # -- differentiation -------------------------------------------------------------------------------------------

    def transparent(self) -> Primitives:
        """Derivatives of sine, cosine and matrix entries with respect to the rotation of the link (`stores.TURNS`)."""
        return {}

    @classmethod
    def turn_seed(cls, x: Scope, component: str, store: Store = MY_LANE) -> Value:
        """Tangent of a component of the joint's rotation vector; for a quaternion it is read from `store`."""
        raise TypeError(f"{cls.__name__} does not rotate, so it has no rotation component {component}")
