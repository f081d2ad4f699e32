"""Random SDF files against Drake: ``python -m pytest -m campaign tests/importing/test_random_sdf.py``."""

from dataclasses import replace

import numpy as np
import pytest
from drake_agreement import accelerations, plant_of
from random_sdf import RandomSdf

import codegen
from codegen.reference import RecursiveEngine

SEEDS = range(300)


@pytest.mark.campaign
@pytest.mark.parametrize("start", range(0, len(SEEDS), 20))
def test_a_random_file_moves_as_drake_says(tmp_path, start):
    pytest.importorskip("pydrake", reason="compares with Drake: pip install drake")
    for seed in SEEDS[start : start + 20]:
        folder = tmp_path / str(seed)
        folder.mkdir()
        path = RandomSdf(seed, folder).write()
        try:
            plant = plant_of(str(path))
        except RuntimeError as error:
            assert "would have to be reversed" in str(error)  # a screw that Drake does not turn round
            continue
        if plant.num_velocities() == 0:
            continue
        found = codegen.import_model(path)
        engine = RecursiveEngine(replace(found.model, loops=()))
        ours, right = accelerations(plant, "robot", found, engine, seed)
        assert np.abs(ours - right).max() <= 1e-8 * max(np.abs(right).max(), 1.0), (seed, path)
