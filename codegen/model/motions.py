"""Elementary motions, of which joints are chains: all that an engine has to know how a joint moves.

A chain leads from the joint's frame in the parent to the child's body frame. Each motion begins where the one before it ends,
and at coordinates of zero (a quaternion of one) all frames of the chain coincide: an axis has the same components in all.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Turn:
    """A rotation about an axis by a coordinate, rad, whose rate is the speed.

    Attributes
    ----------
    axis : int
        Which of the joint's axes.
    index : int
        Which of the joint's coordinates, and which of its speeds.
    """

    axis: int
    index: int


@dataclass(frozen=True, slots=True)
class Slide:
    """A displacement along an axis by a coordinate, m, or by a factor times it; the coordinate's rate is the speed.

    Attributes
    ----------
    axis, index : int
        As of `Turn`. Both may share a coordinate.
    factor : int or None
        Which of the joint's factors, such as a pitch in m/rad.
    """

    axis: int
    index: int
    factor: int | None = None


@dataclass(frozen=True, slots=True)
class Ball:
    """Any rotation: a unit quaternion w, x, y, z that turns components behind it into components before it.

    Its three speeds are the angular velocity in components behind it.

    Attributes
    ----------
    coordinate, speed : int
        The first of its coordinates and of its speeds among the joint's.
    """

    coordinate: int
    speed: int


@dataclass(frozen=True, slots=True)
class Displacement:
    """Any displacement, as the first of a chain: x, y, z, m. Its three speeds are the velocity in components of the chain's end.

    Attributes
    ----------
    coordinate, speed : int
        As of `Ball`.
    """

    coordinate: int
    speed: int


Motion = Turn | Slide | Ball | Displacement


def names(chain: tuple[Motion, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What coordinates and speeds of a chain are called, in array order: nothing, if there is one alone.

    Scalars are numbered; quaternions, positions and their speeds have letters.
    """
    scalars = dict.fromkeys(m.index for m in chain if isinstance(m, Turn | Slide))
    q = {i: str(n + 1) for n, i in enumerate(scalars)}
    u = dict(q)
    for m in chain:
        if isinstance(m, Ball):
            q |= {m.coordinate + i: f"q{x}" for i, x in enumerate("wxyz")}
            u |= {m.speed + i: f"w{x}" for i, x in enumerate("xyz")}
        elif isinstance(m, Displacement):
            q |= {m.coordinate + i: f"p{x}" for i, x in enumerate("xyz")}
            u |= {m.speed + i: f"v{x}" for i, x in enumerate("xyz")}
    if len(u) == 1:
        return ("",), ("",)
    return tuple(q[i] for i in range(len(q))), tuple(u[i] for i in range(len(u)))


def units(chain: tuple[Motion, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Units of coordinates and speeds of a chain, in array order; empty for quaternions, which have none.

    A coordinate that turns and slides is an angle.
    """
    q: dict[int, str] = {}
    u: dict[int, str] = {}
    for m in chain:
        if isinstance(m, Ball):
            q |= dict.fromkeys(range(m.coordinate, m.coordinate + 4), "")
            u |= dict.fromkeys(range(m.speed, m.speed + 3), "rad/s")
        elif isinstance(m, Displacement):
            q |= dict.fromkeys(range(m.coordinate, m.coordinate + 3), "m")
            u |= dict.fromkeys(range(m.speed, m.speed + 3), "m/s")
        elif isinstance(m, Turn):
            q[m.index], u[m.index] = "rad", "rad/s"
        elif m.index not in q:
            q[m.index], u[m.index] = ("m", "m/s") if m.factor is None else ("", "")
    return tuple(q[i] for i in range(len(q))), tuple(u[i] for i in range(len(u)))
