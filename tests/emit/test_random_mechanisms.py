"""Random mechanisms with closed loops: generated C and NumPy, the generic engine and the dense method agree.

One and several loops, nested, neighbouring, across branches, on moving and free bases, every loop joint, planar and spherical
scenes in any orientation with redundant closures, subtrees on links of loops, springs. Nothing is filtered by conditioning; draws
that are given up (rank lost, no freedom left) are counted.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import error, seeds_of, transposes, worst
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from random_elements import with_random_elements
from random_mechanisms import LOOP_JOINTS, SCENES, TREE_JOINTS, Discarded, Mechanism, random_mechanism
from random_models import EVERY
from rotor_models import with_rotors_at

import codegen
from codegen.loops.errors import PartitionError
from codegen.loops.partition import partition
from codegen.reference import DenseEngine, RecursiveEngine

EPS = np.finfo(float).eps


def compare(drawn: Mechanism, solver: codegen.Solver, engine: Any, rng: np.random.Generator) -> dict[str, float]:
    """Relative errors of values and derivatives at the drawn, assembled state."""
    model, q, u, p, inputs, t = drawn[:6]
    seeds = seeds_of(engine, (q, u, p, inputs, t), rng)
    dp = seeds["dp"]
    found = {"udot": error(solver.accelerations(q, u, p, inputs, t), engine.accelerations(q, u, p, inputs, t))}
    pairs = [
        ("sensitivities", (q, u, p, inputs, t), seeds),
        ("output_sensitivities", (q, u, p, inputs, t), seeds),
        ("coordinate_rate_sensitivities", (q, u, p, inputs, t), seeds),
    ]
    for name, arguments, directions in pairs:
        a, da = getattr(solver, name)(*arguments, **directions)
        b, db = getattr(engine, name)(*arguments, **directions)
        found[f"{name}, values"], found[name] = error(a, b), worst(da, db)
    (T, V), (dT, dV) = solver.energy_sensitivities(q, u, p, inputs, t, **seeds)
    (T_, V_), (dT_, dV_) = engine.energy_sensitivities(q, u, p, inputs, t, **seeds)
    found["energies"], found["energy_sensitivities"] = error([T, V], [T_, V_]), worst([dT, dV], [dT_, dV_])
    ours, theirs = solver.jacobians(q, u, p, inputs, t), engine.jacobians(q, u, p, inputs, t)
    for name in ("q", "u", *(["p"] if np.any(dp) else []), "inputs"):
        found[f"J.{name}"] = worst(getattr(ours, name).T, np.asarray(getattr(theirs, name), dtype=float).T)
    # what is closed: given speeds are completed, seeds too; position and velocity residuals vanish
    _, full_u, full_dq, full_du = solver.assemble_sensitivities(q, u, p, inputs, t, **seeds)
    expected = engine.complete(q, u, p, inputs, t, **seeds)
    found["u"], found["du"] = error(full_u, expected[0]), worst(full_du, expected[2])
    # assembly makes quaternions unit and their seeds tangent to that, the engine leaves both as given
    plain = [i for i, n in enumerate(model.coordinate_names) if n.rpartition(".")[2] not in ("qw", "qx", "qy", "qz")]
    found["dq"] = worst(full_dq[:, plain], np.asarray(expected[1], dtype=float)[:, plain])
    position, velocity = solver.closure(q, full_u, p, inputs, t)
    found["closure"] = max(float(np.abs(position).max()), float(np.abs(velocity).max()))
    return found


def check(drawn: Mechanism, solver: codegen.Solver, seed: int) -> None:
    """Check values to 1e-10, and derivatives to 1e-9 or 50 eps cond^2 if that is larger."""
    cond = max(ear.condition for ear in partition(drawn.model).ears)
    back = transposes(solver, tuple(drawn[1:6]), np.random.default_rng(seed))
    for engine in (DenseEngine(drawn.model), RecursiveEngine(drawn.model)):
        found = compare(drawn, solver, engine, np.random.default_rng(seed)) | back
        assert found["closure"] < 1e-12 * max(1.0, cond), (seed, found)
        values = {"udot", "u", "energies", *(n for n in found if n.endswith("values"))}
        for name, size in found.items():
            limit = 1e-10 if name in values else 1e-9
            assert size < max(limit, 50 * EPS * cond**2), (seed, type(engine).__name__, name, cond, found)


def draw(seed: int, **options: Any) -> Mechanism | None:
    """A random mechanism; None if none is found."""
    drawn = random_mechanism(np.random.default_rng(seed), **options)
    if isinstance(drawn, Discarded):
        return None
    try:
        partition(drawn.model)
    except PartitionError:
        return None
    return drawn


@settings(max_examples=3, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    seed=st.integers(0, 2**32 - 1),
    scene=st.sampled_from(SCENES),
    loop_joints=st.lists(st.sampled_from(LOOP_JOINTS), min_size=2, unique=True),
    joints=st.sampled_from((EVERY, TREE_JOINTS)),
    bodies=st.integers(3, 5),
    loops=st.integers(1, 2),
    parameters=st.booleans(),
    forces=st.booleans(),
    layout=st.sampled_from(["kinds", "unrolled"]),
)
def test_numpy_is_generic_is_dense(
    tmp_path_factory: pytest.TempPathFactory, seed: int, scene: str, loop_joints: list[str], joints: tuple[str, ...],
    bodies: int, loops: int, parameters: bool, forces: bool, layout: str,
) -> None:  # fmt: skip
    options = {"loop_joints": tuple(loop_joints), "joints": joints, "parameters": parameters, "forces": forces}
    drawn = draw(seed, scene=scene, bodies=(bodies, bodies), loops=(loops, loops), **options)
    assume(drawn is not None)
    assert drawn is not None
    if forces:
        drawn = drawn._replace(model=with_random_elements(np.random.default_rng(seed), drawn.model))
    if seed % 2:
        drawn = with_rotors_at(np.random.default_rng(seed), drawn)
    folder: Path = tmp_path_factory.mktemp("mechanism")
    codegen.generate(drawn.model, folder / "mechanism", target="numpy", layout=layout)
    check(drawn, codegen.load(folder / "mechanism"), seed)


@pytest.mark.parametrize(("seed", "layout", "elements"), [(25, "unrolled", False), (38, "kinds", True)])
def test_c_is_generic_is_dense(tmp_path: Path, seed: int, layout: str, elements: bool) -> None:
    drawn = draw(seed, bodies=(3, 5), loops=(1, 2))
    assert drawn is not None
    if elements:
        drawn = drawn._replace(model=with_random_elements(np.random.default_rng(seed), drawn.model))
    else:
        drawn = with_rotors_at(np.random.default_rng(seed), drawn)
    codegen.generate(drawn.model, tmp_path / "mechanism", target="c", layout=layout, compile="all")
    check(drawn, codegen.load(tmp_path / "mechanism"), seed)


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("first", "count", "target", "options"),
    [
        (0, 100, "both", {}),
        (1000, 60, "numpy", {"bodies": (9, 14), "loops": (2, 4)}),
        (2000, 60, "numpy", {"scene": "spatial", "joints": EVERY}),
    ],
    ids=["few_bodies", "many_bodies", "every_joint"],
)
def test_campaign(tmp_path: Path, capsys, first: int, count: int, target: str, options: dict[str, Any]) -> None:
    given_up = []
    for seed in range(first, first + count):
        drawn = draw(seed, **options)
        if drawn is None:
            given_up.append(seed)
            continue
        if seed % 2:
            drawn = drawn._replace(model=with_random_elements(np.random.default_rng(seed), drawn.model))
        if seed % 3:
            drawn = with_rotors_at(np.random.default_rng(seed), drawn)
        codegen.generate(drawn.model, tmp_path / f"m{seed}", target=target)
        check(drawn, codegen.load(tmp_path / f"m{seed}"), seed)
    with capsys.disabled():
        print(f"\n{len(given_up)} of {count} draws given up: {given_up}")
    assert len(given_up) < 0.05 * count
