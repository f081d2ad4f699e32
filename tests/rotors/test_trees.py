"""Reflected inertia of rotors in trees: generated code against both engines and extended precision."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from comparison import compare
from prescribed_models import with_prescribed
from random_elements import with_random_elements
from random_models import EVERY, random_tree
from rotor_models import with_rotors

import codegen
from codegen.reference import DenseEngine, RecursiveEngine


@pytest.mark.parametrize("seed", range(8))
def test_random_trees_are_those_of_both_engines(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = with_rotors(rng, random_tree(rng, int(rng.integers(2, 6)), EVERY))
    if seed % 2:
        model = with_random_elements(rng, model)
    if seed % 4 > 1:
        model = with_prescribed(rng, model)
    codegen.generate(model, tmp_path / "tree", target="numpy", layout=["kinds", "unrolled"][seed % 3 == 0])
    solver = codegen.load(tmp_path / "tree")
    for engine in (DenseEngine(model), RecursiveEngine(model)):
        found = compare(model, solver, engine, np.random.default_rng(seed), transposed=isinstance(engine, DenseEngine))
        assert max(found.values()) < 1e-11, found
