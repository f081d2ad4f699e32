"""Real robots of the package example-robot-data, against Pinocchio for the same files.

``python -m pytest -m campaign tests/importing/test_robots.py``
"""

import pytest
from pinocchio_agreement import errors

import codegen
from codegen.measure.pinocchio_models import robots_folder

ROBOTS = [
    ("ur_description/urdf/ur5_robot.urdf", "fixed"), ("panda_description/urdf/panda.urdf", "fixed"),
    ("kinova_description/robots/kinova.urdf", "fixed"), ("xarm_description/urdf/xarm7.urdf", "fixed"),
    ("baxter_description/urdf/baxter.urdf", "fixed"), ("tiago_description/robots/tiago.urdf", "fixed"),
    ("allegro_hand_description/urdf/allegro_left_hand.urdf", "fixed"),
    ("double_pendulum_description/urdf/double_pendulum_continuous.urdf", "fixed"),
    ("solo_description/robots/solo12.urdf", "free"), ("anymal_c_simple_description/urdf/anymal.urdf", "free"),
    ("go2_description/urdf/go2.urdf", "free"), ("hyq_description/robots/hyq_no_sensors.urdf", "free"),
    ("bolt_description/robots/bolt.urdf", "free"), ("alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf", "free"),
    ("simple_humanoid_description/urdf/simple_humanoid.urdf", "free"),
    ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "free"), ("talos_data/robots/talos_reduced.urdf", "free"),
    ("icub_description/robots/icub.urdf", "free"), ("borinot_description/urdf/borinot_flying_arm_2.urdf", "free"),
]  # fmt: skip
"""Arms, hands, quadrupeds, humanoids, and how their bases stand."""
TOLERANCE = 1e-9
ILL_CONDITIONED = {"icub": 1e-8}
"""The condition of iCub's mass matrix is up to 2e9 in these states, with which rounding alone may change derivatives by 4e-7."""


def folder():
    pytest.importorskip("pinocchio", reason="compares with Pinocchio: pip install pin")
    found = robots_folder()
    if not found.is_dir():
        pytest.skip("the robots of example-robot-data are not installed: pip install example-robot-data")
    return found


@pytest.mark.campaign
@pytest.mark.parametrize(("file", "base"), ROBOTS, ids=[file.rpartition("/")[2] for file, _ in ROBOTS])
def test_a_robot_moves_as_pinocchio_says(tmp_path, file, base):
    path = folder() / file
    found = codegen.import_model(path, base=base, free_mimic=True)
    assert found.text == codegen.import_model(path, base=base, free_mimic=True).text
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    worst = errors(str(path), found, codegen.load(tmp_path / "package"), seeds=5)
    print(f"\n{path.stem}: {found.model.nu} speeds,", ", ".join(f"{k} {v:.1e}" for k, v in worst.items()))
    assert max(worst.values()) < ILL_CONDITIONED.get(path.stem, TOLERANCE), worst


@pytest.mark.campaign
def test_every_robot_is_read_or_refused_with_lines():
    """All files of the package; those that are refused are so for what stands in them."""
    refused = {}
    for path in sorted([*folder().rglob("*.urdf"), *folder().rglob("*.sdf")]):
        try:
            codegen.import_model(path, free_mimic=True, **({"base": "free"} if path.suffix == ".urdf" else {}))
        except codegen.ModelError as error:
            refused[path.stem] = str(error)
            assert all(p.line for p in error.problems if p.severity == "error"), error
    assert refused.keys() <= {"romeo", "romeo_laas_small", "romeo_small", "ur3"}, refused
