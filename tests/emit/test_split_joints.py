"""Generated solvers of mechanisms with split rotations or positions: some speeds are dependent, others independent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from emit.test_random_mechanisms import check, draw
from loop_closure import independent_coordinates
from split_mechanisms import BY_HAND, by_hand

import codegen
from codegen.loops import partition

COMPILED = ("rssr", "rods_on_platform")
"""Those whose C is looked at too."""


@pytest.mark.parametrize("name", BY_HAND)
def test_generated_is_generic_is_dense(tmp_path: Path, name: str) -> None:
    drawn = by_hand(name)
    codegen.generate(drawn.model, tmp_path / "mechanism", target="both" if name in COMPILED else "numpy", compile="all")
    solver = codegen.load(tmp_path / "mechanism", "numpy")
    check(drawn, solver, 1)
    if name in COMPILED:
        check(drawn, codegen.load(tmp_path / "mechanism", "c"), 1)
    chosen, model = partition(drawn.model), drawn.model
    names = [model.coordinate_names[i] for i in independent_coordinates(model, chosen)]
    assert list(solver.independent_names) == names
    assert list(solver.independent_speed_names) == [model.speed_names[i] for i in chosen.independent]


@pytest.mark.parametrize("seed", [pytest.param(2, marks=pytest.mark.campaign), 3])
def test_random_mechanisms_of_ball_joints_and_free_bodies(tmp_path: Path, seed: int) -> None:
    drawn = draw(seed, scene="spatial", joints=("revolute", "spherical", "free"), bodies=(3, 4))
    assert drawn is not None
    assert partition(drawn.model).split(drawn.model)
    codegen.generate(drawn.model, tmp_path / "mechanism", target="numpy")
    check(drawn, codegen.load(tmp_path / "mechanism"), seed)


def test_assembly_moves_a_split_joint_along_its_dependent_components(tmp_path: Path) -> None:
    """To first order: a guess off by little comes back along the dependent components, and closes."""
    drawn = by_hand("rssr")
    model, q = drawn.model, drawn.q
    codegen.generate(model, tmp_path / "mechanism", target="numpy", functions=("closure",))
    solver = codegen.load(tmp_path / "mechanism")
    chosen = partition(model)
    (group,) = chosen.split(model)
    guess = q + 1e-5 * np.sin(np.arange(model.nq))
    closed, _ = solver.assemble(guess, drawn.u)
    assert np.abs(solver.closure(closed, drawn.u)[0]).max() < 1e-13
    e, moved = guess[group.coordinates], closed[group.coordinates] - guess[group.coordinates]
    w, x, y, z = e / np.linalg.norm(e)
    along = 2 * np.array([[-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]]) @ moved  # components along wx, wy, wz
    free = [i for i, s in enumerate(group.speeds) if s in chosen.independent]
    bound = [i for i, s in enumerate(group.speeds) if s not in chosen.independent]
    assert np.abs(along[free]).max() < 1e-8 < 1e-6 < np.abs(along[bound]).max()
