"""Faulty files: one message with a line for each fault, and never a traceback or an incomplete file."""

import random
import re
import time

import numpy as np
import pytest
from imported_robots import ARM, joint, link, robot

import codegen
from codegen.importing.mass import nearest_inertia
from codegen.importing.xml_reading import MAX_DEPTH, parse_xml


def problems(tmp_path, text, **options):
    """The messages about a text, one a line, without the folder."""
    path = tmp_path / "robot.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(codegen.ModelError) as error:
        codegen.import_model(path, **options)
    return str(error.value).replace(f"{tmp_path}/", "").splitlines()


BASE, A, B = link("base"), link("a"), link("b")

WRONG = [
    ("", "robot.urdf:1:1: the file is empty; a URDF, MJCF or SDF file is needed"),
    ("<robot>\n<link name='a'>\n</robot>", "robot.urdf:3:3: this is not XML: mismatched tag"),
    ("<robot name=x/>", "robot.urdf:1:13: this is not XML: not well-formed (invalid token)"),
    ("<!DOCTYPE r [\n<!ENTITY a 'b'>]>\n<robot/>", "robot.urdf:1:13: a document type (DOCTYPE)"),
    ("<!DOCTYPE r SYSTEM 'http://x/y.dtd'>\n<robot/>", "a document type (DOCTYPE) is not read, since it can bring entities"),
    ("<robot>&a;</robot>", "robot.urdf:1:8: this is not XML: undefined entity"),
    (b"\xff\xfe\x00", "this is not XML"),
    (b"<?xml version='1.0' encoding='klingon'?><robot/>", "robot.urdf:1:"),
    (b"<robot name='\xe9'/>", "this is not XML"),
    ("<html/>", "robot.urdf:1:1: the root element is <html>; allowed are <robot> (URDF), <mujoco> (MJCF), <sdf> (SDF)"),
    ("<robot name='x'/>", "robot.urdf:1:1: no <link>; a robot has at least one"),
    ("<robot xmlns:xacro='x'>\n<xacro:include filename='x'/></robot>", "robot.urdf:2:1: <xacro:include>: the file is a xacro"),
    (robot(BASE, BASE), "robot.urdf:3:1: link 'base' is already used in line 2; every link needs a different name"),
    (robot("<link/>\n"), 'robot.urdf:2:1: <link> has no name; name="..." is needed'),
    (robot(BASE, A, joint("j", "base", "a"), joint("j", "base", "a")), "robot.urdf:5:1: joint 'j' is already used in line 4"),
    (robot(BASE, A, joint("j", "bse", "a")), "link 'bse' is not in this file; known are base, a; did you mean 'base'?"),
    (robot(BASE, A, '<joint name="j" type="fixed"><child link="a"/></joint>'), "joint 'j' has no parent; <parent link="),
    (robot(BASE, A, joint("j", "base", "a", "hinge")), "joint 'j' is 'hinge'; revolute, continuous, prismatic, fixed,"),
    (robot(BASE, A), "robot.urdf:3:1: link 'a' is not the child of a joint, nor is 'base' in line 2; a robot has one root"),
    (robot(A, B, joint("j", "a", "b"), joint("k", "b", "a")), "every link is the child of a joint: 'b' -> 'a' -> 'b'"),
    (
        robot(BASE, A, B, joint("j", "a", "b"), joint("k", "b", "a")),
        "joints form a circle of links: 'a' -> 'b' -> 'a'; one of them must be the child",
    ),
    (
        robot(BASE, A, joint("j", "base", "a"), joint("k", "base", "a")),
        "robot.urdf:5:1: link 'a' is the child of joint 'k' and of 'j' in line 4; links of a URDF are a tree",
    ),
    (robot(BASE, link("a", -1), joint("j", "base", "a")), "robot.urdf:3:26: the mass is -1; at least 0 kg is needed"),
    (robot(BASE, A, joint("j", "base", "a", axis="0 0 0")), "the axis is 0 0 0, which has no direction"),
    (robot(BASE, A, joint("j", "base", "a", axis="0 1")), "xyz of <axis> is '0 1'; 3 numbers with blanks between them"),
    (robot(BASE, A, joint("j", "base", "a", at="0 nan 1")), "xyz of <origin> holds 'nan'; a finite number such as 0.5"),
    (robot(BASE, A, joint("j", "base", "a", at="0 1e999 1")), "xyz of <origin> holds '1e999'; a finite number"),
    (robot(BASE, A, joint("j", "base", "a", at="0 1_0 1")), "xyz of <origin> holds '1_0'; a finite number"),
    (robot(BASE, A, joint("j", "base", "a", at="${x} 0 0")), "expand the file with xacro first"),
    (robot(BASE, link("a").replace("<mass", "<mas")), "robot.urdf:3:16: <inertial> has no mass; <mass value="),
    (robot(BASE, link("a").replace("ixx", "ixz")), "this is not XML: duplicate attribute"),
    (robot(BASE, re.sub("<inertia .*?/>", "", A), joint("j", "base", "a")), "<inertial> has no inertia; <inertia ixx="),
    (robot(BASE, A.replace('iyy="0.1"', ""), joint("j", "base", "a")), '<inertia> has no iyy; iyy="..." is needed'),
    (robot(BASE, '<link name="a"/>\n', joint("j", "base", "a")), "robot.urdf:4:1: joint 'j' moves nothing: link 'a' and all"),
    (robot(BASE, A, joint("j", "base", "a", "fixed")), "everything is fixed to the ground, so nothing moves; give a link"),
    (
        robot(BASE, A, B, joint("j", "base", "a"), joint("k", "a", "b", "fixed", at="1e200 0 0")),
        "the combined numbers of link 'a' and of links fixed to it are not finite, or above 1e+150",
    ),
    (robot(BASE, link("a", 1, (0, 0, 0)), joint("j", "base", "a")), "no inertia about the axis|point mass about its centre"),
    (
        robot(BASE, A, joint("j", "base", "a", more='<mimic joint="k"/>')),
        "robot.urdf:4:125: joint 'j' follows 'k', which is not a joint of this file",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), WRONG, ids=range(len(WRONG)))
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, message):
    said = problems(tmp_path, text)
    assert any(part in line for line in said for part in message.split("|")), said
    assert all(line.startswith("robot.urdf:") for line in said)


def test_all_problems_of_a_file_come_at_once_in_its_order(tmp_path):
    text = robot(BASE, BASE, "<link/>\n", link("a", -2), joint("j", "base", "c"), joint("k", "base", "a", "hinge"))
    lines = [int(line.split(":")[1]) for line in problems(tmp_path, text)]
    assert lines == [3, 4, 5, 6, 7]


def test_files_that_are_none_are_told(tmp_path):
    for path, message in ((tmp_path / "none.urdf", "No such file"), (tmp_path, "Is a directory")):
        with pytest.raises(codegen.ModelError, match=message):
            codegen.import_model(path)


def test_flags_are_true_or_false(tmp_path):
    for name in ("motors", "repair", "keep_fixed", "free_mimic", "exact_angles"):
        with pytest.raises(ValueError, match=f"^{name} is 'no'; allowed are True and False$"):
            codegen.import_model(tmp_path / "robot.urdf", **{name: "no"})


def test_models_need_no_import(tmp_path):
    path = tmp_path / "press.yaml"
    path.write_text("model: press\n")
    with pytest.raises(
        codegen.ModelError, match=rf"this is not XML: .*; a model file needs no import: ordernm generate {path}"
    ):
        codegen.import_model(path)


def test_texts_and_other_objects_in_place_of_a_path():
    with pytest.raises(
        codegen.ModelError, match=r"^<string>: this is the text of a file; the path of a robot file is needed"
    ):
        codegen.import_model(robot(BASE, A, joint("j", "base", "a")))
    with pytest.raises(TypeError, match=r"^an int is given; the path of a robot file is needed"):
        codegen.import_model(3)


def test_long_names_are_cut_and_digits_are_those_of_numbers(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace("forearm", "f" * 3000).replace('"tool"', f'"{"f" * 3001}"'))
    found = codegen.import_model(path, keep_fixed=True)
    assert max(map(len, found.model.coordinate_names)) <= 210
    path.write_text(ARM.replace('<mass value="2"/>', '<mass value="\u0663"/>'))
    with pytest.raises(codegen.ModelError, match="value of <mass> holds '\u0663'; a finite number"):
        codegen.import_model(path)


def test_depth_and_entities_do_no_harm():
    with pytest.raises(codegen.ModelError, match="levels of nesting"):
        parse_xml("<a>" * (MAX_DEPTH + 1) + "</a>" * (MAX_DEPTH + 1), "x")
    laughs = '<!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><robot name="&b;"/>'
    with pytest.raises(codegen.ModelError, match="a document type"):
        parse_xml(laughs, "x")
    outside = '<!DOCTYPE l [<!ENTITY a SYSTEM "file:///etc/hostname">]><robot>&a;</robot>'
    with pytest.raises(codegen.ModelError, match="a document type"):
        parse_xml(outside, "x")


def test_hostile_files_are_refused_in_linear_time():
    with pytest.raises(codegen.ModelError, match=r"x:1:13: a document type \(DOCTYPE\)"):
        parse_xml("<!DOCTYPE r [<!ATTLIST a x CDATA '" + "d" * 100_000 + "'>]><r>" + "<a/>" * 10_000 + "</r>", "x")

    def seconds(text):
        start = time.process_time()
        parse_xml(text, "x")
        return time.process_time() - start

    for piece in ("words <b/>", "<!-- -- -->", "<b/>"):  # text between elements was once added up
        short, long = (f"<r>{piece * n}</r>" for n in (5_000, 40_000))
        assert min(seconds(long) for _ in range(2)) < 40 * min(seconds(short) for _ in range(3))


# ---- mimic joints, mass and inertia ----------------------------------------------------------------------------------


def test_inertias_that_no_body_has_are_named_and_kept(tmp_path):
    path = tmp_path / "robot.urdf"
    negative, flat = link("a", 1, (0.1, 0.1, -0.01)), link("b", 1, (1, 1, 3))
    path.write_text(robot(BASE, negative, flat, joint("j", "base", "a", axis="1 0 0"), joint("k", "a", "b")))
    found = codegen.import_model(path)
    first, second = (w.replace(f"{tmp_path}/", "") for w in found.warnings)
    assert first.startswith(
        "robot.urdf:3:1: warning: the inertia of link 'a' has the principal moments -0.01, 0.1 and 0.1"
    )
    assert second.startswith("robot.urdf:4:1: warning: the inertia of link 'b' has the principal moments 1, 1 and 3")
    assert (
        "inertia: {xx: 0.1, yy: 0.1, zz: -0.01, check: warn}" in found.text
        and "inertia: {xx: 1, yy: 1, zz: 3}" in found.text
    )
    mended = codegen.import_model(path, repair=True)
    assert "# repaired: the inertia of link 'a'" in mended.text and "check: warn" not in mended.text
    assert [w for w in mended.warnings if not w.endswith("; repaired")] == []
    assert not [w for w in mended.model.warnings if "inertia" in w]


def test_the_repaired_inertia_is_that_of_a_body_and_the_nearest():
    rng = np.random.default_rng(3)
    for _ in range(50):
        wild = rng.normal(size=(3, 3))
        wild = wild + wild.T
        mended = nearest_inertia(wild)
        low, middle, high = np.linalg.eigvalsh(mended)
        assert low >= -1e-14 and low + middle >= high - 1e-14
        np.testing.assert_allclose(nearest_inertia(mended), mended, atol=1e-14)
        points = rng.normal(size=(4, 3))
        body = sum((p @ p * np.eye(3) - np.outer(p, p) for p in points), np.zeros((3, 3)))
        np.testing.assert_allclose(nearest_inertia(body), body, atol=1e-13)

        def second_moments(inertia):
            return 0.5 * np.trace(inertia) * np.eye(3) - inertia

        gap = np.linalg.norm(second_moments(mended) - second_moments(wild))
        assert gap <= np.linalg.norm(second_moments(body) - second_moments(wild)) + 1e-12


def test_joints_that_move_nothing_are_fixed_on_request(tmp_path):
    path = tmp_path / "robot.urdf"
    fingers = '<link name="finger"/>\n<link name="tip"/>\n'
    path.write_text(
        robot(BASE, A, fingers, joint("j", "base", "a"), joint("k", "a", "finger"), joint("l", "finger", "tip"))
    )
    said = problems(tmp_path, path.read_text())
    assert len(said) == 2 and "--repair fixes the joint" in said[0]
    found = codegen.import_model(path, repair=True)
    assert [b.name for b in found.model.bodies] == ["a"] and len(found.warnings) == 2
    assert "# Repaired:\n#   joint 'k' moves nothing: link 'finger' and all outboard links" in found.text
    assert found.bodies["tip"] == "a" and "tip: {body: a, at: [0, 0, 1]}" in found.text


def test_a_point_becomes_a_ball_on_request(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(robot(BASE, link("a", 4.1887902047863905, (0, 0, 0)), joint("j", "base", "a")))
    found = codegen.import_model(path, repair=True)  # 4.19 kg of water have a radius of 0.1 m
    assert float(found.model.bodies[0].inertia[0].value) == pytest.approx(0.4 * 4.1887902047863905 * 0.01)


# ---- texts damaged at random -----------------------------------------------------------------------------------------

SDF = """<sdf version="1.7"><model name="m"><link name="a"><pose>0 0 1 0 0 0</pose><inertial><mass>1</mass><inertia><ixx>1</ixx>
<iyy>1</iyy><izz>1</izz></inertia></inertial></link><link name="b"><pose relative_to="a">0 0 1 0 0 0</pose></link>
<joint name="j" type="revolute"><parent>a</parent><child>b</child><pose>0 0 0 0 0 0</pose><axis><xyz expressed_in="__model__">
0 0 1</xyz><dynamics><damping>1</damping></dynamics></axis></joint><frame name="f" attached_to="b"/></model></sdf>"""

PIECES = [
    "",
    "<",
    ">",
    '"',
    "/",
    "0",
    "-1",
    "1e999",
    "nan",
    "<link name='x'/>",
    "base",
    "forearm",
    "<!--",
    "&",
    "joint",
    "\x00",
    "é",
]


def damaged(text: str, rng: random.Random) -> str:
    """The text with one to three pieces cut out, doubled, or replaced."""
    for _ in range(rng.randint(1, 3)):
        tokens = re.split(r'(<|>|"|\s+)', text)
        k = rng.randrange(len(tokens))
        kind = rng.randrange(4)
        if kind == 0:
            tokens[k] = rng.choice(PIECES)
        elif kind == 1:
            del tokens[k : k + rng.randint(1, 12)]
        elif kind == 2:
            j = k + rng.randint(1, 40)
            tokens[k:k] = tokens[k:j]
        else:
            j = rng.randrange(len(tokens))
            tokens[k], tokens[j] = tokens[j], tokens[k]
        text = "".join(tokens)
    return text


MJCF = """\
<mujoco>
  <option gravity="0 0.5 -9.5"/>
  <worldbody>
    <body name="b" pos="0 0 1">
      <joint name="j" axis="0 1 0" stiffness="1.5" damping="0.5" armature="0.02" springref="0.1" ref="0.25" frictionloss="0.3"/>
      <inertial pos="0 0 0.3" mass="2.5" diaginertia="1.1 1.2 1.3"/>
      <site name="s" pos="0 0 0.5"/>
    </body>
    <body name="c" gravcomp="0.4"><freejoint/><geom type="sphere" size="0.1"/><site name="s2"/></body>
  </worldbody>
  <tendon>
    <spatial name="t" stiffness="1.5" damping="0.1" springlength="0.7"><site site="s"/><site site="s2"/></spatial>
    <fixed name="f" stiffness="2.5" armature="0.01"><joint joint="j" coef="1.5"/></fixed>
  </tendon>
  <actuator>
    <position joint="j" kp="1.5" kv="0.5" gear="2.5"/>
    <general joint="j" biastype="affine" biasprm="1.5 -1 -2" ctrlrange="0.1 0.9"/>
  </actuator>
  <equality>
    <connect body1="b" body2="c" anchor="0.1 0 0" active="false"/>
    <weld body1="b" body2="c" relpose="0.1 0 0 1 0 0 0"/>
  </equality>
  <keyframe><key qpos="0.1 0 0 1 1 0 0 0"/></keyframe>
</mujoco>
"""
"""What MuJoCo compiles may hold numbers that are none."""


@pytest.mark.parametrize("value", ["nan", "inf", "1e300"])
def test_numbers_of_mjcf_that_are_none_are_refused_with_their_element(tmp_path, value):
    pytest.importorskip("mujoco", reason="MuJoCo reads MJCF: pip install mujoco")
    path = tmp_path / "robot.xml"
    elements = {"ref": "joint 'j'", "coef": "tendon 'f'", "springlength": "tendon 't'"}
    elements |= {"gear": "actuator 0", "kp": "actuator 0", "biasprm": "actuator 1", "gravcomp": "body 'c'"}
    elements |= {"relpose": "equality 1", "gravity": "gravity"}
    for key, element in elements.items():
        path.write_text(re.sub(rf'\b{key}="[-\d.]+', f'{key}="{value}', MJCF))
        with pytest.raises(
            codegen.ModelError, match=r"robot\.xml:.*(is -?(nan|inf|[\d.e+]+); finite|MuJoCo)"
        ) as raised:
            codegen.import_model(path)
        assert element in str(raised.value) or "MuJoCo cannot" in str(raised.value)


NUMBERS = ["0", "-1", "1e-300", "1e308", "-1e160", "1e149", "1e-16", "3.14159", "7", "", "-0", "123456789"]


@pytest.mark.parametrize("source", [ARM, SDF, MJCF], ids=["urdf", "sdf", "mjcf"])
@pytest.mark.filterwarnings("error")
def test_numbers_of_any_size_are_read_or_refused(tmp_path, source):
    if source is MJCF:
        pytest.importorskip("mujoco", reason="MuJoCo reads MJCF: pip install mujoco")
    rng = random.Random(8)
    path, read, draws = tmp_path / "robot.xml", 0, 60 if source is MJCF else 300
    places = list(re.finditer(r"(?<![\w.])-?\d+\.?\d*(?![\w.])", source))
    for k in range(draws):
        text = source
        for place in sorted(rng.sample(places, rng.randint(1, 4)), key=lambda p: -p.start()):
            text = text[: place.start()] + rng.choice(NUMBERS) + text[place.end() :]
        path.write_text(text)
        try:
            codegen.import_model(path, repair=k % 2 == 0, keep_fixed=k % 3 == 0, exact_angles=k % 5 == 0)
        except codegen.ModelError as error:
            assert all(p.message for p in error.problems)
        else:
            read += 1
    assert draws / 8 < read < 0.93 * draws  # both happen


@pytest.mark.parametrize("source", [ARM, SDF], ids=["urdf", "sdf"])
def test_damaged_files_are_read_or_refused(tmp_path, source):
    rng = random.Random(7)
    path, read = tmp_path / "robot.urdf", 0
    for k in range(400):
        path.write_bytes(damaged(source, rng).encode("utf-8", "replace"))
        try:
            found = codegen.import_model(path, repair=k % 2 == 0, keep_fixed=k % 3 == 0)
        except codegen.ModelError as error:
            assert all(p.message and p.file for p in error.problems)
        else:
            read += 1
            assert codegen.parse_model(found.text).nu == found.model.nu
    assert 5 < read < 395  # both happen
