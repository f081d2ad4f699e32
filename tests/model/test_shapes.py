"""Mass properties of shapes against integration over the solid."""

import numpy as np
import pytest

from codegen.model import parse_model

_HEAD = "model: m\nbodies: {b: {parent: ground, joint: {type: free}, shape: "


def _properties(shape):
    body = parse_model(_HEAD + shape + "}}").bodies[0]
    xx, yy, zz, xy, xz, yz = (e.evaluate({}) for e in body.inertia)
    com = [e.evaluate({}) for e in body.com]
    return body.mass.evaluate({}), np.array(com), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _revolved(outline, z_range, n=400):
    """Volume, moment along and across of a solid of revolution about z, by Gauss quadrature over discs."""
    x, w = np.polynomial.legendre.leggauss(n)
    z = z_range * x
    r = outline(z)
    area = np.pi * r**2
    volume = np.sum(w * z_range * area)
    along = np.sum(w * z_range * area * r**2 / 2)
    across = np.sum(w * z_range * area * (r**2 / 4 + z**2))
    return volume, along, across


@pytest.mark.parametrize(
    ("shape", "outline", "half"),
    [
        ("{type: sphere, radius: 0.3, density: 2}", lambda z: np.sqrt(0.09 - z**2), 0.3),
        ("{type: cylinder, axis: z, radius: 0.3, length: 1.4, density: 2}", lambda z: 0.3 + 0 * z, 0.7),
        (
            "{type: capsule, axis: z, radius: 0.3, length: 1.4, density: 2}",
            lambda z: np.sqrt(np.maximum(0.09 - np.maximum(abs(z) - 0.7, 0) ** 2, 0)),
            1.0,
        ),
    ],
)
def test_solids_of_revolution(shape, outline, half):
    volume, along, across = _revolved(outline, half, 2000)
    mass, _, inertia = _properties(shape)
    assert mass == pytest.approx(2 * volume, rel=1e-6)
    np.testing.assert_allclose(inertia, np.diag([2 * across, 2 * across, 2 * along]), rtol=1e-6)


def test_box_and_rod_and_center():
    mass, com, inertia = _properties("{type: box, size: [1, 2, 3], mass: 12, center: [0.1, 0, -1]}")
    assert mass == 12
    np.testing.assert_allclose(com, [0.1, 0, -1])
    np.testing.assert_allclose(inertia, np.diag([13, 10, 5]))
    body = parse_model(
        "model: m\nbodies: {b: {parent: ground, joint: {type: revolute, axis: y}, "
        "shape: {type: rod, axis: x, length: 2, density: 3}}}"
    ).bodies[0]
    assert [e.evaluate({}) for e in body.inertia] == [0, 2, 2, 0, 0, 0]


def test_an_axis_may_be_any_vector():
    a = np.array([1.0, 2.0, -2.0])
    mass, _, inertia = _properties("{type: cylinder, axis: [1, 2, -2], radius: 0.3, length: 1.4, mass: 2}")
    along, across = mass * 0.09 / 2, mass * (0.09 / 4 + 1.4**2 / 12)
    n = a / np.linalg.norm(a)
    np.testing.assert_allclose(inertia, across * np.eye(3) + (along - across) * np.outer(n, n), rtol=1e-12)


def test_a_mass_of_the_body_makes_the_shape_display_only():
    body = parse_model(
        "model: m\nbodies: {b: {parent: ground, joint: {type: free}, mass: 2, inertia: {xx: 1, yy: 1, zz: 1}, "
        "shape: {type: sphere, radius: 1}}}"
    ).bodies[0]
    assert body.mass.value == 2
    assert [e.value for e in body.inertia] == [1, 1, 1, 0, 0, 0]
