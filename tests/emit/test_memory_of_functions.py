"""C functions read no memory of a call that they have not written: the memory is filled with NaN beforehand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from painted_memory import filled
from random_mechanisms import random_mechanisms
from random_models import random_seeds

import codegen
from codegen.runtime.standalone.calls.arguments import Seeds

PARALLELOGRAM = """
model: parallelogram
gravity: [0, 0, -9.81]
parameters: {g: 2.0, L: 1.0, m: 1.0}
bodies:
  A: {parent: ground, joint: {type: revolute, axis: -y}, mass: m, com: [0.5, 0, 0], inertia: {yy: 0.08, xx: 0.2, zz: 0.2}}
  B: {parent: A, joint: {type: revolute, axis: -y, at: [L, 0, 0]}, mass: m, com: [g/2, 0, 0], inertia: {yy: 0.3, zz: 1}}
  C: {parent: ground, joint: {type: revolute, axis: -y, at: [g, 0, 0]}, mass: m, com: [0.5, 0, 0], inertia: {yy: 0.08, zz: 1}}
loops:
  r: {joint: {type: revolute, axis: -y}, from: {body: B, at: [g, 0, 0]}, to: {body: C, at: [L, 0, 0]}}
initial: {q: {A: 1.0, B: -1.0, C: 1.0}, u: {A: 1.0}}
independent: [A]
"""
"""The transposed sweep reads the acceleration of the ground, which no other sweep reads."""


def check(model: Any, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compare every C function, along eight directions, with NumPy."""
    codegen.generate(
        model, folder / "package", functions="dynamics,rates,gradients,coordinate_rate_gradients,energy_gradients"
    )
    in_c, in_numpy = (codegen.load(folder / "package", target=t)._opened for t in ("c", "numpy"))
    solver, rng = codegen.load(folder / "package"), np.random.default_rng(4)
    q, u = solver.assemble(*solver.initial)
    arrays = {"q": q, "u": u, "p": np.array(solver.parameters), "inputs": np.zeros(solver.ninputs), "t": 0.0}
    seeds = random_seeds(rng, model, 8)
    seeds |= {"dt": rng.normal(size=(8, 1)), "dudot": rng.normal(size=(8, solver.nu))}
    seeds |= {"dqdot": rng.normal(size=(8, solver.nq)), "denergy": rng.normal(size=(8, 2))}
    called = 0
    for name, f in in_c.functions.items():
        if not set(f.seeds) <= seeds.keys() or name not in in_numpy.functions:
            continue
        along = (Seeds({n: seeds[n] for n in f.seeds}, 8),) if f.seeds else ()
        expected = in_numpy.target.compute(f, arrays, (), *along)
        with monkeypatch.context() as patched:
            filled(patched)
            found = in_c.target.compute(f, arrays, (), *along)
        called += 1
        largest = max(np.abs(x).max(initial=0.0) for x in expected)
        for x, y in zip(found, expected, strict=True):
            assert np.abs(x - y).max(initial=0.0) <= 1e-9 * max(largest, 1e-3), (name, model)
    assert called > 4


def test_a_parallelogram_on_the_ground(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check(codegen.parse_model(PARALLELOGRAM), tmp_path, monkeypatch)


@pytest.mark.parametrize("start", range(0, 6, 2))
@pytest.mark.parametrize("scene", ["planar", "spatial"])
def test_small_random_mechanisms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scene: str, start: int) -> None:
    for seed, mechanism in random_mechanisms(2, 100 * start, scene=scene, bodies=(2, 4), loops=(1, 1)):
        check(mechanism.model, tmp_path / str(seed), monkeypatch)


@pytest.mark.campaign
@pytest.mark.parametrize("start", range(40))
@pytest.mark.parametrize("scene", ["planar", "spatial"])
def test_random_mechanisms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scene: str, start: int) -> None:
    for seed, mechanism in random_mechanisms(2, 1000 + 100 * start, scene=scene, bodies=(2, 5), loops=(1, 2)):
        check(mechanism.model, tmp_path / str(seed), monkeypatch)
