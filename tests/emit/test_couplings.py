"""Loops between long branches: generated code agrees with the engines, and its cost per body is constant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import error, worst
from coupled_mechanisms import BY_HAND, by_hand, rails, tip_on_own_link, tips_joined
from emit.test_random_mechanisms import check, draw
from loop_closure import independent_coordinates
from random_mechanisms import Mechanism

import codegen
from codegen.loops import partition
from codegen.mechanics.structure import regions
from codegen.pipeline import write_solver
from codegen.reference import DenseEngine

COUPLED = {*BY_HAND} - {
    "chain_on_four_bar", "chain_on_slide", "chain_on_forward_slide", "ring_with_sub_loop", "platform_on_short_legs"
}  # fmt: skip
"""Those whose ears start from two links that both move, and are no shorter as one region with all their speeds."""


LIKE_ANOTHER = (
    "tip_on_own_link",
    "tip_on_own_link_spatial",
    "tip_on_own_link_of_free_chain",
    "platform_on_ground",
    "tips_joined",
    "tips_joined_spatial",
    "chain_on_forward_slide",
)


COMPILED = {"sprung_tips": "kinds", "platform": "unrolled"}
"""Those whose C is looked at too, and the layout of each."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.campaign] if n in LIKE_ANOTHER else []) for n in BY_HAND]
)
def test_generated_is_generic_is_dense(tmp_path: Path, name: str) -> None:
    check_generated(tmp_path / "mechanism", name, COMPILED.get(name))


@pytest.mark.campaign
def test_rails_compiled(tmp_path: Path) -> None:
    check_generated(tmp_path / "mechanism", "rails", "kinds")


def check_generated(folder: Path, name: str, compiled: str | None) -> None:
    """Compare NumPy, and C in a layout, with the engines."""
    model, target = by_hand(name).model, "both" if compiled else "numpy"
    codegen.generate(model, folder, target, compiled or "auto", compile="all")
    text = (folder / f"{model.name}_numpy.py").read_text()
    assert ("couplings" in text) == (name in COUPLED)
    solver = codegen.load(folder, "numpy")
    check(by_hand(name), solver, 1)
    newton_converges(by_hand(name), solver)
    if compiled:
        check(by_hand(name), codegen.load(folder, "c"), 1)


def newton_converges(drawn: Mechanism, solver: codegen.Solver) -> None:
    """Near a closed state, each assembly step squares the residuals of all loops; independent coordinates do not change."""
    model, q, u, p = drawn[:4]
    rng = np.random.default_rng(4)
    plain = [i for i, n in enumerate(model.coordinate_names) if n.rpartition(".")[2] not in ("qw", "qx", "qy", "qz")]
    q = q.copy()
    q[plain] += 1e-7 * rng.uniform(-1, 1, len(plain))
    opened = np.abs(solver.closure(q, u, p)[0]).max()
    (step,) = solver._target.compute(solver._functions["newton_step"], {"q": q, "p": p}, ())
    assert np.abs(solver.closure(q + step, u, p)[0]).max() < 1e-3 * opened
    closed, _ = solver.assemble(q, u, p)
    assert np.abs(solver.closure(closed, u, p)[0]).max() < 1e-13
    kept = independent_coordinates(model, partition(model))
    assert np.array_equal(closed[[i for i in kept if i in plain]], q[[i for i in kept if i in plain]])


@pytest.mark.campaign
@pytest.mark.parametrize("coupled", [True, False])
@pytest.mark.parametrize("seed", [13])
def test_random_mechanisms_of_many_bodies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int, coupled: bool
) -> None:
    """With couplings, and as one region, which is shorter."""
    drawn = draw(seed, bodies=(9, 14), loops=(2, 4))
    assert drawn is not None
    if coupled:
        monkeypatch.setattr(regions, "is_one_region", lambda *_: False)
    source = write_solver(drawn.model)
    assert bool(source.system.regions.elimination.slots) == coupled
    codegen.generate(drawn.model, tmp_path / "mechanism", target="numpy")
    check(drawn, codegen.load(tmp_path / "mechanism"), seed)


@pytest.mark.parametrize("name", ["tips_joined_spatial", "platform"])
def test_loop_forces_are_those_of_the_dense_method(tmp_path: Path, name: str) -> None:
    model, q, u, p = by_hand(name)[:4]
    codegen.generate(model, tmp_path / "mechanism", target="numpy", reactions=True, functions=("reactions",))
    _, loops = codegen.load(tmp_path / "mechanism").reactions(q, u, p)
    assert error(loops, DenseEngine(model).reactions(q, u, p)) < 1e-11


def flops(source: Any, function: str, per: str) -> int:
    operations = source.manifest["operations"]
    return sum(sum(operations[s][per].values()) for s in source.manifest["functions"][function]["sweeps"])


@pytest.mark.parametrize("made", [rails, tips_joined, tip_on_own_link], ids=lambda f: f.__name__)
def test_operations_grow_with_the_bodies_and_nothing_else(made: Any) -> None:
    """Four rungs, or four rods in each chain, cost the same wherever they are added."""
    functions = ("accelerations", "sensitivities")
    short, middle, long = (write_solver(made(n).model(hinted=True), functions=functions) for n in (12, 16, 20))
    for function, per in zip(functions, ("per_call", "per_direction"), strict=True):
        a, b, c = (flops(s, function, per) for s in (short, middle, long))
        assert c - b == b - a
    assert len(long.system.unit_kinds) == len(middle.system.unit_kinds)


def test_a_satellite_far_from_the_origin_loses_nothing(tmp_path: Path) -> None:
    """Its links are compared with each other, not through the ground: the same numbers at 1e7 m."""
    model, q, u, p = by_hand("tips_joined_on_free_base")[:4]
    codegen.generate(model, tmp_path / "mechanism", target="numpy", functions=("sensitivities",))
    solver = codegen.load(tmp_path / "mechanism")
    far = q.copy()
    far[model.coordinate_names.index("base.px")] += 1e7
    rng = np.random.default_rng(3)
    seeds = {
        "dq": rng.normal(size=(3, model.nq)),
        "du": rng.normal(size=(3, model.nu)),
        "dp": rng.normal(size=(3, len(p))),
    }
    (here, d_here), (there, d_there) = (solver.sensitivities(x, u, p, **seeds) for x in (q, far))
    assert error(there, here) < 1e-12
    assert worst(d_there, d_here) < 1e-12
