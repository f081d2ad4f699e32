"""Surfaces of solids as triangles."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array, Indices
from .scene import Solid

AROUND, UP = 24, 12
"""Number of sides around a round solid, and of rows of faces between the poles of a ball."""

THIN = 0.02
"""Radius of a drawn rod, relative to its length; rods have no radius in the model."""

Surface = tuple[Array, Indices]
"""Vertices (n, 3), m, and triangles (m, 3) by the indices of their vertices, counterclockwise from outside."""


MANY, COARSE = 64, 6
"""Of more than MANY solids of the same shape, each has only COARSE sides: a browser then draws fewer triangles."""


def surface_of(solid: Solid, alike: int = 1) -> Surface:
    """The surface of a solid in its own frame; `alike` solids have this surface.

    Raises
    ------
    ValueError
        If the solid is a mesh: its surface is in a file.
    """
    sizes, around = solid.sizes, AROUND if alike <= MANY else COARSE
    match solid.type:
        case "box":
            return _box(sizes)
        case "sphere":
            return _ball(np.full(3, sizes[0]), 0.0, around)
        case "ellipsoid":
            return _ball(sizes, 0.0, around)
        case "capsule":
            return _ball(np.full(3, sizes[0]), sizes[1], around)
        case "cylinder":
            return _cylinder(sizes[0], sizes[1], around)
        case "rod":
            return _cylinder(THIN * sizes[0], sizes[0], around)
    raise ValueError(f"a {solid.type} has no sizes to draw it by")


def _box(size: Array) -> Surface:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def _ball(radii: Array, length: float, around: int) -> Surface:
    """An ellipsoid whose halves are `length` apart along z, with a cylinder between them."""
    polar = np.linspace(0.0, math.pi, UP + 1)
    middle = UP // 2
    rows = [(math.sin(a), math.cos(a), 0.5 if i <= middle else -0.5) for i, a in enumerate(polar)]
    if length > 0.0:
        rows.insert(middle + 1, (1.0, 0.0, -0.5))
    return _turned([(radii[0] * s, radii[1] * s, radii[2] * c + side * length) for s, c, side in rows], around)


def _cylinder(radius: float, length: float, around: int) -> Surface:
    h = length / 2
    return _turned([(0.0, 0.0, h), (radius, radius, h), (radius, radius, -h), (0.0, 0.0, -h)], around)


def _turned(profile: list[tuple[float, float, float]], around: int) -> Surface:
    """The surface of revolution of rows (x radius, y radius, z) from the top down; its first and last row are points."""
    angles = np.arange(around) * (2.0 * math.pi / around)
    rings = [
        np.stack([x * np.cos(angles), y * np.sin(angles), np.full(around, z)], axis=1) for x, y, z in profile[1:-1]
    ]
    vertices = np.concatenate([[[0.0, 0.0, profile[0][2]]], *rings, [[0.0, 0.0, profile[-1][2]]]])
    last, faces = len(vertices) - 1, []
    for i in range(around):
        j = (i + 1) % around
        faces.append((0, 1 + i, 1 + j))
        for ring in range(len(rings) - 1):
            a, b = 1 + ring * around, 1 + (ring + 1) * around
            faces += [(a + i, b + i, b + j), (a + i, b + j, a + j)]
        end = 1 + (len(rings) - 1) * around
        faces.append((end + i, last, end + j))
    return vertices, np.array(faces)
