"""What a joint of a link is: everything that the sweeps ask of it.

A link has one joint, whose partial velocities are constant columns in the link's axes; the joint of a body becomes one link or
several (`structure/links.py`). How vectors and inertias pass a joint, what it adds to velocities and accelerations, and what
is transparent to differentiation are statements that its class writes.

Between the parent's frame and the joint at q = 0 is the constant rotation ``R`` (parent components from joint components),
mostly the identity.
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
    """What of a kind of links its joint asks.

    Attributes
    ----------
    axis : int
        The coordinate axis of the link's frame that the joint turns about or slides along.
    aligned : bool
        The link's axes are its parent's at q = 0.
    moves : tuple of bool
        Of a coordinate that is prescribed: whether it, its rate and its acceleration can differ from zero.
    """

    axis: int
    aligned: bool
    moves: tuple[bool, ...]

    @property
    def parameters(self) -> int:
        """How many design parameters the link's constants depend on."""


class LinkJoint(ABC):
    """The joint of a link, as statements of an expansion.

    Parameters
    ----------
    x : Expansion or StructuralExpansion
    kind : LinkKind
    lanes : bool
        Whether the vectors that are passed are one per direction.

    Attributes
    ----------
    motion : tuple of Motion
        The chain of elementary motions that it is: see `structure.links`. Axes are counted from that of the link.
    freedoms, coordinates : int
        How many.
    angle : int or None
        Which coordinate is an angle that has a sine and a cosine.
    quaternion : int or None
        Where a quaternion begins among the coordinates.
    swings : bool
        Whether the joint's own turning changes the direction in which it slides.
    driven : bool
        Its coordinate is prescribed.
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
        """How many it has, a prescribed one too."""
        return cls.freedoms + cls.driven

    def __init__(self, x: Scope, kind: Jointed, lanes: bool = False):
        self.x = x
        self.kind = kind
        self.lanes = lanes

    @classmethod
    def moved_by(cls, freedoms: Sequence[int]) -> list[int]:
        """The coordinates that some of the freedoms move."""
        return list(freedoms)

    @cached_property
    def fixed(self) -> Matrix | None:
        """Parent components from joint components; None for the identity."""
        return None if self.kind.aligned else self.x.load(CONSTANTS, fields.joint_attitude)

    def _let(self, name: str, value: Value, tag: str) -> Value:
        return self.x.let(name, value, tag, lanes=self.lanes)

    # -- freedoms --------------------------------------------------------------------------------------------------

    @property
    def columns(self) -> Sequence[Column]:
        """Partial velocities of the freedoms."""
        return self._columns

    @cached_property
    def _columns(self) -> list[Column]:
        """Of a joint each of whose freedoms is one motion of its chain: unit columns."""
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
        """The same, and that of a coordinate that is prescribed."""
        return self.columns

    @property
    def driven_column(self) -> Column:
        """The partial velocity of a coordinate that is prescribed."""
        raise TypeError(f"{type(self).__name__} is not prescribed")

    # -- place and attitude ----------------------------------------------------------------------------------------

    def way(self) -> Vector | None:
        """From where the joint is at q = 0 to the link's origin, in joint components; None if it does not slide."""
        return None

    def way_by(self, parameter: int) -> Vector | None:
        """Derivative of `way` with respect to a design parameter; None if there is none."""
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
        """Components in the link's frame of a vector given in its parent's."""
        v = [self._let(f"{name}_p{i}", v[k], tag) for k, i in enumerate(XYZ)]
        if self.fixed is not None:
            v = matvec(transpose(self.fixed), v)
            v = [self._let(f"{name}_f{i}", v[k], tag) for k, i in enumerate(XYZ)]
        return self._behind(v, name, tag)

    def to_parent(self, v: Vector, name: str, tag: str) -> Vector:
        """Components in the parent's frame of a vector given in the link's."""
        v = [self._let(f"{name}_c{i}", v[k], tag) for k, i in enumerate(XYZ)]
        v = self._before(v, name, tag)
        if self.fixed is not None:
            v = matvec(self.fixed, v)
            v = [self._let(f"{name}_f{i}", v[k], tag) for k, i in enumerate(XYZ)]
        return v

    def inertia_to_parent(self, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
        """The blocks of a generalised inertia in the parent's axes, about the same point."""
        J, H, M = self._inertia_before(J, H, M, tag)
        if self.fixed is not None:
            J, H, M = rotate_all(self.x, self.fixed, J, H, M, tag)
        return J, H, M

    def _behind(self, v: Vector, name: str, tag: str) -> Vector:
        """Components behind the joint of a vector given before it."""
        return v

    def _before(self, v: Vector, name: str, tag: str) -> Vector:
        """Components before the joint of a vector given behind it."""
        return v

    def _inertia_before(self, J: Matrix, H: Matrix, M: Matrix, tag: str) -> tuple[Matrix, Matrix, Matrix]:
        """Blocks of an inertia in components before the joint."""
        return J, H, M

    # -- motion ----------------------------------------------------------------------------------------------------

    @abstractmethod
    def turning(self, carried: Vector) -> Vector:
        """Angular velocity of a link from that of its parent, in the link's axes. Eq. 18."""

    @abstractmethod
    def sliding(self, carried: Vector) -> Vector:
        """Velocity of the link's origin from what its parent's motion makes it, in the link's axes. Eq. 18."""

    @abstractmethod
    def bias(self, carried: Vector) -> tuple[Vector, Vector]:
        """Angular and linear acceleration that the joint adds with udot = 0, the parent turning with `carried`. Eqs. 20, 21."""

    def bias_change(self, change: Vector) -> tuple[Vector, Vector]:
        """The change of `bias` with one of the parent's angular velocity: of most joints it is linear in that."""
        return self.bias(change)

    def rates(self) -> Vector:
        """Time derivatives of the coordinates. Eq. 1."""
        return [self.x.entry(SPEEDS, i) for i in range(self.freedoms)]

    def speed(self, j: int) -> Value:
        """Of a freedom, or of the joint if it is prescribed."""
        return self.x.entry(SPEEDS, j)

    def coordinate(self, j: int) -> Value:
        """That which a freedom is the rate of, of a joint without quaternion; or the one that is prescribed."""
        return self.x.entry(COORDINATES, j)

    # -- displacements along directions ----------------------------------------------------------------------------

    @abstractmethod
    def displacement(self) -> tuple[Vector, Vector]:
        """Rotation vector and displacement that the joint's own dq causes, in the link's axes."""

    def along_freedom(self, j: int) -> Value:
        """Displacement along one freedom that dq causes."""
        return self.x.entry(DQ, j)

    def coordinate_changes(self, found: Mapping[int, Value], lanes: bool) -> dict[int, Value]:
        """Changes of coordinates from displacements along some freedoms; those of no other coordinates."""
        return dict(found)

    # -- differentiation -------------------------------------------------------------------------------------------

    def transparent(self) -> Primitives:
        """Derivatives of sine, cosine and matrix entries with respect to the rotation of the link (`stores.TURNS`)."""
        return {}

    @classmethod
    def turn_seed(cls, x: Scope, component: str, store: Store = MY_LANE) -> Value:
        """Tangent of a component of that rotation, of a joint that turns; `store` has those of quaternions."""
        raise TypeError(f"{cls.__name__} does not turn: nothing is named after {component}")
