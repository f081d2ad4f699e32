"""Loops of a URDF: <constraint>, Gepetto's robot.yaml, and side files; features of URDF 1.1 and of Drake."""

import os
from pathlib import Path

import numpy as np
import pytest
from imported_robots import joint, link, robot

import codegen
from codegen.cli import main
from codegen.reference import RecursiveEngine

BARS = robot(
    link("base"), link("crank", moments=(0.1, 0.2, 0.3)), link("coupler"), link("rocker"), '<link name="foot"/>\n',
    joint("a", "base", "crank", axis="0 1 0", at="0 0 0"), joint("b", "crank", "coupler", axis="0 1 0"),
    joint("c", "coupler", "rocker", axis="0 1 0"), joint("d", "rocker", "foot", "fixed", rpy="0 0.4 0"),
)  # fmt: skip
GUESS = {"crank": 0.3, "coupler": 1.2, "rocker": 0.9}
SIDE = "loops:\n  pin:\n    joint: {}\n    from: {}\n    to: {}\ninitial:\n  q: {{crank: 0.3, coupler: 1.2, rocker: 0.9}}\n"


def imported(tmp_path, text, **options):
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    return codegen.import_model(path, **options)


def with_constraint(type_, places="", axes=""):
    text = f'<constraint name="pin" type="{type_}"><parent link="foot"/><child link="base"/>{places}{axes}</constraint>'
    return BARS.replace("</robot>", f"{text}\n</robot>")


def freed(text):
    """The bars with a joint that leaves freedoms to a loop that holds everything."""
    return text.replace('name="b" type="revolute"', 'name="b" type="floating"')


def conditions(found):
    """The residuals of the loops, and of their speeds, at a state where they are open."""
    engine = RecursiveEngine(found.model)
    rng = np.random.default_rng(4)
    names = list(found.model.coordinate_names)
    q = np.array([GUESS.get(n, 0.7) for n in names])
    q[[i for i, n in enumerate(names) if n[-3:] in (".qw", ".qx", ".qy", ".qz")]] = 0.5
    return [np.asarray(part) for part in engine.closure(q, rng.normal(size=found.model.nu))]


CHILD = '<child_origin xyz="0.6 0 0.1" rpy="0 0.2 0"/>'
SAME = [
    ("spherical", CHILD, "", "{type: point}", "foot", "{body: base, at: [0.6, 0, 0.1]}"),
    ("ball", CHILD, "", "{type: point}", "foot", "{body: base, at: [0.6, 0, 0.1]}"),
    ("fixed", CHILD, "", "{type: fixed}", "foot", "{body: base, at: [0.6, 0, 0.1], rpy: [0, 0.2, 0]}"),
    ("revolute", CHILD, '<parent_axis xyz="0 1 0"/>', "{type: revolute, axis: y}", "foot", "{body: base, at: [0.6, 0, 0.1]}"),
    (
        "revolute", CHILD.replace("0 0.2 0", "0 0 1.5707963267948966"), '<parent_axis xyz="0 2 0"/><child_axis xyz="1 0 0"/>',
        "{type: revolute, axis: y}", "foot", "{body: base, at: [0.6, 0, 0.1]}",
    ),
    (
        "cylindrical", '<parent_origin xyz="0 0 .2"/>', '<parent_axis xyz="0 0 1"/><child_axis xyz="1 0 0"/>',
        "{type: cylindrical, axis: z}", "{body: foot, at: [0, 0, 0.2]}", "{body: base, rpy: [0, pi/2, 0]}",
    ),
    ("prismatic", CHILD, "", "{type: prismatic, axis: x}", "foot", "{body: base, at: [0.6, 0, 0.1], rpy: [0, 0.2, 0]}"),
    (
        "universal", CHILD, '<parent_axis xyz="0 1 0"/><child_axis xyz="1 0 0"/>',
        "{type: universal, axes: [y, x]}", "foot", "{body: base, at: [0.6, 0, 0.1], rpy: [0, 0.2, 0]}",
    ),
    ("planar", CHILD, '<parent_axis xyz="0 0 1"/>', "{type: planar, normal: z}", "foot",
     "{body: base, at: [0.6, 0, 0.1], rpy: [0, 0.2, 0]}"),
]  # fmt: skip


@pytest.mark.parametrize(("type_", "places", "axes", "joint_", "start", "end"), SAME, ids=range(len(SAME)))
def test_a_constraint_is_the_loop_of_a_side_file(tmp_path, type_, places, axes, joint_, start, end):
    text, plain = (freed(t) if type_ == "fixed" else t for t in (with_constraint(type_, places, axes), BARS))
    found = imported(tmp_path, text)
    side = tmp_path / "side.yaml"
    written = SIDE.format(joint_, start, end.replace("body: base", "body: ground"))
    side.write_text(written.partition("initial")[0] if type_ == "fixed" else written)
    same = imported(tmp_path, plain, loops=side)
    for ours, right in zip(conditions(found), conditions(same), strict=True):
        assert np.linalg.norm(ours) == pytest.approx(np.linalg.norm(right), rel=1e-12)
        assert len(ours) == len(right)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            with_constraint("hinge"),
            "robot.urdf:11:1: constraint 'pin' is 'hinge'; revolute, continuous, prismatic, fixed,",
        ),
        (with_constraint("universal"), "constraint 'pin', universal, has no <child_axis>; both axes are needed"),
        (with_constraint("fixed").replace('<child link="base"', '<child link="bse"'), "link 'bse' is not in this file"),
        (with_constraint("fixed").replace('<child link="base"/>', ""), "constraint 'pin' has no child"),
        (
            with_constraint("prismatic", "", '<child_axis xyz="0 0 1"/>'),
            "has different axes in its links; rotate the faces",
        ),
        (with_constraint("fixed").replace('"pin"', '"a"'), "constraint 'a' is already used in line 7"),
        (with_constraint("fixed").replace('link="base"/></c', 'link="foot"/></c'), "joins link 'foot' to itself"),
        (with_constraint("revolute", "", '<parent_axis xyz="0 0 0"/>'), "the axis is 0 0 0"),
    ],
)
def test_what_is_wrong_with_a_constraint_is_said(tmp_path, text, message):
    with pytest.raises(codegen.ModelError) as error:
        imported(tmp_path, text)
    assert message in str(error.value)


# ---- Gepetto's robot.yaml ----------------------------------------------------------------------------------------------


def test_the_robot_yaml_beside_a_urdf_is_read(tmp_path):
    text = robot(
        link("base"), link("crank"), link("coupler"), link("rocker"), '<link name="end_a"/>\n<link name="end_b"/>\n',
        joint("a", "base", "crank", axis="0 1 0", at="0 0 0"), joint("b", "crank", "coupler", axis="0 1 0"),
        joint("c", "coupler", "rocker", axis="0 1 0", more='<dynamics damping="0.1"/>'),
        joint("at_a", "rocker", "end_a", "fixed"), joint("at_b", "base", "end_b", "fixed", at="0.6 0 0"),
    )  # fmt: skip
    yaml = tmp_path / "robot.yaml"
    joints = "joint_name: ['b', 'c']\njoint_type: ['UJOINT_YZ', 'SPHERICAL']\n"
    yaml.write_text(f"closed_loop: [['end_a', 'at_b']]\ntype: ['3D']\nname_mot: ['a']\n{joints}")
    found = imported(tmp_path, text)
    assert [b.joint.type for b in found.model.bodies] == ["revolute", "universal", "spherical"]
    assert "axes: [y, z]" in found.text and "joint: {type: point}" in found.text
    assert "# Loops and types of joints of robot.yaml." in found.text
    assert found.differences == ("<dynamics> of a joint whose type is changed (line 10): the dynamics differ",)
    assert any(line.startswith("name_mot (line robot.yaml:3)") for line in found.left_out)
    yaml.rename(tmp_path / "other.yaml")
    assert not imported(tmp_path, text).model.loops
    assert imported(tmp_path, text, loops=tmp_path / "other.yaml").text == found.text.replace(
        "robot.yaml", "other.yaml"
    )
    yaml.write_text("model: robot\nbodies: {}\n")  # not one of Gepetto's
    assert not imported(tmp_path, text).model.loops


def test_a_joint_that_is_not_there_is_a_warning(tmp_path):
    (tmp_path / "robot.yaml").write_text("joint_name: [x, a]\njoint_type: [FIXED, UJOINT_ZY]\n")
    found = imported(tmp_path, BARS)
    assert "axes: [z, y]" in found.text
    assert found.warnings[0].endswith(
        "robot.yaml:1:14: warning: joint 'x' is not in the URDF, so its type is not changed"
    )


def test_without_types_loops_are_closed_wholly(tmp_path):
    (tmp_path / "robot.yaml").write_text("closed_loop: [[foot, base]]\n")
    found = imported(tmp_path, freed(BARS))
    assert "joint: {type: fixed}" in found.text
    side = tmp_path / "side.yaml"
    side.write_text(SIDE.format("{type: fixed}", "foot", "ground").partition("initial")[0])
    (tmp_path / "robot.yaml").unlink()
    same = imported(tmp_path, freed(BARS), loops=side)
    for ours, right in zip(conditions(found), conditions(same), strict=True):
        np.testing.assert_allclose(ours, right, atol=1e-14)


@pytest.mark.parametrize(
    ("yaml", "message"),
    [
        ("closed_loop: [[foot, bse]]\n", "robot.yaml:1:22: frame 'bse' is not a link or joint of the URDF; did you mean 'base'?"),
        ("closed_loop: [[foot]]\n", "two frames of the URDF are needed, such as [foot_a, foot_b]"),
        ("closed_loop: 3\n", "a list of pairs of frames is needed"),
        ("closed_loop: [[foot, base]]\ntype: [4D]\n", "robot.yaml:2:8: type '4D' is unknown; 3D or 6D is allowed"),
        ("closed_loop: [[foot, base]]\ntype: [3D, 3D]\n", "type has 2 entries and closed_loop has 1; the numbers must agree"),
        ("joint_name: [a]\njoint_type: [BALL]\n", "joint_type 'BALL' is not one of SPHERICAL, FIXED, CARDAN, UJOINT_XY"),
        ("joint_name: [a, a]\njoint_type: [SPHERICAL, FIXED]\n", "robot.yaml:1:17: joint 'a' is listed twice"),
        ("joint_name: [a]\njoint_type: 3\n", "joint_type is not a list of names"),
        ("joint_name: [a]\nname_mot: [a]\n", "joint_name has 1 entries, and there is no joint_type"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_robot_yaml_is_said(tmp_path, yaml, message):
    (tmp_path / "robot.yaml").write_text(yaml)
    with pytest.raises(codegen.ModelError) as error:
        imported(tmp_path, BARS)
    assert message in str(error.value), error.value


# ---- what newer files say ----------------------------------------------------------------------------------------------


def test_quaternions_of_version_1_1_are_read(tmp_path):
    half = float(np.sqrt(0.5))
    text = BARS.replace('rpy="0 0.4 0"', f'quat_xyzw="0 {half!r} 0 {half!r}"')
    new = imported(tmp_path, text.replace('name="robot"', 'name="robot" version="1.1"'), keep_fixed=True)
    assert "foot:\n    parent: rocker\n    joint: {type: fixed, at: [0, 0, 0.5], rpy: [0, pi/2, 0]}" in new.text
    old = imported(tmp_path, text)
    assert any(line.startswith("attribute 'quat_xyzw' of <origin> (line 10)") for line in old.left_out)
    both = BARS.replace('rpy="0 0.4 0"', 'rpy="0 0 0" quat_xyzw="0 0 0 1"').replace("<robot ", '<robot version="1.10" ')
    with pytest.raises(codegen.ModelError, match="<origin> has both rpy and quat_xyzw; one of them is allowed"):
        imported(tmp_path, both)
    with pytest.raises(codegen.ModelError, match="the quaternion is 0 0 0 0"):
        imported(tmp_path, both.replace('rpy="0 0 0" ', "").replace("0 0 0 1", "0 0 0 0"))


def test_the_orientation_of_a_link_that_became_a_point_stays(tmp_path):
    found = imported(tmp_path, BARS)
    assert "  foot: {body: rocker, at: [0, 0, 0.5]}  # turned by rpy [0, 0.4, 0]\n" in found.text
    assert found.frames["foot"] == ("rocker", (0.0, 0.0, 0.5), (0.0, 0.4, 0.0))
    assert found.frames["base"] == ("ground", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def test_rotors_of_drake_are_armatures(tmp_path):
    rotor = '<drake:rotor_inertia value="0.002"/><drake:gear_ratio value="10"/>'
    text = BARS.replace(
        "</robot>",
        f'<transmission name="t"><joint name="b"/><actuator name="m">{rotor}</actuator></transmission></robot>',
    )
    assert (
        "coupler:\n    parent: crank\n    joint: {type: revolute, axis: y, armature: 0.2,"
        in imported(tmp_path, text).text
    )


def test_world_as_a_parent_is_the_ground(tmp_path):
    text = robot(link("arm"), joint("j", "world", "arm", axis="0 1 0"))
    found = imported(tmp_path, text)
    assert "parent: ground\n    joint: {type: revolute, axis: y" in found.text
    with pytest.raises(codegen.ModelError, match="link 'world' is not in this file"):
        imported(tmp_path, text.replace('child link="arm"', 'child link="world"'))


@pytest.mark.parametrize(
    "text",
    [
        "<!-- run: tool --flag x --->\n" + BARS, "\n  \n<?xml version='1.0'?>\n" + BARS,
        "<!-- a -- b -->\n<?xml version='1.0'?>" + BARS,
        "\ufeff\n<?xml version='1.0' encoding='utf-8'?>" + BARS, BARS.replace("<link", "<!-- <x> -- & \n é --><link"),
    ],
    ids=range(5),
)  # fmt: skip
def test_what_others_read_is_read(tmp_path, text):
    found, plain = imported(tmp_path, text), imported(tmp_path, BARS)
    assert found.text == plain.text.replace("(line", "(line")
    wrong = text.replace('<parent link="base"', '<parent link="bse"')
    with pytest.raises(codegen.ModelError) as error:
        imported(tmp_path, wrong)
    line = 1 + wrong[: wrong.index("bse")].count("\n")
    assert f"robot.urdf:{line}:" in str(error.value)


@pytest.mark.parametrize("element", ['<xacro:if value="1"><link name="z"/></xacro:if>', '<xacro:gripper parent="b"/>'])
def test_a_xacro_is_refused(tmp_path, element):
    for text in (BARS.replace("</robot>", f"{element}\n</robot>"), BARS.replace("</link>", f"{element}</link>", 1)):
        with pytest.raises(
            codegen.ModelError, match=r"robot.urdf:\d+:\d+: <xacro:\w+>: the file is a xacro.*xacro FILE > robot.urdf"
        ):
            imported(tmp_path, text)


def test_a_model_without_a_name_is_called_after_its_file(tmp_path):
    path = tmp_path / "My Arm-2.urdf"
    path.write_text(BARS.replace(' name="robot"', ""))
    assert codegen.import_model(path).model.name == "my_arm_2"


def test_pipes_are_refused_and_missing_folders_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.urdf")
    assert main(["import", "pipe.urdf"]) == 1
    assert (
        "pipe.urdf:1:1: cannot be read: it is a named pipe; a URDF, MJCF or SDF file is needed"
        in capsys.readouterr().err
    )
    Path("bars.urdf").write_text(BARS)
    assert main(["import", "bars.urdf", "--loops", "pipe.urdf"]) == 1
    assert "pipe.urdf:1:1: cannot be read: it is a named pipe; give a YAML file" in capsys.readouterr().err
    assert main(["import", "bars.urdf", "-o", "no/where.yaml"]) == 2
    assert capsys.readouterr().err == "import: no: no such folder; make it first\n"
    for option in ("--model", "--key"):
        assert main(["import", "bars.urdf", option, "x"]) == 1
        assert f"bars.urdf:1:1: {option} x is for " in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["import", "--help"])
    assert "comma-separated pairs LINK:WORD" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("type_", "words"),
    [
        ("ball", "{type: spherical,"), ("universal", "{type: universal, axes: [x, y],"), ("planar", "{type: planar, normal: z,"),
        ("screw", "{type: screw, axis: z, pitch: 0.5,"),
    ],
)  # fmt: skip
def test_joints_of_drake_are_read(tmp_path, type_, words):
    pitch = f'<drake:screw_thread_pitch value="{np.pi}"/>'
    text = robot(
        link("base"), link("a"), joint("j", "base", "a", type_, more=pitch).replace("joint ", "drake:joint ", 1)
    )
    found = imported(tmp_path, text.replace("</joint>", "</drake:joint>"))
    assert f"joint: {words} at: [0, 0, 0.5]" in found.text and not found.left_out
    with pytest.raises(codegen.ModelError, match="joint 'j' is 'revolute'; ball, universal, planar, screw are joints"):
        imported(tmp_path, text.replace("</joint>", "</drake:joint>").replace(f'"{type_}"', '"revolute"'))


def test_loops_and_bodies_may_have_the_same_names_in_a_urdf(tmp_path):
    found = imported(tmp_path, with_constraint("spherical").replace('"pin"', '"rocker"'))
    assert [loop.name for loop in found.model.loops] == ["rocker_2"]


def test_what_stands_in_the_root_is_listed(tmp_path):
    text = BARS.replace("<robot ", '<robot version="one" style="x" xmlns:xacro="http://x" ')
    assert imported(tmp_path, text).left_out[:2] == (
        "version 'one' of <robot> (line 1): read as 1.0; its effect is unknown",
        "attribute 'style' of <robot> (line 1): its effect is unknown",
    )
