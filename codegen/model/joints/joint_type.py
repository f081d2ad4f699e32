"""What a type of joint is: the keys of a model file, and the facts that all engines work from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, get_args

from ..axes import Vector
from ..entries import Entry
from ..expressions import Expression
from ..motions import Ball, Displacement, Motion, Turn, names, units


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
