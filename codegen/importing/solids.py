"""Mass properties of homogeneous solids."""

from __future__ import annotations

import math

import numpy as np

from .robot import Inertia, Solid


def moments(solid: Solid) -> list[float]:
    """Principal moments of inertia about the centre of mass for a mass of 1 kg, along the solid's axes, m^2."""
    if solid.type == "box":
        a, b, c = (s * s / 12 for s in solid.sizes)
        return [b + c, a + c, a + b]
    if solid.type == "ellipsoid":
        a, b, c = (s * s / 5 for s in solid.sizes)
        return [b + c, a + c, a + b]
    r = solid.sizes[0]
    if solid.type == "sphere":
        return [0.4 * r * r] * 3
    length = solid.sizes[1]
    if solid.type == "cylinder":
        across = r * r / 4 + length * length / 12
        return [across, across, r * r / 2]
    if solid.type == "cone":
        across = 3 / 80 * (4 * r * r + length * length)
        return [across, across, 0.3 * r * r]
    ball = 4 * r / 3 / (length + 4 * r / 3)  # fraction of the mass in the end caps
    ends = 0.4 * r * r + length * length / 4 + 3 * length * r / 8
    across = (1 - ball) * (r * r / 4 + length * length / 12) + ball * ends
    return [across, across, (1 - ball) * r * r / 2 + ball * 0.4 * r * r]


def volume(solid: Solid) -> float:
    """The volume of a solid, m^3."""
    if solid.type == "box":
        return math.prod(solid.sizes)
    if solid.type == "ellipsoid":
        return 4 / 3 * math.pi * math.prod(solid.sizes)
    r = solid.sizes[0]
    ball = 4 / 3 * math.pi * r**3
    if solid.type == "sphere":
        return ball
    around = math.pi * r * r * solid.sizes[1]
    return {"cylinder": around, "cone": around / 3, "capsule": around + ball}[solid.type]


def of_density(solid: Solid, density: float) -> Inertia:
    """Mass properties of a solid with a density, kg/m^3, in the link's frame."""
    mass = density * volume(solid)
    com = (0.0, 0.0, -solid.sizes[1] / 4 if solid.type == "cone" else 0.0)
    return Inertia(mass, com, mass * np.diag(moments(solid))).seen_from(solid.frame)
