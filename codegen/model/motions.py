"""Elementary motions and their chains, which describe to all engines how joints move.

A chain leads from the joint's frame in the parent to the child's body frame. Each motion begins where the previous one ends.
At zero coordinates (for quaternions: the unit quaternion) all frames of the chain coincide: an axis has equal components in all.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Turn:
    """A rotation about an axis by a coordinate, rad, whose rate is the speed.

    Attributes
    ----------
    axis : int
        Index among the joint's axes.
    index : int
        Index among the joint's coordinates, and among its speeds.
    """

    axis: int
    index: int


@dataclass(frozen=True, slots=True)
class Slide:
    """A displacement along an axis by a coordinate, m, or by a factor times a coordinate; the coordinate's rate is the speed.

    Attributes
    ----------
    axis, index : int
        As in `Turn`. A turn and a slide may share a coordinate.
    factor : int or None
        Index among the joint's factors, such as a pitch in m/rad.
    """

    axis: int
    index: int
    factor: int | None = None


@dataclass(frozen=True, slots=True)
class Ball:
    """Any rotation, by a unit quaternion w, x, y, z. The quaternion converts components of the frame behind the motion
    into components of the frame before it.

    Its three speeds are the angular velocity in components of the frame behind.

    Attributes
    ----------
    coordinate, speed : int
        Index of its first coordinate among those of the joint, and of its first speed.
    """

    coordinate: int
    speed: int


@dataclass(frozen=True, slots=True)
class Displacement:
    """Any displacement x, y, z, m, as the first motion of a chain. Its speeds are the velocity, components at the chain's end.

    Attributes
    ----------
    coordinate, speed : int
        As in `Ball`.
    """

    coordinate: int
    speed: int


Motion = Turn | Slide | Ball | Displacement


def names(chain: tuple[Motion, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Suffixes of the names of a chain's coordinates and speeds, in array order; empty for a single one.

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
    """Units of coordinates and speeds of a chain, in array order; empty for quaternions.

    A coordinate that both turns and slides is an angle.
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
