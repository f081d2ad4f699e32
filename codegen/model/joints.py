"""The types of joints: the class of a type, its keys in a model file and the facts for all engines; then one class per type.

A new type is a class listed at the end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Final, NamedTuple, get_args

from .axes import Vector, coordinate_axis, cross, least_along, signed_base
from .entries import Axis, Entry, Expr
from .expressions import Expression
from .motions import Ball, Displacement, Motion, Slide, Turn, names, units


class Closure(NamedTuple):
    """The conditions of a loop joint. The directions are fixed in the start face, except the directions of axes that
    are compared.

    Attributes
    ----------
    linear : int
        Number of directions in which the end face's origin is held: 3 all, 2 those across the axis, 1 the one along it.
    angular : int
        3: the faces are parallel. 2: the axes are parallel. 1: the two axes are perpendicular. 0: free rotation.
    """

    linear: int
    angular: int


class JointType(Entry):
    """A type of joint. A subclass has a field for each key of the file, and the following class attributes.

    A field is an axis, several axes, or a factor of the motion (an expression).

    Attributes
    ----------
    name : str
        The value of the key ``type``.
    synonyms : tuple of str
        Other type names, for loop joints.
    motion : tuple of Motion
        Motion of a body relative to its parent: a chain of elementary motions.
    closure : Closure or None
        Conditions of a loop joint of this type; None if it has none.
    carries : bool
        Whether such a joint may carry a body.
    closes_none : str
        Why a type without conditions cannot close a loop, as the end of a sentence that begins with its name.
    triad : bool
        Whether the axes of the motion are the first axis and two axes across it, right-handed.
    coordinates, speeds : tuple of str
        Suffixes of the names after the body's name and a dot; empty for a single coordinate, which has the body's name.
    coordinate_units, speed_units : tuple of str
        Their units; empty for the entries of a quaternion.
    quaternions : tuple of slice
        Slices of the coordinates that are quaternions. The speeds of such a joint are not rates of single coordinates, and are
        chosen as dependent together where possible.
    axis_keys : tuple of tuple of (str or int)
        Paths of the axes in an entry.
    factor_keys : tuple of str
        Keys of the factors.
    """

    name: ClassVar[str] = ""
    synonyms: ClassVar[tuple[str, ...]] = ()
    motion: ClassVar[tuple[Motion, ...]] = ()
    closure: ClassVar[Closure | None] = None
    carries: ClassVar[bool] = True
    triad: ClassVar[bool] = False
    closes_none: ClassVar[str] = "sets no condition, so it closes no loop"
    coordinates: ClassVar[tuple[str, ...]] = ()
    speeds: ClassVar[tuple[str, ...]] = ()
    coordinate_units: ClassVar[tuple[str, ...]] = ()
    speed_units: ClassVar[tuple[str, ...]] = ()
    quaternions: ClassVar[tuple[slice, ...]] = ()
    axis_keys: ClassVar[tuple[tuple[str | int, ...], ...]] = ()
    factor_keys: ClassVar[tuple[str, ...]] = ()

    type: str

    @classmethod
    def armature_units(cls) -> tuple[tuple[str, str], ...]:
        """Descriptions and units of the reflected rotor inertias: one for each speed, or one for a spherical joint.

        The speeds of a spherical joint are components in rotating axes: different inertias would require gyroscopic moments.
        Free joints have no armature.
        """
        found: dict[int, tuple[str, str]] = {}
        for m in cls.motion:
            if isinstance(m, Ball | Displacement):
                return (("turning", "kg m^2"),) if len(cls.motion) == 1 and isinstance(m, Ball) else ()
            turns = isinstance(m, Turn)
            if turns or m.index not in found:
                found[m.index] = ("turning", "kg m^2") if turns else ("sliding", "kg")
        return tuple(found[i] for i in sorted(found))

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        if JointType not in cls.__bases__:
            return  # from `schema._in_role`: keeps the attributes of the type of joint
        if any(isinstance(m, Displacement) for m in cls.motion[1:]):
            raise TypeError(f"joint {cls.name}: a displacement is not the first of its motions; move it to the front")
        cls.coordinates, cls.speeds = names(cls.motion)
        cls.coordinate_units, cls.speed_units = units(cls.motion)
        cls.quaternions = tuple(slice(m.coordinate, m.coordinate + 4) for m in cls.motion if isinstance(m, Ball))
        fields = {key: field.annotation for key, field in cls.model_fields.items() if key != "type"}
        cls.factor_keys = tuple(key for key, annotation in fields.items() if annotation is Expression)
        cls.axis_keys = tuple(
            path
            for key, annotation in fields.items()
            if annotation is not Expression
            for path in _axes(key, annotation)
        )

    @classmethod
    def axes_of_motion(cls, given: tuple[Vector, ...], defaults: dict[str, float]) -> tuple[Vector, ...]:
        """The axes of the motion, from the axes in the file; at the default parameters where necessary."""
        return given

    @classmethod
    def wrong_axes(cls, axes: Sequence[Sequence[float]]) -> tuple[str, str] | None:
        """The key and the message of an error in the axes of a body's joint at the default parameters; None if there is none."""
        return None


def _axes(key: str, annotation: Any) -> list[tuple[str | int, ...]]:
    """Paths of the axes in a field: of a single axis, or of the axes in a tuple."""
    parts = get_args(annotation)
    return [(key,)] if get_args(parts[0])[0] is Expression else [(key, i) for i in range(len(parts))]


class Fixed(JointType):
    """The child's frame coincides with the joint's frame. As a loop joint: both faces coincide."""

    name = "fixed"
    closure = Closure(linear=3, angular=3)


class Revolute(JointType):
    """Rotation about an axis. As a loop joint: origins coincide, and the axes are parallel."""

    name = "revolute"
    motion = (Turn(axis=0, index=0),)
    closure = Closure(linear=3, angular=2)

    axis: Axis


class Prismatic(JointType):
    """Translation along an axis. As a loop joint: the faces are parallel, and their origins differ only along the axis."""

    name = "prismatic"
    motion = (Slide(axis=0, index=0),)
    closure = Closure(linear=2, angular=3)

    axis: Axis


class Universal(JointType):
    """Rotation about an axis fixed in the parent and a perpendicular one fixed in the child.

    As a loop joint: origins coincide. The axes, the first in the start face and the second in the end face, are perpendicular.
    """

    name = "universal"
    motion = (Turn(axis=0, index=0), Turn(axis=1, index=1))
    closure = Closure(linear=3, angular=1)

    axes: tuple[Axis, Axis]

    @classmethod
    def wrong_axes(cls, axes: Sequence[Sequence[float]]) -> tuple[str, str] | None:
        a, b = axes
        lengths = math.hypot(*a), math.hypot(*b)
        cosine = sum(x / lengths[0] * (y / lengths[1]) for x, y in zip(a, b, strict=True)) if all(lengths) else 0.0
        if abs(cosine) <= 1e-9:
            return None
        return (
            "axes",
            f"the two axes have cosine {cosine:.3g}; those of a universal joint must be perpendicular (to 1e-9)",
        )


class Spherical(JointType):
    """Rotation about the origin. As a loop joint, also called ``point``: origins coincide."""

    name = "spherical"
    synonyms = ("point",)
    motion = (Ball(coordinate=0, speed=0),)
    closure = Closure(linear=3, angular=0)


class Free(JointType):
    """Free motion: position in the joint's frame, attitude as a quaternion; both velocities in child components."""

    name = "free"
    motion = (Displacement(coordinate=0, speed=3), Ball(coordinate=3, speed=0))


class Screw(JointType):
    """Rotation about an axis, and translation along it by the pitch, m/rad, times the angle."""

    name = "screw"
    motion = (Turn(axis=0, index=0), Slide(axis=0, index=0, factor=0))
    closes_none = (
        "closes no loop, since its faces do not determine the number of turns; let it carry a massless body, and close the "
        "loop with a fixed joint at that body"
    )

    axis: Axis
    pitch: Expr


class Cylindrical(JointType):
    """Translation along an axis and rotation about it. As a loop joint: the axes lie on one line."""

    name = "cylindrical"
    motion = (Slide(axis=0, index=0), Turn(axis=0, index=1))
    closure = Closure(linear=2, angular=2)

    axis: Axis


class Planar(JointType):
    """Translation along two axes across a normal (x and y if the normal is z), and rotation about the normal.

    As a loop joint: the normals are parallel, and the origin of `end` lies in the plane through the origin of `start`.
    """

    name = "planar"
    motion = (Slide(axis=1, index=0), Slide(axis=2, index=1), Turn(axis=0, index=2))
    closure = Closure(linear=1, angular=2)
    triad = True
    misspelt: ClassVar[dict[str, str]] = {"axis": "normal"}

    normal: Axis

    @classmethod
    def axes_of_motion(cls, given: tuple[Vector, ...], defaults: dict[str, float]) -> tuple[Vector, ...]:
        """The normal and two axes across it, right-handed: the frame of a loop's conditions, see `closure_row_names`."""
        (normal,) = given
        along = coordinate_axis(normal)
        if along is None:
            first = cross(signed_base(least_along(normal, defaults)), normal)
            return normal, first, cross(normal, first)
        i, sign = along
        return normal, signed_base((i + 1) % 3), signed_base((i + 2) % 3, sign)


class Inline(JointType):
    """Loop joint only: the origin of `end` lies on the axis through the origin of `start`."""

    name = "inline"
    motion = (Slide(axis=0, index=0), Ball(coordinate=1, speed=1))
    closure = Closure(linear=2, angular=0)
    carries = False

    axis: Axis


_TYPES: Final[tuple[type[JointType], ...]] = (
    *(Fixed, Revolute, Prismatic, Universal, Spherical, Free),
    *(Screw, Cylindrical, Planar, Inline),
)

JOINTS: Final[dict[str, type[JointType]]] = {kind.name: kind for kind in _TYPES}
"""Types of joints by name, in the order in which messages list the types."""
