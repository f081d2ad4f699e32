"""Hessians of motions of random mechanisms: against differences of gradients, and their gradients against the adjoint method."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motion.models import seen
from motion.test_second_derivatives import same_as_differences
from motion.test_second_derivatives_of_trees import PLAIN
from prescribed_models import with_prescribed_at
from random_mechanisms import random_mechanisms
from rotor_models import with_rotors_at

import codegen
from codegen.runtime import At, Final, Integral, LeastSquares

MORE: dict[str, Any] = {"springs": lambda rng, drawn: drawn, "prescribed": with_prescribed_at, "rotors": with_rotors_at}


@pytest.mark.parametrize(
    ("seed", "scene", "more"),
    [
        (1000, "planar", "springs"),
        (3000, "spatial", "prescribed"),
        (7000, "planar", "rotors"),
        (9000, "spatial", "rotors"),
    ],
)
def test_random_mechanisms(seed: int, scene: str, more: str, tmp_path: Path) -> None:
    """Joints in all places of loops, force elements, prescribed motion, rotors, inputs and parameters."""
    _, drawn = next(random_mechanisms(1, seed, scene=scene, bodies=(2, 4), loops=(1, 2), joints=PLAIN))
    model, q, u, p, inputs, _ = MORE[more](np.random.default_rng([9, seed]), drawn)
    codegen.generate(seen(model), tmp_path / "package", functions="motion,hessian_products")
    solver = codegen.load(tmp_path / "package")
    samples = LeastSquares([0.01, 0.027], {"kinetic": [0.5, 0.2]}, sigma=0.3)
    wanted = [Final("kinetic"), Integral("kinetic"), At("kinetic", 0.014), samples]
    names, signals = solver.independent_names, solver.signal_names
    inputs = inputs[: len(signals)]
    wrt = [*solver.parameter_names, *(f"inputs.{n}" for n in signals), *(f"{x}0.{n}" for x in "qu" for n in names)]
    free = [solver.coordinate_names.index(n) for n in names]
    x = np.concatenate([p, inputs, q[free], u[free]])
    ends = np.cumsum([p.size, inputs.size, len(free)])

    def judge(x: np.ndarray, **given: Any) -> Any:
        p, inputs, q_free, u_free = np.split(x, ends)
        moved_q, moved_u = q.copy(), u.copy()
        moved_q[free], moved_u[free] = q_free, u_free
        every = np.concatenate([inputs, np.zeros(len(solver.input_names) - inputs.size)])
        closed = solver.assemble(moved_q, moved_u, p, every)
        return solver.judge(0.03, wanted, *closed, p, inputs, wrt=wrt, integrator="rk4", step=0.01, **given)

    same_as_differences(judge, x, np.full(x.size, 2e-4), 1e-7)
