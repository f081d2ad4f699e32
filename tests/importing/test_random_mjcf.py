"""Random MJCF files against MuJoCo: ``python -m pytest -m campaign tests/importing/test_random_mjcf.py``."""

import pytest
from mujoco_agreement import apart
from random_mjcf import RandomMjcf

import codegen

SEEDS = range(300)


def is_compiled(path):
    """Whether MuJoCo compiles a file: it refuses some paths of tendons over copies."""
    import mujoco

    try:
        mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        assert "is repeated" in str(error)
        return False
    return True


def check(tmp_path, seeds):
    pytest.importorskip("mujoco", reason="MuJoCo reads MJCF: pip install mujoco")
    for seed in seeds:
        path = tmp_path / f"robot_{seed}.xml"
        path.write_text(RandomMjcf(seed).text())
        if not is_compiled(path):
            continue
        found = codegen.import_model(path)
        assert not found.differences, (seed, found.differences)
        assert apart(path, found, 2) < 1e-8, (seed, path)


def test_some_random_files_move_as_mujoco_says(tmp_path):
    check(tmp_path, range(1000, 1006))


@pytest.mark.campaign
@pytest.mark.parametrize("start", range(0, len(SEEDS), 20))
def test_random_files_move_as_mujoco_says(tmp_path, start):
    check(tmp_path, SEEDS[start : start + 20])
