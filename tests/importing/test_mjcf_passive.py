"""MJCF: forces without control, the origin of parts in several files, and the files that are read."""

import os

import numpy as np
import pytest
from mujoco_agreement import apart

import codegen
from codegen.cli import main

mujoco = pytest.importorskip("mujoco", reason="MuJoCo reads MJCF: pip install mujoco")

ARM = """\
<mujoco>
<option gravity="0.4 0.3 -9.81"><flag contact="disable" {flag}/></option>
<worldbody>
<site name="s0" pos="0.1 0.2 2"/>
<body name="a" pos="0 0 1" {body}><joint name="ja" axis="0 1 0" ref="10" {joint}/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".03"/><site name="s1" pos=".2 0 .1"/>
<body name="b" pos=".4 0 0"><joint name="jb" type="slide" axis="0.2 1 1"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/><site name="s2" pos=".2 0 .1"/><site name="s3" pos=".1 .3 .1"/>
</body></body>
</worldbody>
<tendon>{tendon}</tendon>
<actuator>{actuator}</actuator>
{more}
</mujoco>
"""
SUM = '<fixed name="t" {}><joint joint="ja" coef="1"/><joint joint="jb" coef="-2"/></fixed>'
ONE = '<fixed name="t" {}><joint joint="jb" coef="-2"/></fixed>'
PATH = '<spatial name="t" {}><site site="s0"/><site site="s1"/><site site="s2"/><site site="s3"/></spatial>'
PULLEY = PATH.replace('<site site="s2"/>', '<pulley divisor="2"/><site site="s1"/><site site="s2"/>').replace(
    '<site site="s3"/>', ""
)
POWERS = 'stiffness="5 2 1" damping="1 3"'

CASES = {
    "springs by powers": {"joint": POWERS + ' springref="30"'},
    "no springs": {"joint": 'stiffness="5" damping="1"', "flag": 'spring="disable"', "tendon": SUM.format('stiffness="3"')},
    "no dampers": {"joint": 'stiffness="5" damping="1"', "flag": 'damper="disable"', "tendon": SUM.format('damping="3"')},
    "gravcomp": {"body": 'gravcomp="0.7"'},
    "gravcomp without passive forces": {"body": 'gravcomp="0.7"', "flag": 'spring="disable" damper="disable"'},
    "gravcomp without gravity": {"body": 'gravcomp="0.7"', "flag": 'gravity="disable"'},
    "a rotor and its damper": {"actuator": '<motor joint="ja" gear="5" armature="0.3" damping="0.2"/>'},
    "a damper by powers": {"actuator": '<motor joint="ja" gear="3" damping="0.2 0.1"/>', "flag": 'actuation="disable"'},
    "a position servo": {"actuator": '<position joint="ja" kp="10" kv="3" gear="2"/><position joint="jb" kp="5"/>'},
    "a damping ratio": {"actuator": '<position joint="ja" kp="10" dampratio="0.7"/>'},
    "a velocity servo": {"actuator": '<velocity joint="jb" kv="3" gear="-2"/>'},
    "an integrated servo": {"actuator": '<intvelocity joint="jb" kp="3"/>'},
    "a general one": {"actuator": '<general joint="ja" gainprm="2" biastype="affine" biasprm="1 -3 -.5"/>'},
    "a damper": {"actuator": '<damper joint="ja" kv="3" ctrlrange="0.5 1"/>'},
    "a range without 0": {"actuator": '<position joint="ja" kp="3" ctrlrange="0.5 1"/>'},
    "a range that is not kept": {
        "actuator": '<position joint="ja" kp="3" ctrlrange="0.5 1"/>', "flag": 'clampctrl="disable"',
    },
    "a limited force": {"actuator": '<position joint="ja" kp="30" forcerange="-2 1.5"/>'},
    "a joint whose actuators have a range": {
        "joint": 'actuatorfrcrange="-1 1.5"', "tendon": SUM.format(""),
        "actuator": '<position joint="ja" kp="9"/><position tendon="t" kp="3" kv="1"/>'
        '<general joint="ja" gear="2" biastype="affine" biasprm="1 0 -1"/>',
    },
    "weight that actuators carry": {
        "body": 'gravcomp="0.7"', "joint": 'actuatorgravcomp="true"', "actuator": '<motor joint="jb"/>',
    },
    "no actuation": {"actuator": '<position joint="ja" kp="30"/>', "flag": 'actuation="disable"'},
    "a tendon between joints": {"tendon": SUM.format('stiffness="3" damping="2" springlength="0.3"')},
    "a slack tendon": {"tendon": SUM.format('stiffness="3" springlength="-.2 .1"')},
    "a tendon by powers": {"tendon": SUM.format('stiffness="3 1" damping="2 1" springlength="0.3"')},
    "the rotor of a tendon": {"tendon": ONE.format('armature="0.4"')},
    "a servo of a tendon": {"tendon": SUM.format(""), "actuator": '<position tendon="t" kp="3" kv="0.5" gear="2"/>'},
    "rotor of a servo of a tendon": {"tendon": ONE.format(""), "actuator": '<motor tendon="t" gear="2" armature=".1"/>'},
    "damper of a servo of a tendon": {"tendon": SUM.format(""), "actuator": '<motor tendon="t" gear="2" damping=".4"/>'},
    "a tendon along points": {"tendon": PATH.format('stiffness="30" damping="2" springlength="0.9"')},
    "a slack tendon along points": {"tendon": PATH.format('stiffness="30" springlength="0 1.2"')},
    "a tendon with a pulley": {"tendon": PULLEY.format('stiffness="30" damping="1" springlength="0.9"')},
    "a tendon whose actuators have a range": {
        "joint": 'actuatorfrcrange="-1 .3"', "tendon": SUM.format('actuatorfrcrange="-.3 .2"'),
        "actuator": '<position tendon="t" kp="9" gear="2"/><velocity tendon="t" kv="3" gear="2"/><position joint="ja" kp="3"/>',
    },
    "a tendon along points whose actuators have a range": {
        "tendon": PULLEY.format('actuatorfrcrange="-1 30"'),
        "actuator": '<position tendon="t" kp="9" gear="3"/><general tendon="t" gear="3" biastype="affine" biasprm="-9 0 0"/>',
    },
    "a tendon whose only actuator has a range": {
        "tendon": SUM.format('actuatorfrcrange="-.1 .1"'), "actuator": '<position name="p" tendon="t" kp="9" gear="-2"/>',
    },
    "a servo of a tendon along points": {"tendon": PULLEY.format(""), "actuator": '<position tendon="t" kp="9" gear="3"/>'},
}  # fmt: skip


def text_of(**parts):
    empty = dict.fromkeys(("flag", "body", "joint", "tendon", "actuator", "more"), "")
    return ARM.format(**{**empty, **parts})


@pytest.mark.parametrize("name", CASES)
def test_what_acts_without_control_is_read(tmp_path, name):
    path = tmp_path / "arm.xml"
    path.write_text(text_of(**CASES[name]))
    found = codegen.import_model(path)
    assert not found.differences
    assert apart(path, found) < 1e-10, found.text
    same = codegen.from_mujoco(mujoco.MjModel.from_xml_path(str(path)))
    assert (
        same.text.partition("\nmodel: ")[2].partition("\n")[2]
        == found.text.partition("\nmodel: ")[2].partition("\n")[2]
    )


SILENT = {
    "dry friction": {"joint": 'frictionloss="2"'},
    "a spring that yields": {"joint": 'stiffness="5" springyield="1"'},
    "a rotor of several joints": {"tendon": SUM.format('armature="0.4"')},
    "a muscle": {"actuator": '<muscle joint="ja" lengthrange="0.5 1"/>'},
    "a medium": {"more": '<option density="1000"/>'},
    "a tendon round a geom": {
        "tendon": '<spatial stiffness="9"><site site="s0"/><geom geom="g"/><site site="s2"/></spatial>',
        "body": '><geom name="g" size=".05" pos="0 0 .2"/', "joint": "",
    },
    "friction of a tendon": {"tendon": SUM.format('frictionloss="0.4"')},
    "weight that no actuator carries": {"body": 'gravcomp="0.7"', "joint": 'actuatorgravcomp="true"'},
    "weight within a range": {
        "body": 'gravcomp="0.7"', "joint": 'actuatorgravcomp="true" actuatorfrcrange="-1 1"',
        "actuator": '<motor joint="jb"/>',
    },
    "a tendon whose actuators have a range and other gears": {
        "tendon": SUM.format('actuatorfrcrange="-.1 .1"'),
        "actuator": '<position tendon="t" kp="9"/><position tendon="t" kp="9" gear="2"/>',
    },
    "a range of joints along points": {
        "joint": 'actuatorfrcrange="-1 1"', "tendon": PATH.format(""), "actuator": '<position tendon="t" kp="9"/>',
    },
}  # fmt: skip


@pytest.mark.parametrize("name", SILENT)
def test_what_changes_the_dynamics_is_listed_as_such(tmp_path, name):
    path = tmp_path / "arm.xml"
    path.write_text(text_of(**SILENT[name]))
    found = codegen.import_model(path)
    assert found.differences and all(line.endswith(" the dynamics differ") for line in found.differences)
    assert set(found.differences) <= set(found.left_out)


def test_disabled_constraints_leave_loops_open(tmp_path):
    path = tmp_path / "arm.xml"
    equality = '<equality><connect body1="b" anchor=".3 0 0"/></equality>'
    for flag, loops in (("", 1), ('equality="disable"', 0), ('constraint="disable"', 0)):
        path.write_text(text_of(flag=flag, more=equality))
        assert len(codegen.import_model(path).model.loops) == loops


def test_a_joint_held_by_an_equality_is_locked(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(text_of(more='<equality><joint joint1="ja" polycoef="0.3 0 0 0 0"/></equality>'))
    found = codegen.import_model(path)
    assert "motion:\n  a: 0.3\n" in found.text and found.model.nu == 1


KEYS = """<keyframe><key name="home" qpos="0.5 0.2" qvel="1 2"/><key name="folded" qpos="1 0"/></keyframe>"""


def test_the_model_begins_in_a_keyframe(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(text_of(more=KEYS))
    zero = float(np.radians(10))
    found = codegen.import_model(path)
    assert f"q: {{a: {0.5 - zero!r}, b: 0.2}}\n  u: {{a: 1, b: 2}}" in found.text and "keyframe home" in found.text
    assert any(line.startswith("<key> (line") for line in found.left_out)
    assert f"q: {{a: {1 - zero!r}}}" in codegen.import_model(path, key="folded").text
    assert "initial:" not in codegen.import_model(path, key="").text
    with pytest.raises(codegen.ModelError, match="--key hme is not a keyframe; keyframes are home, folded; did you"):
        codegen.import_model(path, key="hme")


def test_what_a_keyframe_says_of_actuators_and_mocap_bodies_is_listed(tmp_path):
    """An activation keeps pushing without control; a mocap body is what others may be welded to."""
    path = tmp_path / "robot.xml"
    path.write_text(
        """<mujoco><worldbody><body name="m" mocap="true" pos="1 0 0"/><body><joint name="a"/><geom size=".1"/></body></worldbody>
        <actuator><intvelocity joint="a" kp="4" actrange="-1 1"/></actuator><keyframe><key qpos="0.1" act="0.5" ctrl="1"/>
        <key name="moved" mpos="2 0 0"/></keyframe></mujoco>"""
    )
    found = codegen.import_model(path)
    assert any(line.startswith("act of the <key> (line 2)") for line in found.differences)
    assert any(line.startswith("ctrl of the <key>") and line.endswith("only when driven") for line in found.left_out)
    assert not any("mpos" in line for line in found.left_out)
    assert any(
        line.startswith("mpos, mquat of the <key>") for line in codegen.import_model(path, key="moved").differences
    )


def test_the_keyframe_of_a_free_body(tmp_path):
    path = tmp_path / "drone.xml"
    key = '<key qpos="1 2 3 0 2 0 0 1 0 0 0" qvel="1 2 3 4 5 6 7 8 9"/>'
    body = '<body name="d"><freejoint/><geom size=".1"/><body><joint type="ball"/><geom size=".1" pos="1 0 0"/></body></body>'
    path.write_text(f"<mujoco><worldbody>{body}</worldbody><keyframe>{key}</keyframe></mujoco>")
    found = codegen.import_model(path)
    assert "d: [1, 2, 3, 0, 1, 0, 0]" in found.text
    assert "d: [4, 5, 6, 1, -2, -3]" in found.text  # half a turn about x: the velocity in the body's axes
    assert "[7, 8, 9]" in found.text
    assert found.model.name == "drone"


# ---- files -----------------------------------------------------------------------------------------------------------

CHILD = """<mujoco><worldbody><body name="a" pos="0 0 1"><joint name="ja" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".03"/><site name="s"/></body></worldbody>
<actuator><position joint="ja" kp="10"/></actuator><sensor><jointpos joint="ja"/></sensor></mujoco>"""
INCLUDING = '<mujoco><include file="child.xml"/></mujoco>'
ATTACHED = '<asset><model name="m" file="child.xml"/></asset><worldbody><attach model="m" prefix="x_"/></worldbody>'
ATTACHING = f"<mujoco>{ATTACHED}</mujoco>"


@pytest.mark.parametrize("text", [INCLUDING, ATTACHING], ids=["include", "attach"])
def test_what_comes_from_other_files_is_read_and_listed(tmp_path, text):
    (tmp_path / "child.xml").write_text(CHILD)
    path = tmp_path / "scene.xml"
    path.write_text(text)
    found = codegen.import_model(path)
    assert "value: -10*q." in found.text and found.model.name == "scene"
    listed = [line.partition(":")[0] + line.partition(":")[2].partition(":")[0] for line in found.left_out]
    assert any(line.startswith("<site> (line child.xml") for line in listed), found.left_out
    assert any(line.startswith("<actuator> (line child.xml") for line in listed), found.left_out
    assert any(line.startswith("<sensor> (line child.xml") for line in listed), found.left_out


def test_files_elsewhere_are_read_on_request_only(tmp_path):
    folder, other = tmp_path / "robot", tmp_path / "other"
    folder.mkdir(), other.mkdir()
    (other / "child.xml").write_text(CHILD)
    path = folder / "scene.xml"
    names = ["../other/child.xml", str(other / "child.xml")]
    os.symlink(other / "child.xml", folder / "link.xml")
    for name in [*names, "link.xml"]:
        for text in (INCLUDING, ATTACHING):
            path.write_text(text.replace("child.xml", name))
            with pytest.raises(
                codegen.ModelError, match=r"scene.xml:1:\d+: file '.*' of <\w+> is outside .* --package-path"
            ):
                codegen.import_model(path)
            assert codegen.import_model(path, package_paths=[other]).model.nu == 1
    (other / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    mesh = '<asset><mesh name="m" file="{}"/></asset><worldbody><body><joint/><geom type="mesh" mesh="m"/></body></worldbody>'
    for compiler, name in (
        ("", "../other/m.obj"),
        ('<compiler meshdir="../other"/>', "m.obj"),
        ('<compiler assetdir="../other"/>', "m.obj"),
    ):
        path.write_text(f"<mujoco>{compiler}{mesh.format(name)}</mujoco>")
        with pytest.raises(codegen.ModelError, match="of <mesh> is outside"):
            codegen.import_model(path)
        assert codegen.import_model(path, package_paths=[other]).model.nu == 1


def test_pipes_and_copies_without_end_are_refused(tmp_path):
    path = tmp_path / "scene.xml"
    os.mkfifo(tmp_path / "child.xml")
    path.write_text(INCLUDING)
    with pytest.raises(codegen.ModelError, match="is not read: it is a named pipe"):
        codegen.import_model(path)
    body = '<body><joint/><geom size="1"/></body>'
    for copies in (
        f'<replicate count="30000000" offset="0 0 1">{body}</replicate>',
        f'<replicate count="3000"><replicate count="3000">{body}</replicate></replicate>',
        '<body><composite type="particle" count="1000 1000 1000" spacing="1"><geom size=".1"/></composite></body>',
    ):
        path.write_text(f"<mujoco>\n<worldbody>\n{copies}</worldbody></mujoco>")
        with pytest.raises(
            codegen.ModelError, match=r"scene.xml:3:\d+: the model would have more than 200000 elements"
        ):
            codegen.import_model(path)


def test_the_command_takes_the_key(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.xml").write_text(text_of(more=KEYS))
    assert main(["import", "arm.xml", "-o", "-", "--key", "folded"]) == 0
    assert "keyframe folded" in capsys.readouterr().out


@pytest.mark.parametrize(
    "text",
    [
        '<mujoco>\n<include file="copies.xml"/></mujoco>',
        '<mujoco>\n<custom><numeric name="n" size="2000000000"/></custom></mujoco>',
        '<mujoco>\n<size nuser_body="2000000000"/></mujoco>',
        '<mujoco>\n<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset></mujoco>',
        '<mujoco>\n<asset><texture name="t" builtin="flat" width="100000" height="100000"/></asset></mujoco>',
    ],
)  # fmt: skip
def test_sizes_that_no_machine_has_are_refused(tmp_path, text):
    copies = '<replicate count="1e7" offset="0 0 1"><geom size="1"/></replicate>'
    (tmp_path / "copies.xml").write_text(f"<mujoco><worldbody>{copies}</worldbody></mujoco>")
    path = tmp_path / "scene.xml"
    path.write_text(text)
    with pytest.raises(codegen.ModelError, match=r"at most|more than 200000 elements"):
        codegen.import_model(path)


def test_a_weight_that_is_carried_is_no_parameter(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(text_of(body='gravcomp="0.7"'))
    with pytest.raises(codegen.ModelError, match="that would not follow a parameter"):
        codegen.import_model(path, parameterize="a:mass")
    assert "a_length" in codegen.import_model(path, parameterize="a:length").text


def test_a_robot_yaml_is_for_urdf(tmp_path):
    (tmp_path / "robot.yaml").write_text("closed_loop: []\n")
    path = tmp_path / "arm.xml"
    path.write_text(text_of())
    with pytest.raises(codegen.ModelError, match=r"robot.yaml:1:1: Gepetto's robot.yaml is for URDF"):
        codegen.import_model(path, loops=tmp_path / "robot.yaml")


def test_joints_without_names_have_their_lines(tmp_path):
    path = tmp_path / "arm.xml"
    inner = '<body><joint frictionloss="1"/><geom size=".1" pos=".2 0 0"/></body>'
    bodies = f'<body>\n<geom size=".1" pos=".3 0 0"/>\n{inner}\n<joint range="0 1"/></body>'
    path.write_text(f'<mujoco><option density="1000"/><worldbody>{bodies}</worldbody></mujoco>')
    left = codegen.import_model(path).left_out
    assert left[0].startswith("frictionloss of a joint (line 3)") and "density of the medium (line 1)" in left[1]
    assert any(line.startswith("range of a joint (line 4)") for line in left)
    assert any(line.startswith("contacts of geoms (lines 2, 3)") for line in left)


def test_what_mujoco_names_is_found(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text('<mujoco>\n<worldbody>\n<body name="light one"><joint/></body></worldbody></mujoco>')
    with pytest.raises(codegen.ModelError, match=r"arm.xml:3:1: MuJoCo cannot compile it: .*'light one'"):
        codegen.import_model(path)


def test_options_that_would_do_nothing_are_refused(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(text_of())
    for option, value in (("model", "x"), ("base", "free"), ("exact_angles", True)):
        with pytest.raises(
            codegen.ModelError, match=f"arm.xml:1:1: --{option.replace('_', '-')}.* is for .* leave it out"
        ):
            codegen.import_model(path, **{option: value})
    for option, value in (("package_paths", ["x"]), ("base", "free"), ("exact_angles", True)):
        with pytest.raises(codegen.ModelError, match=f"MjModel: {option}: applies to files only"):
            codegen.from_mujoco(mujoco.MjModel.from_xml_path(str(path)), **{option: value})


@pytest.mark.parametrize("text", ['<include file="{}"/>', '<asset><model name="m" file="{}"/></asset>'])
def test_long_chains_of_files_are_refused(tmp_path, text):
    nested, ends = "<frame>" * 90, "</frame>" * 90
    for k in range(80):
        other = text.format(f"c{k + 1}.xml")
        inner = f"<worldbody>{nested}{other}{ends}</worldbody>" if "include" in text else other
        (tmp_path / f"c{k}.xml").write_text(f"<mujoco>{inner}</mujoco>")
    (tmp_path / "c80.xml").write_text(CHILD)
    with pytest.raises(codegen.ModelError, match="more than 50 files include each other; use fewer"):
        codegen.import_model(tmp_path / "c0.xml")
