"""Frames of all bodies in a state, and positions of the model's points in their bodies."""

from __future__ import annotations

from ...program.procedure import Procedure
from ..quantities import ACCELERATION, POSE, VELOCITY
from .shared import Shared
from .words import FRAME_ACCELERATIONS, FRAMES, PLACES


def frames_of(w: Shared) -> list[Procedure]:
    """Functions for poses and velocities (without forward dynamics), accelerations (with it), and positions of points,
    and for their derivatives."""
    values, tangents = w.measuring([POSE, VELOCITY], w.begin, (*w.along, *w.turns))
    accelerated, accelerated_along = w.measuring([POSE, ACCELERATION], w.solved, w.solved_along)
    found = [
        *w.pair(
            ("frames", "frame_sensitivities"),
            (
                "Frames of all bodies, along the ground's axes: rotation matrix by rows, position, angular velocity, velocity.",
                "Frames of all bodies and their total derivative along seeds.",
            ),
            ["q", "u", *w.p],
            ["frames"],
            (*w.begin, *values, FRAMES),
            (*w.begin, *values, *w.along, *w.turns, *tangents, FRAMES, FRAMES.tangents()),
        ),
        *w.pair(
            ("frame_accelerations", "frame_acceleration_sensitivities"),
            (
                "Accelerations of the frames of all bodies, along the ground's axes: angular acceleration, acceleration.",
                "Accelerations of the frames of all bodies and their total derivative along seeds.",
            ),
            w.state,
            ["frame_accelerations"],
            (*w.solved, *accelerated, FRAME_ACCELERATIONS),
            (
                *w.solved,
                *accelerated,
                *w.solved_along,
                *accelerated_along,
                FRAME_ACCELERATIONS,
                FRAME_ACCELERATIONS.tangents(),
            ),
        ),
    ]  # fmt: skip
    if w.system.model.points_depend_on_parameters:
        found += w.pair(
            ("point_places", "point_place_sensitivities"),
            ("Positions of points in their bodies.", "Positions and their total derivative along seeds."),
            ["p"],
            ["point_places"],
            (PLACES,),
            (PLACES, PLACES.tangents()),
        )
    return found
