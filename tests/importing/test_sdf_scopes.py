"""Nested models of SDF, includes, frames and versions, against numbers from Drake for the same files."""

import os

import numpy as np
import pytest

import codegen
from codegen.cli import main
from codegen.reference import RecursiveEngine

LINK = """<link name="{name}"><pose{how}>{pose}</pose><inertial><pose>0 0 .2 0 0 0</pose><mass>2</mass>
<inertia><ixx>.02</ixx><iyy>.02</iyy><izz>.002</izz></inertia></inertial></link>
"""
HINGE = """<joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child>
<axis><xyz>0 1 0</xyz>{more}</axis></joint>
"""


def link(name, pose="0 0 0 0 0 0", how=""):
    return LINK.format(name=name, pose=pose, how=how)


def hinge(name, parent, child, more=""):
    return HINGE.format(name=name, parent=parent, child=child, more=more)


ARM = link("a") + link("b", "0 0 .4 0 0 0") + hinge("j1", "world", "a") + hinge("j2", "a", "b")


def sdf(text, version="1.11"):
    return f'<sdf version="{version}">\n{text}</sdf>\n'


def model(text=ARM, attributes="", name="m"):
    return f'<model name="{name}"{attributes}>{text}</model>\n'


def world(text):
    return f'<world name="w"><gravity>0 0 -9.81</gravity>{text}</world>\n'


def imported(tmp_path, text, **options):
    path = tmp_path / "robot.sdf"
    path.write_text(text)
    return codegen.import_model(path, **options)


def numbers(found):
    """Mass matrix and gravity forces at zero coordinates, as Drake computes them."""
    engine = RecursiveEngine(found.model)
    zero = np.zeros(found.model.nu)
    matrix = engine.mass_matrix(zero)
    return matrix.round(5).tolist(), (matrix @ engine.accelerations(zero, zero)).round(4).tolist()


STRAIGHT = [[0.84, 0.26], [0.26, 0.1]]
TURNED = model(
    link("a", "0 0 0 90 0 0", ' degrees="true"') + link("b", "0 0 .4 0 30 0", ' degrees="true" relative_to="a"')
    + hinge("j1", "world", "a") + hinge("j2", "a", "b")
)  # fmt: skip
BASE = "<collision name='c'><pose>0 0 .3 0 0 0</pose><density>500</density><geometry>{}</geometry></collision>"
BOX = "<box><size>.1 .2 .4</size></box>"
DRAKE = {
    "versions are compared as such": (sdf(TURNED), [[0.79713, 0.23856], [0.23856, 0.1]], [0, 0]),
    "a quaternion": (
        sdf(model(
            link("a", "0 0 0 0 0.3826834323650898 0 0.9238795325112867", ' rotation_format="quat_xyzw"')
            + link("b", "0 0 .4 0 0 0") + hinge("j1", "world", "a") + hinge("j2", "a", "b")
        )), [[0.84, 0.26], [0.26, 0.1]], [2.7747, 0],
    ),
    "placement_frame": (
        sdf(model(
            "<pose>0 0 1 0.3 0.5 0</pose>" + link("a", "0 0 0 0.7 0 0") + link("b", "0 0 .4 0 0 0")
            + hinge("j1", "world", "a") + hinge("j2", "a", "b"), ' placement_frame="a"',
        )), [[0.53372, 0.19886], [0.19886, 0.1]], [6.1979, 1.8813],
    ),
    "a frame of the world": (
        sdf(world('<frame name="F"><pose>0 0 1 1.5707963267948966 0 0</pose></frame>' + model('<pose relative_to="F"/>' + ARM))),
        STRAIGHT, [0, 0],
    ),
    "a frame as the parent": (
        sdf(model(
            link("a") + link("b", "0 0 .4 0 0 0") + '<frame name="tip" attached_to="a"><pose>0 0 .4 0 0 0</pose></frame>'
            + hinge("j1", "world", "a") + hinge("j2", "tip", "b")
        )), STRAIGHT, [0, 0],
    ),
    "an inertia of collisions": (
        sdf(model(f'<link name="a"><inertial auto="true"/>{BASE.format(BOX)}</link>' + hinge("j1", "world", "a"))),
        [[0.41667]], [0],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", DRAKE)
def test_numbers_are_those_of_drake(tmp_path, name):
    text, matrix, weight = DRAKE[name]
    found = imported(tmp_path, text)
    ours = numbers(found)
    np.testing.assert_allclose(ours[0], matrix, atol=1.1e-5)
    np.testing.assert_allclose(ours[1], weight, atol=1.1e-4)
    assert not found.differences


@pytest.mark.parametrize("version", ["1.10", "1.11", "1.12"])
def test_versions_after_1_9_have_axes_in_joints(tmp_path, version):
    new, old = (imported(tmp_path, sdf(TURNED, v)) for v in (version, "1.9"))
    assert new.text == old.text


# ---- models within models ------------------------------------------------------------------------------------------------


@pytest.fixture
def parts(tmp_path):
    (tmp_path / "hand").mkdir()
    (tmp_path / "hand" / "model.config").write_text(
        '<model><name>hand</name><sdf version="1.5">old.sdf</sdf><sdf version="1.10">new.sdf</sdf></model>'
    )
    hand = model(link("palm") + link("tip", "0 0 .4 0 0 0") + hinge("k", "palm", "tip"), name="hand")
    (tmp_path / "hand" / "new.sdf").write_text(sdf(hand, "1.10"))
    (tmp_path / "hand" / "old.sdf").write_text("<sdf/>")
    return tmp_path


def flat(tmp_path, at="0 0 .4"):
    tip = "0 0 .8" if at == "0 0 .4" else "0 0 1"
    return imported(
        tmp_path,
        sdf(model(
            link("a") + link("palm", f"{at} 0 0 0") + link("tip", f"{tip} 0 0 0") + hinge("j", "world", "a")
            + hinge("n", "a", "palm") + hinge("k", "palm", "tip")
        )),
    )  # fmt: skip


def same(found, right):
    rng = np.random.default_rng(3)
    q, u = rng.normal(size=(2, right.model.nu))
    ours, theirs = (RecursiveEngine(f.model).accelerations(q, u) for f in (found, right))
    np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(
    ("part", "palm"),
    [
        ("<model name='hand'><pose>0 0 .4 0 0 0</pose>{inner}</model>", "hand::palm"),
        ("<include><uri>hand</uri><pose>0 0 .4 0 0 0</pose></include>", "hand::palm"),
        (
            "<include><uri>model://hand</uri><name>left</name><pose relative_to='a'>0 0 .4 0 0 0</pose></include>",
            "left::palm",
        ),
        ("<include merge='true'><uri>hand/new.sdf</uri><pose>0 0 .4 0 0 0</pose></include>", "palm"),
        (
            "<include><uri>hand</uri><placement_frame>tip</placement_frame><pose>0 0 .8 0 0 0</pose></include>",
            "hand::palm",
        ),
        (
            "<model name='outer'><include><uri>hand</uri><pose>0 0 .4 0 0 0</pose></include></model>",
            "outer::hand::palm",
        ),
    ],
    ids=["model", "include", "named", "merged", "placed", "two deep"],
)
def test_a_hand_is_the_same_in_any_place(parts, part, palm):
    inner = link("palm") + link("tip", "0 0 .4 0 0 0") + hinge("k", "palm", "tip")
    text = link("a") + part.format(inner=inner) + hinge("j", "world", "a") + hinge("n", "a", palm)
    found = imported(parts, sdf(model(text)))
    assert palm in found.bodies and not found.left_out
    same(found, flat(parts))


def test_an_include_of_a_world_has_its_pose_and_name(parts):
    inner = "<include><uri>hand</uri><name>left</name><pose>0 0 1 1.5707963267948966 0 0</pose>{}</include>"
    found = imported(parts, sdf(world(inner.format(""))))
    assert found.model.name == "left" and "left" not in found.bodies
    q = found.text.partition("q: {palm: [")[2].partition("]")[0].split(", ")
    np.testing.assert_allclose([float(v) for v in q], [0, 0, 1, np.sqrt(0.5), np.sqrt(0.5), 0, 0], atol=1e-15)
    for word in ("true", "True", "1"):
        still = imported(parts, sdf(world(inner.format(f"<static>{word}</static>"))))
        assert [b.name for b in still.model.bodies] == ["tip"] and "a static model does not move" in still.warnings[0]


TWO = model(ARM, name="left") + model(ARM, name="right")


def test_one_of_several_models_is_chosen(tmp_path, monkeypatch, capsys):
    text = sdf(world(TWO + model("<static>1</static>" + link("plane"), name="ground")))
    with pytest.raises(
        codegen.ModelError,
        match=r"robot.sdf:\d+:\d+: 2 models move and no joint connects them: 'left', 'right'; only one",
    ):
        imported(tmp_path, text)
    for name in ("left", "right"):
        found = imported(tmp_path, text, model=name)
        assert found.model.name == name and found.model.nu == 2
    assert any(line.startswith("another <model> (line") and "--model left reads it" in line for line in found.left_out)
    with pytest.raises(codegen.ModelError, match="--model lft is not a model; models are left, right, ground"):
        imported(tmp_path, text, model="lft")
    monkeypatch.chdir(tmp_path)
    assert main(["import", "robot.sdf", "--model", "right", "-o", "-"]) == 0
    assert "model: right" in capsys.readouterr().out


def test_a_model_of_a_further_world_is_chosen(tmp_path):
    second = world(model(ARM, name="right")).replace('"w"', '"v"')
    text = sdf(world(model(ARM, name="left")) + second)
    assert imported(tmp_path, text).model.name == "left"
    for name in ("right", "v"):
        found = imported(tmp_path, text, model=name)
        assert found.model.name == "right" and any(
            line.startswith("a further <world> (line 2)") for line in found.left_out
        )


def test_versions_that_are_not_known_are_a_warning(tmp_path):
    for version, words in (("1.13", "'1.13'; versions up to 1.12 are known"), ("x", "'x'; read as 1.0, in which axes")):
        assert words in imported(tmp_path, sdf(model(), version)).warnings[0]
    assert "is left out; read as 1.0" in imported(tmp_path, sdf(model()).replace(' version="1.11"', "")).warnings[0]


def test_a_joint_of_the_world_holds_models_together(tmp_path):
    bars = link("a") + link("b", "0 0 .4 0 0 0") + hinge("j", "a", "b")
    hold = (
        hinge("hold", "world", "left::a")
        + '<joint name="weld" type="fixed"><parent>left::b</parent><child>right</child></joint>'
    )
    right = model("<pose relative_to='left'>0 0 .8 0 0 0</pose>" + bars, name="right")
    found = imported(tmp_path, sdf(world(model(bars, name="left") + right + hold)))
    assert [b.joint.type for b in found.model.bodies] == ["revolute"] * 3 and found.model.name == "w"
    alone = imported(tmp_path, sdf(world(model(bars, name="left") + hinge("hold", "world", "left::a"))))
    assert set(alone.bodies) == {"", "a", "b"} or set(alone.bodies) == {"a", "b"}
    assert alone.model.nu == 2 and "joint: {type: revolute, axis: y}  # hold" in alone.text


def test_joints_that_mimic_follow(tmp_path):
    mimic = "<mimic joint='{}'><multiplier>2</multiplier><offset>0.1</offset><reference>0.3</reference></mimic>"
    text = link("a") + link("b", "0 0 .4 0 0 0") + hinge("j1", "world", "a")
    found = imported(tmp_path, sdf(model(text + hinge("j2", "a", "b", mimic.format("j1")))))
    assert "{joint: b, follows: {a: 2}, offset: -0.5}" in found.text
    drakes = hinge("j2", "a", "b").replace("</joint>", '<drake:mimic joint="j1" multiplier="3" offset="1"/></joint>')
    assert "{joint: b, follows: {a: 3}, offset: 1}" in imported(tmp_path, sdf(model(text + drakes))).text
    with pytest.raises(codegen.ModelError, match="joint 'j2' follows 'jx', which is not a joint of this file"):
        imported(tmp_path, sdf(model(text + hinge("j2", "a", "b", mimic.format("jx")))))


def test_rotors_of_drake_are_armatures(tmp_path):
    rotor = "<drake:rotor_inertia>0.002</drake:rotor_inertia><drake:gear_ratio>10</drake:gear_ratio></joint>"
    found = imported(tmp_path, sdf(model(link("a") + hinge("j", "world", "a").replace("</joint>", rotor))))
    assert "armature: 0.2" in found.text and not found.left_out


def test_a_link_without_gravity_is_carried(tmp_path):
    text = link("a") + link("b", "0 0 .4 0 0 0").replace("<inertial>", "<gravity>false</gravity><inertial>")
    found = imported(tmp_path, sdf(model(text + hinge("j1", "world", "a") + hinge("j2", "a", "b"))))
    assert "b_lift: {type: force, on: b_com, value: [0, 0, 19.62]}" in found.text


def test_switches_that_are_off_have_no_effect(tmp_path):
    off = "<kinematic>0</kinematic><velocity_decay><linear>0.0</linear></velocity_decay><self_collide>False</self_collide>"
    text = ARM.replace("<inertial>", f"{off}<inertial>", 1)
    assert not imported(tmp_path, sdf(world("<wind/>" + model(text)))).differences
    on = text.replace("<kinematic>0", "<kinematic>true").replace("0.0<", "0.1<")
    found = imported(tmp_path, sdf(world("<wind><linear_velocity>0 0 1</linear_velocity></wind>" + model(on))))
    assert [line.partition(" (")[0] for line in found.differences] == ["<wind>", "<kinematic>", "<velocity_decay>"]


# ---- what is wrong -------------------------------------------------------------------------------------------------------

AUTO = '<link name="a"><inertial auto="true"/>{}</link>'
CIRCLE = '<frame name="f" attached_to="g"/><frame name="g" attached_to="f"/>'
MESH = "<mesh><uri>x.stl</uri></mesh>"
WRONG = [
    (model(AUTO.format(BASE.format(MESH))), "line 2 with a collision of 'mesh'; box, cylinder,"),
    (model(AUTO.format("")), '<inertial auto="true"> of a link without <collision>; write <mass>'),
    (model(ARM, ' placement_frame="x"'), "frame 'x' is not in this file; known are __model__, a, b, j1, j2"),
    (model(ARM + CIRCLE + hinge("k", "f", "b")), "is attached to itself"),
    (model(ARM + "<include><uri>robot.sdf</uri></include>"), "files include each other in a circle"),
    (model(ARM + "<include><uri>nowhere</uri></include>"), "<include> of 'nowhere': file not found"),
    (model(ARM + "<include><uri>pipe.sdf</uri></include>"), "<include> of 'pipe.sdf': not read: it is a named pipe"),
    (model(ARM + "<include><uri>../elsewhere</uri></include>"), "outside the folder of the robot's file; --package-path"),
    (model(ARM + "<include><uri>file://{above}/elsewhere/model.sdf</uri></include>"), "outside the folder of the robot's file"),
    (model(ARM + "<include><uri>model://../elsewhere</uri></include>"), "outside the folder of the robot's file"),
    (model(ARM + "<include><uri>link.sdf</uri></include>"), "outside the folder of the robot's file"),
    (model(ARM + "<include><uri>arm.urdf</uri></include>"), "its root element is <robot>; give an SDF file"),
    (model(ARM.replace("<pose>", '<pose rotation_format="euler">', 1)), "rotation_format 'euler' is unknown; euler_rpy"),
    (model(ARM.replace("<pose>0", '<pose rotation_format="quat_xyzw">0', 1)), "the text of <pose> is '0 0 0 0 0 0'; 7 numbers"),
    (model(link("world")), "name 'world' is reserved in SDF; choose one without :: and __"),
    (model(link("a::b")), "name 'a::b' is reserved in SDF"),
    (model(ARM + model("", name="m2") + hinge("k", "m2", "a")), "model 'm2' has no link to which its frame could belong"),
    (world(model(ARM) + hinge("k", "m::x", "m::a")), "link or frame 'x' is not in this file; known are __model__, a, b"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), WRONG, ids=range(len(WRONG)))
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, message):
    folder, other = tmp_path / "robot", tmp_path / "elsewhere"
    folder.mkdir(), other.mkdir()
    (other / "model.sdf").write_text(sdf(model()))
    os.symlink(other / "model.sdf", folder / "link.sdf")
    os.mkfifo(folder / "pipe.sdf")
    (folder / "arm.urdf").write_text("<robot/>")
    with pytest.raises(codegen.ModelError) as error:
        imported(folder, sdf(text.replace("{above}", str(tmp_path))))
    assert message in str(error.value), error.value
    assert all(p.line for p in error.value.problems)
    if "elsewhere" in text or "link.sdf" in text:
        named = text.replace("{above}", str(tmp_path)).replace("<uri>", "<name>n</name><uri>")
        assert imported(folder, sdf(named), package_paths=[other]).model.nu == 4


def test_includes_without_end_are_refused(tmp_path):
    for k in range(7):
        inner = "".join(f"<include><uri>p{k + 1}.sdf</uri><name>n{i}</name></include>" for i in range(8))
        (tmp_path / f"p{k}.sdf").write_text(sdf(model(link("a") + inner)))
    (tmp_path / "p7.sdf").write_text(sdf(model()))
    with pytest.raises(codegen.ModelError, match="more than 1000 models; read a smaller part"):
        imported(tmp_path, sdf(model("<include><uri>p0.sdf</uri></include>")))


def test_long_chains_of_files_and_models_are_refused(tmp_path):
    for k in range(400):
        inner = f"<include><uri>c{k + 1}.sdf</uri><name>n</name></include>"
        (tmp_path / f"c{k}.sdf").write_text(sdf(model(link("a") + inner)))
    deep = "".join(f'<model name="n{k}">' for k in range(60)) + link("a") + "</model>" * 60
    merged = "<include merge='true'><uri>c0.sdf</uri></include>"
    for text in (model("<include><uri>c0.sdf</uri></include>"), model(merged), model(deep)):
        with pytest.raises(codegen.ModelError, match="more than 30 nested models; use fewer"):
            imported(tmp_path, sdf(text))


FINGER = link("a") + link("b", "0 0 .4 0 0 0") + hinge("bend", "a", "b")
"""An arm without a joint to the world."""


def test_a_model_within_a_model_is_chosen(tmp_path):
    """With nothing of the outer one, where no joint holds it there; as it stands in the world."""
    inner = model("<pose>0 0 1 0 .3 0</pose>" + ARM, name="arm")
    text = sdf(world(model(inner + link("base") + hinge("turn", "world", "base"), name="robot") + model(name="m")))
    found = imported(tmp_path, text, model="robot::arm")
    alone = imported(tmp_path, sdf(world(inner)))
    assert found.model.name == "arm" and [b.name for b in found.model.bodies] == ["a", "b"]
    assert numbers(found) == numbers(alone)
    assert any("the rest of a <model>" in line and "--model robot reads it whole" in line for line in found.left_out)
    assert any("another <model>" in line and "--model m reads it" in line for line in found.left_out)
    with pytest.raises(codegen.ModelError, match="models are robot, m, robot::arm; did you mean robot::arm"):
        imported(tmp_path, text, model="arm")


def test_joints_of_outer_models_hold_a_model_that_is_chosen(tmp_path):
    """To the world, where it is read alone; to another model, which is read with it then."""
    inner = model("<pose>0 0 1 0 .3 0</pose>" + FINGER, name="finger")
    spare = model(FINGER, name="spare")
    to_world = hinge("hold", "world", "finger::a", "<dynamics><damping>2</damping></dynamics>")
    found = imported(tmp_path, sdf(world(model(inner + spare + to_world, name="hand"))), model="hand::finger")
    flat = model("<pose>0 0 1 0 .3 0</pose>" + FINGER + hinge("hold", "world", "a"), name="finger")
    assert [b.name for b in found.model.bodies] == ["a", "b"]
    assert "value: -2*u.a}" in found.text
    assert numbers(found) == numbers(imported(tmp_path, sdf(world(flat))))

    palm = link("palm") + hinge("wrist", "world", "palm")
    held = model(inner + spare + palm + hinge("hold", "palm", "finger::a"), name="hand")
    found = imported(tmp_path, sdf(world(held)), model="hand::finger")
    assert found.model.name == "hand" and [b.name for b in found.model.bodies] == ["palm", "finger_a", "finger_b"]
    assert any("--model hand::spare reads it" in line for line in found.left_out)


def test_a_chosen_model_follows_joints_of_its_own_in_outer_models(tmp_path):
    """A joint of the world that mimics one of the chosen model, and gravity of a model that is turned."""
    turn = hinge("hold", "world", "finger::a", "<mimic joint='finger::bend'><multiplier>2</multiplier></mimic>")
    found = imported(tmp_path, sdf(world(model(FINGER, name="finger") + turn)), model="finger")
    assert "a_mimic: {joint: a, follows: {b: 2}}" in found.text
    inner = model(model(FINGER, name="finger") + turn, name="hand")
    again = imported(tmp_path, sdf(world(inner)), model="hand::finger")
    assert found.text.partition("bodies:")[2] == again.text.replace("hand::", "").partition("bodies:")[2]


def test_problems_of_models_that_are_not_read_do_not_stop_the_chosen_one(tmp_path):
    wrong = model(model(name="inner") + link("c") + hinge("j", "nothing", "inner::a"), name="other")
    text = sdf(world(model() + wrong))
    assert imported(tmp_path, text, model="m").model.nu == 2
    with pytest.raises(codegen.ModelError, match="'nothing' is not in this file"):
        imported(tmp_path, text, model="other")
    with pytest.raises(codegen.ModelError, match="'nothing' is not in this file"):
        imported(tmp_path, text, model="other::inner")
