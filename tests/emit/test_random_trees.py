"""Random trees drawn by hypothesis: generated NumPy code, the generic engine and the dense method agree.

The C is the same statements and is compared in `test_c.py` on fewer draws, since each has to be compiled.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from comparison import compare
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from random_elements import with_random_elements
from random_models import EVERY, random_tree
from rotor_models import with_rotors

import codegen
from codegen.reference import DenseEngine, RecursiveEngine


@settings(max_examples=3, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    seed=st.integers(0, 2**32 - 1),
    bodies=st.integers(1, 4),
    joints=st.lists(st.sampled_from(EVERY), min_size=1, max_size=4, unique=True).filter(lambda j: j != ["fixed"]),
    parameters=st.booleans(),
    forces=st.booleans(),
    layout=st.sampled_from(["kinds", "unrolled"]),
)
def test_numpy_is_generic_is_dense(
    tmp_path_factory, seed: int, bodies: int, joints: list[str], parameters: bool, forces: bool, layout: str
) -> None:
    rng = np.random.default_rng(seed)
    model = random_tree(rng, bodies, tuple(joints), parameters, forces)
    if forces:
        model = with_random_elements(rng, model)
    if seed % 2:
        model = with_rotors(np.random.default_rng(seed), model)
    if model.nu == 0:
        return  # a draw of fixed joints only: nothing to compare
    folder: Path = tmp_path_factory.mktemp("tree")
    codegen.generate(model, folder / "tree", target="numpy", layout=layout)
    solver = codegen.load(folder / "tree")
    for engine in (RecursiveEngine(model), DenseEngine(model)):
        once = isinstance(engine, DenseEngine)
        found = compare(model, solver, engine, np.random.default_rng(seed), transposed=once)
        assert max(found.values()) < 1e-11, found
