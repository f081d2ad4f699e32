"""Angular velocity of a body along an axis."""

from __future__ import annotations

from ...model.outputs import Output
from ..pairs import Pair
from .seen import Seen, along


def angular_velocity(output: Output, seen: Seen) -> Pair:
    """n . omega, the axis n in the ground or, turned into it, in the body."""
    (body,) = output.bodies
    R, omega = seen.attitude(body)
    return along(output, seen, omega if output.choice[0] == "ground" else R.mT @ omega)
