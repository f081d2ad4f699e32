"""SDF: poses, frames and axes in all notations, and joints that close loops."""

import numpy as np
import pytest

import codegen
from codegen.importing.spanning import Edge, spanning_tree
from codegen.model import parse_model

LINK = """\
<link name="{name}"><pose>{pose}</pose><inertial><pose>{at} 0 0 0</pose><mass>1</mass>
<inertia><ixx>0.02</ixx><iyy>0.02</iyy><izz>0.001</izz></inertia></inertial></link>
"""
JOINT = """\
<joint name="{name}" type="{type}">
<parent>{parent}</parent><child>{child}</child>{pose}<axis><xyz{how}>{axis}</xyz>{more}</axis></joint>
"""


def link(name, pose="0 0 0 0 0 0", at="0 0 0.25"):
    return LINK.format(name=name, pose=pose, at=at)


def joint(name, parent, child, type="revolute", axis="0 1 0", pose="", how="", more=""):
    pose = f"<pose>{pose}</pose>" if pose else ""
    return JOINT.format(name=name, type=type, parent=parent, child=child, axis=axis, pose=pose, how=how, more=more)


def sdf(*parts, version="1.7", more=""):
    return f'<sdf version="{version}">\n<model name="robot">{more}\n{"".join(parts)}</model>\n</sdf>\n'


def imported(tmp_path, text, **options):
    path = tmp_path / "robot.sdf"
    path.write_text(text)
    return codegen.import_model(path, **options)


def accelerations(model, folder, q, u):
    codegen.generate(model, folder / model.name, target="numpy")
    solver = codegen.load(folder / model.name)
    q, u = solver.assemble(q, u) if model.loops else (q, u)
    return solver.accelerations(q, u)


BARS = """
model: {name}
gravity: [0, 0, -9.81]
bodies:
  crank: {{parent: ground, joint: {{type: revolute, axis: y, at: [0, 0, 1]}}, mass: 1, com: [0, 0, 0.25],
          inertia: &i {{xx: 0.02, yy: 0.02, zz: 0.001}}}}
  coupler: {{parent: crank, joint: {{type: revolute, axis: y, at: [0, 0, 0.5]}}, mass: 1, com: [0, 0, 0.25], inertia: *i}}
  rocker: {{parent: coupler, joint: {{type: revolute, axis: y, at: [0, 0, 0.5]}}, mass: 1, com: [0, 0, 0.25], inertia: *i}}
forces:
  crank: {{type: joint, joint: crank, value: -2*(q.crank - 0.5) - 0.25*u.crank}}
"""
FOOT = """
loops:
  foot: {joint: {type: revolute, axis: y}, from: {body: rocker, at: [0, 0, 0.5]}, to: {body: ground, at: [0.6, 0, 1]}}
"""
IN_MODEL = "<use_parent_model_frame>1</use_parent_model_frame>"
SPRING = "<spring_stiffness>2</spring_stiffness><spring_reference>0.5</spring_reference>"
DYNAMICS = f"<dynamics><damping>0.25</damping>{SPRING}</dynamics>"


@pytest.mark.parametrize(
    "text",
    [
        sdf(
            link("crank", "0 0 1 0 0 0"), link("coupler", "0 0 1.5 0 0 0"), link("rocker", "0 0 2 0 0 0"),
            joint("j1", "world", "crank", more=DYNAMICS), joint("j2", "crank", "coupler"), joint("j3", "coupler", "rocker"),
        ),
        sdf(  # poses relative to others, axes in other frames, frames with names
            link("crank", "0 0 1 0 0 0"), link("coupler").replace("<pose>0 0 0 0 0 0", '<pose relative_to="up">0 0 0 0 0 0', 1),
            link("rocker").replace("<pose>0 0 0 0 0 0", '<pose relative_to="coupler">0 0 0.5 0 0 0', 1),
            '<frame name="up" attached_to="crank"><pose>0 0 0.5 0 0 0</pose></frame>\n',
            '<frame name="side"><pose degrees="true">0 0 0 0 0 90</pose></frame>\n',
            joint("j1", "world", "crank", more=DYNAMICS),
            joint("j2", "crank", "coupler", axis="1 0 0", how=' expressed_in="side"'),
            joint("j3", "coupler", "rocker", axis="0 0 2", pose="0 0 0 -1.5707963267948966 0 0"),
        ),
        sdf(  # the old ways
            link("crank", "0 0 1 0 0 0"), link("coupler", "0 0 1.5 0 0 0"), link("rocker", "0 0 2 0 0 0"),
            joint("j1", "world", "crank", more=f"{IN_MODEL}{DYNAMICS}", pose="0 0 0 1 0 0"),
            joint("j2", "crank", "coupler"), joint("j3", "coupler", "rocker"), version="1.5",
        ),
        sdf(  # links with frames away from their joints
            link("crank", "0 0 1.1 0 0 0", "0 0 0.15"), link("coupler", "0.2 0 1.5 0 0 1.5707963267948966", "0 0.2 0.25"),
            link("rocker", "0 0 2.5 3.141592653589793 0 0"),
            joint("j1", "world", "crank", pose="0 0 -0.1 0 0 0", more=DYNAMICS),
            joint("j2", "crank", "coupler", axis="1 0 0", pose="0 0.2 0 0 0 0"),
            joint("j3", "coupler", "rocker", axis="0 -1 0", pose="0 0 0.5 0 0 0"),
        ),
        sdf(  # joints that are written from child to parent
            link("rocker", "0 0 2 0 0 0"), link("coupler", "0 0 1.5 0 0 0"), link("crank", "0 0 1 0 0 0"),
            joint("j1", "crank", "world", axis="0 -1 0", pose="0 0 1 0 0 0", more=DYNAMICS),
            joint("j2", "coupler", "crank", axis="0 -1 0", pose="0 0 0.5 0 0 0"),
            joint("j3", "rocker", "coupler", axis="0 -1 0", pose="0 0 0.5 0 0 0"),
        ),
    ],
    ids=["plain", "frames", "old", "away", "backwards"],
)  # fmt: skip
def test_poses_and_axes_mean_what_they_mean_in_sdf(tmp_path, text):
    found = imported(tmp_path, text)
    q, u = np.array([0.3, -0.8, 1.1]), np.array([0.5, -1.0, 0.7])
    right = accelerations(parse_model(BARS.format(name="bars")), tmp_path, q, u)
    order = [[b.name for b in found.model.bodies].index(n) for n in ("crank", "coupler", "rocker")]
    here = accelerations(found.model, tmp_path, q[np.argsort(order)], u[np.argsort(order)])[order]
    np.testing.assert_allclose(here, right, rtol=1e-11)


def test_joints_beyond_the_tree_close_loops(tmp_path):
    bars = [link("crank", "0 0 1 0 0 0"), link("coupler", "0 0 1.5 0 0 0"), link("rocker", "0 0 2 0 0 0")]
    joints = [
        joint("j1", "world", "crank", more=DYNAMICS),
        joint("j2", "crank", "coupler"),
        joint("j3", "coupler", "rocker"),
    ]
    foot = '<joint name="foot-joint" type="{}"><parent>rocker</parent><child>world</child><pose>0.6 0 1 0 0 0</pose>{}</joint>\n'
    found = imported(tmp_path, sdf(*bars, *joints))
    assert not found.model.loops
    # a face is where the joint stands in the file's pose: there the loop would have to be closed already
    closed = [
        link("crank", "0 0 1 0 0.4 0"), link("coupler", "0.19470917115432526 0 1.4605304970014426 0 1.2 0"),
        link("rocker", "0.6607287145164583 0 1.6417093744338626 0 2.8 0"),
    ]  # fmt: skip
    found = imported(tmp_path, sdf(*closed, *joints, foot.format("revolute", "<axis><xyz>0 1 0</xyz></axis>")))
    assert "foot_joint:\n    joint: {type: revolute, axis: y}\n    from: {body: rocker, at: [" in found.text
    assert "    to: {body: ground, at: [0.6, 0, 1]" in found.text
    ball = imported(tmp_path, sdf(*closed, *joints, foot.format("ball", "")))
    assert "joint: {type: point}" in ball.text
    same = parse_model((BARS.format(name="bars") + FOOT).replace("at: [0, 0, 0.5]}, to", f"{_rocker_end(found)}}}, to"))
    q = np.array([0.4, 0.8, 1.6])  # of the hand-built one, whose zero is the straight chain
    right = accelerations(same, tmp_path, q, [1.0, 0, 0])
    here = accelerations(shifted(found), tmp_path, np.zeros(3), [1.0, 0, 0])
    np.testing.assert_allclose(here, right, rtol=1e-9, atol=1e-9)


def _rocker_end(found):
    line = next(s for s in found.text.splitlines() if "from: {body: rocker" in s)
    return line.partition(", at: ")[2].partition("]")[0].join(("at: ", "]"))


def shifted(found):
    """The model whose spring pulls to where that of the hand-built one does: its zero is 0.4 rad away."""
    return parse_model(found.text.replace("model: robot", "model: closed").replace("q.crank - 0.5", "q.crank - 0.1"))


def test_what_nothing_carries_moves_freely_unless_it_is_static(tmp_path):
    parts = link("base", "0 0 1 0 0 1.5707963267948966"), link("arm", "0 0 1.5 0 0 0"), joint("j", "base", "arm")
    found = imported(tmp_path, sdf(*parts, more="<pose>1 0 0 0 0 0</pose>"))
    assert "  base:\n    parent: ground\n    joint: {type: free}\n" in found.text
    q = found.text.partition("q: {base: [")[2].partition("]")[0].split(", ")
    np.testing.assert_allclose([float(v) for v in q], [1, 0, 1, np.sqrt(0.5), 0, 0, np.sqrt(0.5)], atol=1e-15)
    static = imported(tmp_path, sdf(*parts, more="<static>true</static>"))
    assert [b.name for b in static.model.bodies] == ["arm"]


def test_all_types_of_joints(tmp_path):
    parts = [link("base")]
    axis2 = "</axis><axis2><xyz>1 0 0</xyz></axis2><!--"
    for k, type_ in enumerate(("revolute", "continuous", "prismatic", "fixed", "screw", "universal", "ball")):
        more = "<screw_thread_pitch>0.01</screw_thread_pitch>" if type_ == "screw" else ""
        text = joint(f"j{k}", "base", f"b{k}", type_)
        if type_ == "universal":
            text = text.replace("</axis>", axis2.replace("<!--", ""))
        parts += [link(f"b{k}"), text.replace("</joint>", f"{more}</joint>")]
    found = imported(tmp_path, sdf(*parts))
    types = ["free", "revolute", "revolute", "prismatic", "screw", "universal", "spherical"]
    assert [b.joint.type for b in found.model.bodies] == types
    assert f"pitch: {0.01 / (2 * np.pi)!r}" in found.text and "axes: [y, x]" in found.text


KNUCKLE = """
model: knuckle
gravity: [0, 0, -9.81]
bodies:
  arm: {parent: ground, joint: {type: universal, axes: [y, x], at: [0, 0, 1]}, mass: 1, com: [0, 0, 0.25],
        inertia: {xx: 0.02, yy: 0.02, zz: 0.001}}
forces:
  arm: {type: joint, joint: arm, value: [-2*(q.arm.1 - 0.5) - 0.25*u.arm.1, -0.75*u.arm.2]}
"""


@pytest.mark.parametrize("backwards", [False, True])
def test_springs_and_dampers_of_a_universal_joint_are_those_of_each_axis(tmp_path, backwards):
    """Backwards, the arm is the parent: the joint is read as its inverse, whose first axis is the second one."""
    first = f"<axis><xyz>0 1 0</xyz>{DYNAMICS}</axis>"
    second = "<axis{}><xyz>1 0 0</xyz><dynamics><damping>0.75</damping></dynamics></axis{}>"
    if backwards:
        first = f"<axis2><xyz>0 -1 0</xyz>{DYNAMICS}</axis2>"
        second = second.replace("<xyz>1", "<xyz>-1")
    ends = ("arm", "world") if backwards else ("world", "arm")
    axes = first + second.format(*("", "") if backwards else (2, 2))
    at = "<pose>0 0 1 0 0 0</pose>" if backwards else ""
    text = f'<joint name="j" type="universal"><parent>{ends[0]}</parent><child>{ends[1]}</child>{at}{axes}</joint>'
    found = imported(tmp_path, sdf(link("arm", "0 0 1 0 0 0"), text))
    assert not found.differences
    q, u = np.array([0.3, -0.8]), np.array([0.5, -1.0])
    right = accelerations(parse_model(KNUCKLE), tmp_path, q, u)
    np.testing.assert_allclose(accelerations(found.model, tmp_path, q, u), right, rtol=1e-11)


def test_a_world_gives_its_gravity_and_its_one_model(tmp_path):
    model = f'<model name="m">{link("a")}{joint("j", "world", "a")}</model>'
    ground = f'<model name="ground"><static>1</static>{link("plane")}</model>'
    world = f'<sdf version="1.6"><world name="w"><gravity>0 0 -1.62</gravity><light/>\n{ground}{{}}</world></sdf>'
    found = imported(tmp_path, world.format(model))
    assert "gravity: [0, 0, -1.62]" in found.text and "<light> (line 1): no effect on the dynamics" in found.left_out
    assert (
        "gravity: [0, 0, -9.8]\n"
        in imported(tmp_path, world.format(model).replace("<gravity>0 0 -1.62</gravity>", "")).text
    )
    with pytest.raises(codegen.ModelError, match=r"2 models .* 'm', 'n'; only one can be read: choose it by --model m"):
        imported(tmp_path, world.format(model + model.replace('"m"', '"n"')))
    folder = tmp_path / "arm"
    folder.mkdir()
    (folder / "model.sdf").write_text(f'<sdf version="1.6">{model}</sdf>')
    assert imported(tmp_path, world.format("<include><uri>model://arm</uri></include>")).model.name == "m"
    with pytest.raises(codegen.ModelError, match=r"<include> of 'model://leg': package 'leg' not found"):
        imported(tmp_path, world.format("<include><uri>model://leg</uri></include>"))


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([], "robot.sdf:2:1: no <link>; a model has at least one"),
        ([link("a"), link("a")], "name 'a' is already used in line 3; names in a model must differ"),
        ([link("a"), joint("j", "a", "b")], "link or frame 'b' is not in this file; known are __model__, a"),
        ([link("a"), joint("j", "a", "a")], "joint 'j' joins link 'a' to itself"),
        ([link("a"), link("b"), joint("j", "a", "b", "hinge")], "joint 'j' is 'hinge'; revolute, continuous"),
        ([link("a"), link("b"), joint("j", "a", "b", axis="0 0 0")], "the axis is 0 0 0"),
        ([link("a"), link("b"), joint("j", "a", "b").replace("axis>", "axe>")], "lacks an axis"),
        ([link("a"), link("b"), joint("j", "a", "b", how=' expressed_in="c"')], "frame 'c' is not in this file"),
        ([link("a").replace("<mass>1", "<mass>one")], "the text of <mass> holds 'one'; a finite number"),
        ([link("a").replace("<mass>1", "<mass>-1")], "the mass is -1"),
        ([link("a"), "<model/>"], 'robot.sdf:5:1: <model> has no name; name="..." is needed'),
        ([link("a"), '<model name="a"/>'], "name 'a' is already used in line 3; names in a model must differ"),
        (
            [link("a").replace("<pose>", '<pose relative_to="b">', 1), link("b").replace("<pose>", '<pose relative_to="a">', 1)],
            "depends on itself through others",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_line(tmp_path, parts, message):
    with pytest.raises(codegen.ModelError) as error:
        imported(tmp_path, sdf(*parts))
    assert message in str(error.value)
    assert all(p.line for p in error.value.problems)


def test_gears_are_told_and_left_out_on_request(tmp_path):
    gear = '<joint name="g" type="gearbox"><parent>a</parent><child>b</child></joint>\n'
    text = sdf(link("a"), link("b"), joint("j", "world", "a"), joint("k", "world", "b"), gear)
    with pytest.raises(codegen.ModelError, match="joint 'g' is a gear between links 'a' and 'b', which is not read"):
        imported(tmp_path, text)
    assert imported(tmp_path, text, free_mimic=True).model.nu == 2


GEAR = """\
<joint name="g" type="gearbox"><parent>a</parent><child>b</child><gearbox_ratio>-2.5</gearbox_ratio>
<gearbox_reference_body>{body}</gearbox_reference_body>
<axis><xyz expressed_in="__model__">{axis}</xyz></axis><axis2><xyz expressed_in="__model__">{axis2}</xyz></axis2></joint>
"""


@pytest.mark.parametrize(
    ("axis", "axis2", "sign"), [("0 1 0", "0 1 0", 1), ("0 -1 0", "0 2 0", -1), ("0 1 0", "0 -1 0", -1)]
)
@pytest.mark.parametrize("turned", [False, True])
def test_a_gearbox_is_a_coupling_of_hinges_on_its_reference_body(tmp_path, axis, axis2, sign, turned):
    """theta_b = -ratio theta_a, about the gear's axes; the second hinge is written from its child to its parent, or not."""
    first, second = joint("j", "world", "frame", axis="1 0 0"), joint("k", "frame", "a")
    third = joint("l", "b", "frame") if turned else joint("l", "frame", "b")
    gear = GEAR.format(body="frame", axis=axis, axis2=axis2)
    found = imported(tmp_path, sdf(link("frame"), link("a"), link("b"), first, second, third, gear))
    (coupling,) = found.model.loops
    assert coupling.is_coupling and coupling.name == "g"
    own, other = (found.model.bodies[t.body].name for t in coupling.terms)
    # as a motion: two turns of the parent about y are five of the child, the same way where both axes are the same
    ratio = -float(coupling.terms[1].factor.value)
    about = {b.name: [float(e.value) for e in b.joint.axes[0]] for b in found.model.bodies}
    assert (own, other) == ("b", "a")
    assert ratio * about["b"][1] * about["a"][1] == pytest.approx(2.5 * sign)


def test_a_gearbox_without_hinges_about_its_axes_is_told(tmp_path):
    hinges = joint("j", "world", "a"), joint("k", "world", "b", axis="1 0 0")
    parts = (link("a"), link("b"), *hinges, GEAR.format(body="world", axis="0 1 0", axis2="0 1 0"))
    message = "one of which has no revolute joint about the gear's axis on reference body 'world', which is not"
    with pytest.raises(codegen.ModelError, match=message):
        imported(tmp_path, sdf(*parts))
    with pytest.raises(codegen.ModelError, match="link or frame 'wrld' is not in this file"):
        imported(tmp_path, sdf(*parts).replace("<gearbox_reference_body>world", "<gearbox_reference_body>wrld"))
    assert any("gears" in line for line in imported(tmp_path, sdf(*parts), free_mimic=True).left_out)


def test_a_link_without_inertial_has_what_sdf_says(tmp_path):
    text = sdf(link("a"), '<link name="b"/>\n', joint("j", "a", "b"))
    found = imported(tmp_path, text)
    assert any("1 kg and 1 kg m^2 about every axis" in w for w in found.warnings)
    assert "mass: 1\n    inertia: {xx: 1, yy: 1, zz: 1}" in found.text


def test_the_tree_prefers_what_is_not_loose_and_goes_forward():
    edges = [
        Edge("ball", "a", "c", True),
        Edge("ab", "a", "b", False),
        Edge("bc", "b", "c", False),
        Edge("da", "d", "a", False),
    ]
    assert spanning_tree(["a", "b", "c", "d", "e"], edges) == [
        ("d", False), ("da", False), ("ab", False), ("bc", False), ("e", False),
    ]  # fmt: skip
    circle = [Edge("ab", "a", "b", False), Edge("ba", "b", "a", False)]
    assert spanning_tree(["a", "b"], circle) == [("a", False), ("ab", False)]
    assert spanning_tree(["a", "b"], [Edge("back", "b", "", False)]) == [("back", True), ("a", False)]
