"""Gradients in C where an ear ends on an earlier link: its contributions exist before any memory was cleared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hard.test_four_bar_dead_centre import model

import codegen


@pytest.mark.parametrize("independent", ["rocker", "crank"])
def test_transposes_are_those_of_derivatives_in_used_memory(tmp_path: Path, independent: str) -> None:
    functions = ("accelerations", "sensitivities", "gradients")
    codegen.generate(
        codegen.parse_model(model(independent)), tmp_path / "p", target="c", functions=functions, check=False
    )
    solver = codegen.load(tmp_path / "p")
    q, u = solver.initial
    u = np.where([n == independent for n in solver.speed_names], 2.0, 0.0)
    for _ in range(3):
        _, along = solver.sensitivities(q, u, dp=np.eye(solver.np))
        back = solver.gradients(q, u, weights=np.eye(solver.nu))
        np.testing.assert_allclose(back.p, along.T, rtol=0, atol=1e-12 * np.abs(along).max())
        one = solver.gradients(q, u, weights=np.eye(solver.nu)[:1])
        np.testing.assert_allclose(one.p, along.T[:1], rtol=0, atol=1e-12 * np.abs(along).max())
