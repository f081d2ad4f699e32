"""Surfaces of solids: closed, oriented outwards, with the volume of the solid."""

import math

import numpy as np
import pytest

from codegen.runtime.standalone.display.scene import Solid
from codegen.runtime.standalone.display.surfaces import surface_of
from codegen.runtime.standalone.display.viewer import _octahedron

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
VOLUMES = {
    "box": ((1.0, 2.0, 3.0), 6.0),
    "sphere": ((0.5,), 4 / 3 * math.pi * 0.125),
    "ellipsoid": ((0.5, 1.0, 2.0), 4 / 3 * math.pi),
    "cylinder": ((0.5, 2.0), math.pi * 0.5),
    "capsule": ((0.5, 2.0), math.pi * 0.5 + 4 / 3 * math.pi * 0.125),
    "rod": ((2.0,), math.pi * 0.04**2 * 2.0),
}


@pytest.mark.parametrize(("alike", "least"), [(1, 0.93), (1000, 0.78)], ids=["few", "many"])
@pytest.mark.parametrize("type_", VOLUMES)
def test_surfaces_are_closed_and_oriented_and_have_the_volume_of_the_solid(type_, alike, least):
    sizes, volume = VOLUMES[type_]
    at = np.array([1.0, -2.0, 0.5])
    solid = Solid(0, type_, np.array(sizes), TURN, at)
    vertices, faces = surface_of(solid, alike)
    vertices = solid.placed(vertices)
    edges = [(a, b) for f in faces.tolist() for a, b in zip(f, f[1:] + f[:1], strict=True)]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    corners = vertices[faces] - at
    found = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert least * volume <= found <= volume * (1 + 1e-12)
    middle = (vertices.max(axis=0) + vertices.min(axis=0)) / 2
    assert np.abs(middle - at).max() < 1e-12


def test_marks_are_closed_and_oriented():
    vertices, faces = _octahedron(0.5)
    corners = vertices[faces]
    assert (np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) > 0).all()
    assert len(vertices) - 3 * len(faces) / 2 + len(faces) == 2
