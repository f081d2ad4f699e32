"""Generated formulas beyond double precision: in 30 digits they agree with the dense method in mpmath's numbers.

What doubles cannot show is seen here: a constant that is right to 16 digits only, a term left out because it is small. The
solver is given its model, so that what is computed at generation is computed in these digits too.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from random_elements import with_random_elements
from random_mechanisms import random_mechanisms
from random_models import EVERY, random_seeds, random_state, random_tree

import codegen
from codegen.loops.errors import PartitionError
from codegen.loops.partition import partition
from codegen.reference import DenseEngine

DIGITS = 30
FUNCTIONS = ("sensitivities", "gradients", "outputs")


def differences(model, solver, state, seeds):
    """Relative differences from the dense method, each in the maximum norm, and the consistent state."""
    engine = DenseEngine(model, "mpmath")
    q, u = solver.assemble(state.q, state.u, state.p)
    rest = (state.p, state.inputs, state.t)
    weights = np.linspace(-1, 1, model.nu)
    udot, dudot = solver.sensitivities(q, u, *rest, **seeds)
    expected, dexpected = engine.sensitivities(q, u, *rest, **seeds)
    g = solver.gradients(q, u, *rest, weights=weights)
    along = sum(np.sum(getattr(g, name[1:]) * seed, axis=-1) for name, seed in seeds.items() if name != "dt")
    pairs = {
        "udot": (udot, expected),
        "dudot": (dudot, dexpected),
        "outputs": (solver.outputs(q, u, *rest), engine.outputs(q, u, *rest)),
        "gradients": (along + g.t * seeds["dt"], dudot @ weights),
    }
    return {name: _difference(a, b) for name, (a, b) in pairs.items()}


def _difference(a, b):
    a, b = np.array(a, object), np.array(b, object)
    assert a.shape == b.shape
    return float(abs(a - b).max(initial=0) / max(1, abs(b).max(initial=0)))


def extended(model, folder):
    codegen.generate(model, folder / "package", target="numpy", functions=FUNCTIONS)
    return codegen.load(folder / "package").in_precision(DIGITS, model)


MANY = pytest.param(range(10, 40), marks=pytest.mark.campaign, id="many")


@pytest.mark.parametrize("draws", [[8], MANY])
def test_random_trees(tmp_path, draws):
    for seed in draws:
        rng = np.random.default_rng(seed)
        model = with_random_elements(rng, random_tree(rng, 3, EVERY, True, True))
        agree(model, tmp_path, random_state(rng, model), rng)


def agree(model, folder, state, rng):
    seeds = random_seeds(rng, model, 2)
    with mpmath.workdps(DIGITS + 10):
        found = differences(model, extended(model, folder), state, seeds)
    assert max(found.values()) < 1e-25, found


MANY_LOOPS = [pytest.param(s, 12, marks=pytest.mark.campaign) for s in ("spatial", "planar", "spherical")]


@pytest.mark.parametrize(("scene", "draws"), [("spatial", 1), ("planar", 1), *MANY_LOOPS])
def test_random_mechanisms(tmp_path, scene, draws):
    sizes = {"bodies": (3, 3), "loops": (1, 1)} if draws == 1 else {"bodies": (3, 6), "loops": (1, 3)}
    done = 0
    for seed, m in random_mechanisms(4 * draws, 100, scene=scene, **sizes):
        try:
            partition(m.model)
        except PartitionError:
            continue
        agree(m.model, tmp_path, m, np.random.default_rng(seed))
        done += 1
        if done == draws:
            return
    pytest.fail(f"{done} mechanisms were drawn")


def test_numbers_of_the_package_are_doubles(tmp_path):
    """Without its model the solver has what was folded at generation in double precision: that much it differs."""
    model = random_tree(np.random.default_rng(3), 3, ("revolute", "fixed"), False, False)
    codegen.generate(model, tmp_path / "package", target="numpy", functions=("accelerations",))
    solver = codegen.load(tmp_path / "package")
    q, u = np.ones(model.nq), np.ones(model.nu)
    plain, exact = solver.in_precision(DIGITS), solver.in_precision(DIGITS, model)
    difference = _difference(plain.accelerations(q, u), exact.accelerations(q, u))
    assert 1e-20 < difference < 1e-13
    with pytest.raises(ValueError, match="is not the model"):
        solver.in_precision(DIGITS, "examples/four_bar.yaml")


def test_directions_across_an_uneven_normal(tmp_path):
    """They are made of the normal, in as many digits."""
    model = codegen.parse_model("""
model: plate
gravity: [0, 0, -9.81]
bodies:
  plate: {parent: ground, mass: 1, com: [0.1, 0.2, 0.3], inertia: {xx: 1, yy: 1.1, zz: 1.2},
          joint: {type: planar, normal: [0.3, 0.7, 0.1]}}
outputs: {x: {position: {body: plate, at: [1, 2, 3]}, axis: x}}
""")
    rng = np.random.default_rng(0)
    agree(model, tmp_path, random_state(rng, model), rng)
