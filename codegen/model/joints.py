"""The types of joints: what one is, the keys of a model file and the facts that all engines work from; then one class a type.

A new one is a class that is listed at the end.
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
    """The conditions of a joint that closes a loop, fixed in its start face but for the directions they compare.

    Attributes
    ----------
    linear : int
        How many directions the end face's origin is held in: 3 all, 2 those across the axis, 1 the one along it.
    angular : int
        3: the faces are parallel. 2: the axes are parallel. 1: the two axes are perpendicular. 0: they turn freely.
    """

    linear: int
    angular: int


class JointType(Entry):
    """A type of joint: a subclass has a field for each key of the file, and these facts.

    A field is an axis, several axes, or a factor of the motion (an expression).

    Attributes
    ----------
    name : str
        The value of the key ``type``.
    synonyms : tuple of str
        Other values of it, for joints that close loops.
    motion : tuple of Motion
        How a body on such a joint moves against its parent: a chain of elementary motions.
    closure : Closure or None
        What such a joint holds that closes a loop; None if it holds nothing.
    carries : bool
        Whether bodies may stand on such joints.
    closes_none : str
        Why such a joint closes no loop, if it has no closure: what follows on its name.
    triad : bool
        Whether the axes of the motion are the first one and two across it, right-handed.
    coordinates, speeds : tuple of str
        What comes behind the body's name and a dot; empty for one freedom, which has the body's name.
    coordinate_units, speed_units : tuple of str
        Of each; empty for the entries of a quaternion.
    quaternions : tuple of slice
        Where quaternions stand among the coordinates. A joint with one is whole: its speeds are no rates of single
        coordinates, and belong together.
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
        """For what the reflected inertia of rotors is given, in words, and its unit: for each speed, or once for a ball.

        A ball's speeds are components in turning axes: numbers of their own would call for gyroscopic moments. Nothing is given
        where bodies move freely.
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
            return  # in a role, see `schema`: a frame belongs to the body
        if any(isinstance(m, Displacement) for m in cls.motion[1:]):
            raise TypeError(f"joint {cls.name}: a displacement is the first of its motions")
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
        """The axes that the motion counts, from those of the file, at the default parameters where that matters."""
        return given

    @classmethod
    def wrong_axes(cls, axes: Sequence[Sequence[float]]) -> tuple[str, str] | None:
        """What is wrong with the axes of a body's joint at the default parameters: the key, and a message."""
        return None


def _axes(key: str, annotation: Any) -> list[tuple[str | int, ...]]:
    """Paths of the axes in a field: of the one it is, or of those it is a tuple of."""
    parts = get_args(annotation)
    return [(key,)] if get_args(parts[0])[0] is Expression else [(key, i) for i in range(len(parts))]


class Fixed(JointType):
    """Holds the child's frame on the joint's frame; of a loop, both faces on each other."""

    name = "fixed"
    closure = Closure(linear=3, angular=3)


class Revolute(JointType):
    """Turns about an axis. Of a loop: origins coincide, the axes are parallel."""

    name = "revolute"
    motion = (Turn(axis=0, index=0),)
    closure = Closure(linear=3, angular=2)

    axis: Axis


class Prismatic(JointType):
    """Slides along an axis. Of a loop: the faces are parallel, the origins differ along the axis only."""

    name = "prismatic"
    motion = (Slide(axis=0, index=0),)
    closure = Closure(linear=2, angular=3)

    axis: Axis


class Universal(JointType):
    """Turns about an axis fixed in the parent and one fixed in the child, which are perpendicular.

    Of a loop: origins coincide, the axes, the first fixed in the start face, the second in the end face, are perpendicular.
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
            f"the two axes have cosine {cosine:.3g}; those of a universal joint are perpendicular (to 1e-9)",
        )


class Spherical(JointType):
    """Turns about its origin. Of a loop, where it is called ``point`` too: origins coincide."""

    name = "spherical"
    synonyms = ("point",)
    motion = (Ball(coordinate=0, speed=0),)
    closure = Closure(linear=3, angular=0)


class Free(JointType):
    """Moves freely: position in the joint's frame, attitude by a quaternion; both velocities are in child components."""

    name = "free"
    motion = (Displacement(coordinate=0, speed=3), Ball(coordinate=3, speed=0))


class Screw(JointType):
    """Turns about an axis and slides along it by the pitch, m/rad, times the angle."""

    name = "screw"
    motion = (Turn(axis=0, index=0), Slide(axis=0, index=0, factor=0))
    closes_none = (
        "closes no loop, since its faces do not show how many turns it has made; let it carry a body without mass, and "
        "close the loop with a fixed joint at that body"
    )

    axis: Axis
    pitch: Expr


class Cylindrical(JointType):
    """Slides along an axis and turns about it. Of a loop: the axes lie on one line."""

    name = "cylindrical"
    motion = (Slide(axis=0, index=0), Turn(axis=0, index=1))
    closure = Closure(linear=2, angular=2)

    axis: Axis


class Planar(JointType):
    """Slides along two axes across a normal, x and y if that is z, and turns about the normal.

    Of a loop: the normals are parallel, the origin of `end` lies in the plane through that of `start`.
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
    """Of a loop: the origin of `end` lies on the axis through that of `start`."""

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
"""By name, in the order in which messages list them."""
