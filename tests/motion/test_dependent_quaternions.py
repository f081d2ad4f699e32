"""Dependent quaternions keep unit length, although Newton's method lengthens them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from emit.test_random_mechanisms import draw
from motion.models import Made, seen


@pytest.mark.parametrize("tolerance", [1e-5, 1e-7, 1e-9])
def test_implicit_steps_follow_the_tolerance(made: Callable[..., Made], tolerance: float) -> None:
    """A free body hinged to a ball joint's: its quaternion is dependent, its place is so in part."""

    def free_body() -> tuple[object, None, None]:
        drawn = draw(3, scene="spatial", bodies=(3, 5), loops=(1, 2))
        assert drawn is not None
        return seen(drawn.model), None, None

    solver = made(free_body, functions=("motion",)).solver
    assert "b2.qw" not in solver.independent_names and "b2.px" in solver.independent_names
    u = np.zeros(solver.nu)
    free = [solver.speed_names.index(n) for n in solver.independent_speed_names]
    u[free] = np.random.default_rng(3).uniform(-2, 2, len(free))
    times, q = np.linspace(0.0, 0.5, 6), solver.initial[0]
    expected = solver.simulate(times, q, u, rtol=1e-12, atol=1e-12)
    found = solver.simulate(times, q, u, method="radau", rtol=tolerance, atol=tolerance, most_steps=300)
    np.testing.assert_allclose(found.q, expected.q, rtol=0, atol=100 * tolerance)
    np.testing.assert_allclose(found.u, expected.u, rtol=0, atol=1000 * tolerance)
    quaternion = slice(solver.coordinate_names.index("b2.qw"), solver.coordinate_names.index("b2.qz") + 1)
    np.testing.assert_allclose(np.linalg.norm(found.q[:, quaternion], axis=1), 1.0, rtol=0, atol=1e-14)
    assert found.stats["rejected"] < 20
