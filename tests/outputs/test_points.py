"""Position and velocity of points; the velocity is the time derivative of the position along the motion."""

from __future__ import annotations

import numpy as np
from measured import some_axis, some_point

from codegen.model.model import Model, Output


def draw(rng: np.random.Generator, model: Model) -> list[Output]:
    point, axis = some_point(rng, model), some_axis(rng, model)
    return [Output("place", "position", (point,), axis), Output("rate_of_place", "velocity", (point,), axis)]
