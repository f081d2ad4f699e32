"""Random prescribed models: engines with exact second derivatives, and inputs over time against equal formulas."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path

import numpy as np
import pytest
from comparison import compare, error, function_errors
from prescribed_models import prescribed, with_prescribed, with_prescribed_at
from random_elements import with_random_elements
from random_mechanisms import Discarded, random_mechanism
from random_models import EVERY, expression, random_seeds, random_tree

import codegen
from codegen.model.model import Model, joint_coordinates
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.runtime.standalone.motion.functionals import Final, Integral


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(300, 360))
def test_trees(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_tree(rng, int(rng.integers(1, 6)), EVERY)
    model = with_random_elements(rng, model) if seed % 2 else model
    model = with_prescribed(
        rng, model, [0.3, 0.6, 1.0][seed % 3]
    )  # every third has no freedom but those of quaternions
    codegen.generate(model, tmp_path / "tree", target="numpy", layout=["kinds", "unrolled"][seed % 2])
    solver = codegen.load(tmp_path / "tree")
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        found = compare(model, solver, engine, np.random.default_rng(seed), transposed=isinstance(engine, DenseEngine))
        assert max(found.values()) < 1e-10, found


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(400, 430))
def test_loops(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(np.random.default_rng(seed), bodies=(3, 5), loops=(1, 2))
    if isinstance(drawn, Discarded) or (drawn := with_prescribed_at(rng, drawn, 0.7)) is None:
        pytest.skip("the draw gives no mechanism with an independent coordinate")
    codegen.generate(drawn.model, tmp_path / "loops", target="numpy", layout=["kinds", "unrolled"][seed % 2])
    solver = codegen.load(tmp_path / "loops")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of parameters that open redundant conditions
        for engine in (DenseEngine(drawn.model), RecursiveEngine(drawn.model)):
            found = function_errors(solver, engine, drawn[1:], random_seeds(rng, drawn.model, 2))
            assert max(found.values()) < 1e-9, found


def by_input_and_written_out(rng: np.random.Generator) -> tuple[Model, Model, np.ndarray] | None:
    """A random tree with a coordinate that follows an input, the same with a cubic polynomial, and its coefficients (4,)."""
    model = random_tree(rng, int(rng.integers(2, 5)), EVERY)
    names = [
        n for b in model.bodies if not b.joint.kind.quaternions for n in joint_coordinates(b.name, b.joint.type)[0]
    ]
    if not names:
        return None
    name, c = str(rng.choice(names)), rng.uniform(-0.4, 0.4, 4).round(3)
    with_input = dataclasses.replace(model, inputs=(*model.inputs, "way"))
    written = f"({c[0]}) + ({c[1]})*t + ({c[2]})*t**2 + ({c[3]})*t**3"
    return prescribed(with_input, {name: expression("way")}), prescribed(model, {name: expression(written)}), c


def check_motions(folder: Path, seed: int) -> None:
    drawn = by_input_and_written_out(np.random.default_rng(seed))
    if drawn is None:
        pytest.skip("the tree has quaternions only")
    solvers = []
    for name, model in zip(("input", "written"), drawn[:2], strict=True):
        codegen.generate(model, folder / name, functions="motion", compile="all")
        solvers.append(codegen.load(folder / name))
    t = np.array([0.0, 0.07, 0.21, 0.3, 0.4])
    way = (t, np.polyval(drawn[2][::-1], t), "cubic")
    rest = dict.fromkeys(solvers[1].signal_names, 0.1)
    wrt = [*solvers[1].parameter_names, *(f"inputs.{n}" for n in rest)]
    tight = {"rtol": 1e-12, "atol": 1e-12}
    times = np.linspace(0.0, 0.4, 4)
    one = solvers[0].simulate(times, inputs={**rest, "way": way}, sensitivities=wrt, **tight)
    other = solvers[1].simulate(times, inputs=rest, sensitivities=wrt, **tight)
    assert error(one.q, other.q) < 1e-10 and error(one.outputs, other.outputs) < 1e-8
    assert error(one.dq, other.dq) < 1e-8
    wanted = [Integral(one.output_names[-1]), Final(one.output_names[-1])]
    names = [*wrt, *(f"inputs.way[{i}]" for i in range(5))]
    forward, adjoint = (
        solvers[0].judge(0.4, wanted, inputs={**rest, "way": way}, wrt=names, method=m, **tight)
        for m in ("forward", "adjoint")
    )
    assert error(forward.gradients, adjoint.gradients) < 1e-9


def test_an_input_is_the_motion_written_out(tmp_path: Path) -> None:
    check_motions(tmp_path, 500)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(501, 525))
def test_inputs_are_the_motions_written_out(tmp_path: Path, seed: int) -> None:
    check_motions(tmp_path, seed)
