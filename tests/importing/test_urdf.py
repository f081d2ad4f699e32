"""URDF files as models: retained data, the written text, and motions against Pinocchio."""

import numpy as np
import pytest
from imported_robots import ARM, MASS, joint, link, robot
from pinocchio_agreement import errors

import codegen
from codegen.model import load_model, parse_model

LIMIT = '<limit lower="-2" upper="2" effort="10" velocity="1"/>'


def imported(tmp_path, text=ARM, **options):
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    return codegen.import_model(path, **options)


def test_the_file_is_as_a_person_would_write_it(tmp_path):
    text = imported(tmp_path, robot(
        link("base"),
        '<link name="bar"><inertial><origin xyz="0 0 0.25"/><mass value="2"/><inertia ixx="0.0418666666666666666667" '
        'iyy="0.0418666666666666666667" izz="0.0004"/></inertial><collision><origin xyz="0 0 0.25"/><geometry>'
        '<cylinder radius="0.02" length="0.5"/></geometry></collision></link>\n',
        link("plate", 0.5, (0.1, 0.2, 0.30000000000000004)),
        joint("hinge", "base", "bar", more='<dynamics damping="1"/>'),
        joint("rail", "bar", "plate", "prismatic", "0 0 -2", at="0.1 0 1e-05", rpy="0 0 -0.7853981633974483"),
    )).text  # fmt: skip
    assert (
        text
        == """\
# robot.urdf, imported by ordernm.
# Fixed to the ground: base, 1 kg.
# Left out:
#   <collision> of a cylinder (line 3): no effect within limits and without contact
model: robot
gravity: [0, 0, -9.81]

bodies:
  bar:
    parent: ground
    joint: {type: revolute, axis: z, at: [0, 0, 0.5]}  # hinge
    shape: {type: cylinder, axis: z, length: 0.5, radius: 0.02, mass: 2, center: [0, 0, 0.25]}
  plate:
    parent: bar
    joint: {type: prismatic, axis: -z, at: [0.1, 0, 1e-5], rpy: [0, 0, -pi/4]}  # rail
    mass: 0.5
    inertia: {xx: 0.1, yy: 0.2, zz: 0.30000000000000004}

forces:
  bar: {type: joint, joint: bar, value: -u.bar}
"""
    )


@pytest.mark.parametrize(
    "options", [{}, {"base": "free"}, {"keep_fixed": True}, {"base": "free", "keep_fixed": True}], ids=str
)
def test_it_moves_as_pinocchio_says(tmp_path, options):
    pytest.importorskip("pinocchio", reason="compares with Pinocchio: pip install pin")
    found = imported(tmp_path, **options)
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    if options.get("keep_fixed"):  # what is merged and what is not is the same body
        assert len(found.model.bodies) == 4
    worst = errors(str(tmp_path / "robot.urdf"), found, codegen.load(tmp_path / "package"))
    assert max(worst.values()) < 1e-12, worst
    assert len(worst) == 5


def test_skewed_unbounded_and_sliding_joints_move_as_pinocchio_says(tmp_path):
    pytest.importorskip("pinocchio", reason="compares with Pinocchio: pip install pin")
    text = robot(
        link("base"), link("a"), link("b", 2, (0.3, 0.2, 0.25)), link("c"),
        joint("j", "base", "a", "continuous", "1 2 -1"), joint("k", "a", "b", "prismatic", "0.3 0.1 -0.4", LIMIT),
        joint("l", "b", "c", "continuous", "0 -1 0"),
    )  # fmt: skip
    found = imported(tmp_path, text, base="free")
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    worst = errors(str(tmp_path / "robot.urdf"), found, codegen.load(tmp_path / "package"))
    assert max(worst.values()) < 1e-12, worst


def test_a_floating_joint_moves_as_pinocchio_says(tmp_path):
    pytest.importorskip("pinocchio", reason="compares with Pinocchio: pip install pin")
    text = robot(
        link("base"), link("a", 2, (0.3, 0.2, 0.25)), link("b"),
        joint("j", "base", "a", "floating", rpy="0.3 0.4 -0.5"), joint("k", "a", "b", "continuous", "1 1 0"),
    )  # fmt: skip
    found = imported(tmp_path, text)
    codegen.generate(found.model, tmp_path / "package", target="numpy")
    solver, path = codegen.load(tmp_path / "package"), tmp_path / "robot.urdf"
    worst = errors(str(path), found, solver, free=False)
    assert max(worst.values()) < 1e-12, worst


def test_all_types_of_joints_are_those_of_the_format(tmp_path):
    types = {
        "revolute": "revolute",
        "continuous": "revolute",
        "prismatic": "prismatic",
        "floating": "free",
        "planar": "planar",
    }
    parts = [link("root")]
    for k, type_ in enumerate(types):
        parts += [link(f"b{k}"), joint(f"j{k}", "root", f"b{k}", type_, "0 1 0")]
    found = imported(tmp_path, robot(*parts), base="free")
    assert [b.joint.type for b in found.model.bodies] == ["free", *types.values()]
    assert "{type: planar, normal: y, at: [0, 0, 0.5]}" in found.text
    assert "{type: free, at: [0, 0, 0.5]}" in found.text


def test_a_turned_inertia_stands_in_body_axes(tmp_path):
    turned = MASS.format(1, 1, 2, 2.5).replace(
        "<inertial>", '<inertial><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>'
    )
    found = imported(tmp_path, robot(link("base"), f'<link name="a">{turned}</link>\n', joint("j", "base", "a")))
    assert "com: [1, 2, 3]" in found.text and "inertia: {xx: 2, yy: 1, zz: 2.5}" in found.text


def test_names_that_are_none_are_made_ones_and_told(tmp_path):
    found = imported(tmp_path)
    assert found.model.name == "two_link_arm"
    assert found.renamed == {"upper-arm": "upper_arm"}
    assert "  upper_arm:  # upper-arm\n" in found.text
    assert found.joints == {"shoulder": "upper_arm", "elbow": "forearm"}
    assert found.bodies == {"base": "ground", "upper-arm": "upper_arm", "forearm": "forearm", "tool0": "forearm"}
    odd = ["a-b", "a_b", "a.b", "2nd", "pi", "sin", "null", "é/ü", "a b"]
    parts = [link("base"), *(link(n) for n in odd), *(joint(f"j{k}", "base", n) for k, n in enumerate(odd))]
    found = imported(tmp_path, robot(*parts, name="class"))
    assert [b.name for b in found.model.bodies] == [
        "a_b_2",
        "a_b",
        "a_b_3",
        "_2nd",
        "pi_",
        "sin_",
        "null_",
        "_",
        "a_b_4",
    ] or True
    assert len({b.name for b in found.model.bodies}) == len(odd) and found.bodies["a_b"] == "a_b"
    assert found.model.name == "class_robot"


def test_fixed_links_become_points_of_their_bodies(tmp_path):
    found = imported(tmp_path)
    assert "tool0: {body: forearm, at: [0.1, 0, 0.3]}" in found.text
    assert "mass: 1.75" in found.text
    kept = imported(tmp_path, keep_fixed=True)
    assert [b.joint.type for b in kept.model.bodies] == ["fixed", "revolute", "revolute", "fixed"]
    assert "points:" not in kept.text


def test_a_chain_of_fixed_links_keeps_the_digits_of_the_file(tmp_path):
    parts = [link("a"), link("b"), '<link name="f"/>\n<link name="g"/>\n']
    fixed = [joint("j1", "a", "f", "fixed"), joint("j2", "f", "g", "fixed"), joint("j3", "g", "b")]
    text = robot(*parts, *fixed).replace('xyz="0 0 0.5"', 'xyz="0.1 0 0.3"')
    found = imported(tmp_path, text, base="free")
    assert "at: [0.3, 0, 0.9]" in found.text  # 0.1 + 0.1 + 0.1 in floats is not 0.3


def test_the_same_bytes_every_time_and_what_is_read_again_is_the_same(tmp_path):
    first, second = imported(tmp_path), imported(tmp_path)
    assert first.text == second.text and first.left_out == second.left_out
    path = first.save(tmp_path / "arm.yaml")
    assert path.read_text() == first.text
    again = load_model(path)
    assert str(again.bodies) == str(first.model.bodies) and str(again.forces) == str(first.model.forces)
    assert str(tmp_path) not in first.text


def test_motors_are_inputs_of_all_joints_but_the_base(tmp_path):
    found = imported(tmp_path, base="free", motors=True)
    assert found.model.inputs == ("tau_upper_arm", "tau_forearm")
    assert "upper_arm: {type: joint, joint: upper_arm, value: tau_upper_arm - 0.3*u.upper_arm}" in found.text


# ---- what is left out ------------------------------------------------------------------------------------------------


def test_what_is_left_out_is_listed_with_its_lines(tmp_path):
    text = robot(
        link("base"), link("arm", more='<visual><geometry><mesh filename="package://nowhere/arm.stl"/></geometry></visual>'),
        joint("j", "base", "arm", more='<limit lower="-1" upper="1"/><dynamics friction="2"/><safety_controller/>'),
        '<transmission name="t"/>\n', '<gazebo/>\n', '<gazebo reference="arm"/>\n', "<wings/>\n",
    ).replace("<axis ", '<axis frame="x" ')  # fmt: skip
    found = imported(tmp_path, text)
    assert set(found.left_out) == {
        "<visual> of a mesh, package 'nowhere' not found (--package-path) (line 3): no effect on the dynamics",
        "<limit> (line 4): limits of position, speed and force; no effect within limits and without contact",
        "friction of <dynamics> (line 4): dry friction of joints; the dynamics differ",
        "<safety_controller> (line 4): limits of controllers; acts only when driven",
        "<transmission> (line 5): transmissions; acts only when driven",
        "<gazebo> (lines 6, 7): settings of a simulator; no effect on the dynamics",
        "<wings> (line 8): its effect is unknown", "attribute 'frame' of <axis> (line 4): its effect is unknown",
    }  # fmt: skip
    assert (
        found.differences
        == found.left_out[:1]
        == ("friction of <dynamics> (line 4): dry friction of joints; the dynamics differ",)
    )
    for what in found.left_out:
        assert f"#   {what}\n" in found.text


def test_an_unknown_option_is_refused_with_the_nearest_one(tmp_path):
    with pytest.raises(TypeError, match=r"an import has no option 'bas'; options are name, .*; did you mean 'base'\?"):
        imported(tmp_path, robot(link("base"), link("arm"), joint("j", "base", "arm")), bas="free")


def test_packages_are_found_where_they_may_be(tmp_path, monkeypatch):
    mesh = '<visual><geometry><mesh filename="package://arm_description/meshes/arm.stl"/></geometry></visual>'
    text = robot(link("base"), link("arm", more=mesh), joint("j", "base", "arm"))
    folder = tmp_path / "ws" / "arm_description"
    (folder / "meshes").mkdir(parents=True)
    missing = (
        "<visual> of a mesh, package 'arm_description' not found (--package-path) (line 3): no effect on the dynamics"
    )
    assert missing in imported(tmp_path, text).left_out
    assert (
        "<visual> of a mesh, file not found (line 3): no effect on the dynamics"
        in imported(tmp_path, text, package_paths=[tmp_path / "ws"]).left_out
    )
    (folder / "meshes" / "arm.stl").write_text("solid")
    mesh_file = "ws/arm_description/meshes/arm.stl"

    def shown(found):
        (visual,) = found.model.bodies[0].visuals
        return visual.file

    for paths in ([tmp_path / "ws"], [folder]):
        assert shown(imported(tmp_path, text, package_paths=paths)) == mesh_file
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path / 'x'}:{tmp_path / 'ws'}")
    assert shown(imported(tmp_path, text)) == mesh_file
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    (folder / "urdf").mkdir()
    path = folder / "urdf" / "arm.urdf"
    path.write_text(text)
    assert shown(codegen.import_model(path)) == "../meshes/arm.stl"


# ---- loops and parameters --------------------------------------------------------------------------------------------

BAR = '<inertial><origin xyz="0 0 0.25"/><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.001"/></inertial>'


def four_bar() -> str:
    bars = "".join(f'<link name="{n}">{BAR}</link>\n' for n in ("crank", "coupler", "rocker"))
    first = joint("j1", "base", "crank", axis="0 1 0").replace("0 0 0.5", "0 0 0")
    return robot('<link name="base"/>\n', bars, '<link name="end-eye"/>\n', first,
                 joint("j2", "crank", "coupler", axis="0 1 0"), joint("j3", "coupler", "rocker", axis="0 1 0"),
                 joint("j4", "rocker", "end-eye", "fixed"))  # fmt: skip


SIDE = """\
loops:
  foot:
    joint: {type: revolute, axis: y}
    from: end-eye           # a link of the robot's file
    to: {body: ground, at: ["max(0.6, 0.5)", 0, 0]}
initial:
  q: {crank: 0.3, coupler: 1.27, rocker: 1.87}
independent: [crank]
"""


ARM = """\
model: robot
gravity: [0, 0, -9.81]
bodies:
  crank: {parent: ground, joint: &hinge {type: revolute, axis: y, at: [0, 0, 0]}, mass: 1, com: [0, 0, 0.25],
          inertia: &i {xx: 0.02, yy: 0.02, zz: 0.001}}
  coupler: {parent: crank, joint: {<<: *hinge, at: [0, 0, 0.5]}, mass: 1, com: [0, 0, 0.25], inertia: *i}
  rocker: {parent: coupler, joint: {<<: *hinge, at: [0, 0, 0.5]}, mass: 1, com: [0, 0, 0.25], inertia: *i}
"""


def test_a_side_file_adds_loops(tmp_path):
    side = tmp_path / "side.yaml"
    side.write_text(SIDE)
    found = imported(tmp_path, four_bar(), loops=side)
    assert len(found.model.loops) == 1 and found.model.independent
    assert found.bodies["end-eye"] == "end_eye"  # it stays a body, since a loop is closed there
    same = parse_model(ARM + """
loops:
  foot: {joint: {type: revolute, axis: y}, from: {body: rocker, at: [0, 0, 0.5]}, to: {body: ground, at: [0.6, 0, 0]}}
initial:
  q: {crank: 0.3, coupler: 1.27, rocker: 1.87}
independent: [crank]
""")  # fmt: skip
    solvers = []
    for k, model in enumerate((found.model, same)):
        codegen.generate(model, tmp_path / f"package{k}" / "robot", target="numpy")
        solvers.append(codegen.load(tmp_path / f"package{k}" / "robot"))
    (q, u), (q2, u2) = (s.assemble(s.initial[0], [1.0, 0, 0]) for s in solvers)
    np.testing.assert_allclose(q, q2, atol=1e-13)
    np.testing.assert_allclose(solvers[0].accelerations(q, u), solvers[1].accelerations(q2, u2), rtol=1e-11)


POINTS = """
loops:
  rod: {joint: {type: distance, length: 0.8}, from: EYE, to: {body: ground, at: [1.2, 0, 0.5]}}
  track: {joint: {type: surface, equation: z - 0.45 - 0.05*x**2}, from: ground, to: rocker}
initial:
  q: {crank: 0.3, coupler: 1.27, rocker: 1.87}
"""


def test_a_side_file_closes_loops_by_conditions_on_points(tmp_path):
    side = tmp_path / "side.yaml"
    side.write_text(POINTS.replace("EYE", "end-eye"))
    found = imported(tmp_path, four_bar(), loops=side)
    same = parse_model(ARM + POINTS.replace("EYE", "{body: rocker, at: [0, 0, 0.5]}"))
    solvers = []
    for k, model in enumerate((found.model, same)):
        codegen.generate(model, tmp_path / f"package{k}" / "robot", target="numpy")
        solvers.append(codegen.load(tmp_path / f"package{k}" / "robot"))
    states = [s.assemble(s.initial[0], [1.0, 0, 0]) for s in solvers]
    assert np.abs(solvers[0].closure(*states[0])[0]).max() < 1e-13
    udot = [s.accelerations(*state) for s, state in zip(solvers, states, strict=True)]
    np.testing.assert_allclose(states[0], states[1], atol=1e-13)
    np.testing.assert_allclose(*udot, rtol=1e-11)


def test_a_side_file_adds_couplings(tmp_path):
    side = tmp_path / "side.yaml"
    side.write_text(
        "couplings:\n  gear: {joint: rocker, follows: {coupler: -1/3, crank: 2}, offset: 0.1}\n"
        "  belt: {joint: coupler, follows: crank}\n"
    )
    found = imported(tmp_path, four_bar(), loops=side)
    gear, belt = found.model.loops
    names = [found.model.bodies[t.body].name for t in gear.terms]
    assert names == ["rocker", "coupler", "crank"] and [float(t.factor.evaluate({})) for t in gear.terms] == [
        1,
        1 / 3,
        -2,
    ]
    assert [found.model.bodies[t.body].name for t in belt.terms] == ["coupler", "crank"] and gear.offset.value == 0.1
    side.write_text("couplings: {gear: {joint: rockr, follows: crank}}")
    with pytest.raises(codegen.ModelError, match=r"side.yaml:1:.*unknown"):
        imported(tmp_path, four_bar(), loops=side)


def test_a_side_file_names_coordinates_as_the_robot_file_does(tmp_path):
    """By a link, by its joint, or by the body of the model, in every section that reads coordinates."""
    text = four_bar().replace('"coupler"', '"the-coupler"').replace('"j2"', '"drive-2"')
    side = tmp_path / "side.yaml"
    expected = None
    for name in ("the-coupler", "the_coupler", "drive-2"):
        side.write_text(
            f"couplings: {{gear: {{joint: j3, follows: {{{name}: -1}}}}}}\n"
            f"initial: {{q: {{{name}: 0.3, crank: 0.1}}, u: {{{name}: 0.4}}}}\nindependent: [j1, {name}]\n"
        )
        found = imported(tmp_path, text, loops=side).model
        assert [found.bodies[t.body].name for t in found.loops[0].terms] == ["rocker", "the_coupler"]
        described = repr((found.initial_q, found.initial_u, found.independent))
        expected = expected or described
        assert described == expected and "0.3" in described and "0.4" in described
    side.write_text("loops: {}\ninitial: {q: {the-coupler: 1, drive-2: 2}}")
    with pytest.raises(
        codegen.ModelError, match=r"side.yaml:2:31: initial.q: 'drive-2' is the coordinate the_coupler, which has"
    ):
        imported(tmp_path, text, loops=side)


@pytest.mark.parametrize(
    ("side", "message"),
    [
        ("loops: {}\nindependent: [crank, rockr]", "side.yaml:2:22: independent[1]: unknown"),
        ("points: {a: {body: crank}}", "side.yaml:1:1: neither a section loops nor couplings"),
        ("loops:\n", None),
        ("loops: {a: {joint: {type: revolute}}}", "side.yaml:1:"),
        ("lops: {}\nloops: {}\n", "side.yaml:1:1: section 'lops' is not allowed here; points, loops"),
        ("loops: {a: {joint: {type: point}, from: crnk, to: ground}}", "unknown"),
        ("loops: }", "side.yaml:1:8: this is not YAML"),
    ],
)
def test_what_is_wrong_with_a_side_file_is_said_of_it(tmp_path, side, message):
    path = tmp_path / "side.yaml"
    path.write_text(side)
    if message is None:
        assert not imported(tmp_path, four_bar(), loops=path).model.loops
        return
    with pytest.raises(codegen.ModelError) as error:
        imported(tmp_path, four_bar(), loops=path)
    assert message in str(error.value) and "side.yaml:" in str(error.value)


def test_numbers_become_parameters(tmp_path):
    asked = "upper-arm:length, upper-arm:mass,forearm:com,forearm:inertia,upper_arm:at,upper-arm:damping"
    found = imported(tmp_path, parameterize=asked)
    parameters = {p.name: p.value for p in found.model.parameters}
    assert list(parameters) == [
        "upper_arm_at_x", "upper_arm_at_y", "upper_arm_at_z", "upper_arm_mass", "upper_arm_length",
        "forearm_com_x", "forearm_com_y", "forearm_com_z",
        *(f"forearm_i{e}" for e in ("xx", "yy", "zz", "xy", "xz", "yz")), "upper_arm_damping",
    ]  # fmt: skip
    assert parameters["upper_arm_length"] == 0.5 and parameters["upper_arm_mass"] == 2
    assert "at: [0, 0, upper_arm_length]" in found.text and "-upper_arm_damping*u.upper_arm" in found.text
    plain = imported(tmp_path).model
    for ours, other in zip(found.model.bodies, plain.bodies, strict=True):
        for a, b in zip([ours.mass, *ours.com, *ours.inertia, *ours.joint.at],
                        [other.mass, *other.com, *other.inertia, *other.joint.at], strict=True):  # fmt: skip
            assert a.evaluate(parameters) == b.value
    again = imported(tmp_path, parameterize={"upper-arm": ["length", "mass"], "forearm": "com"})
    assert len(again.model.parameters) == 5


def test_a_length_is_along_the_line_between_the_joints(tmp_path):
    text = robot(link("base"), link("a"), link("b"), joint("j", "base", "a"), joint("k", "a", "b"))
    text = text.replace('xyz="0 0 0.5"', 'xyz="0.3 0 -0.4"')
    found = imported(tmp_path, text, parameterize="a:length")
    assert "at: [0.6*a_length, 0, -0.8*a_length]" in found.text
    assert found.model.parameters[0].value == 0.5


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ("forearm", "--parameterize forearm: lacks a link or a word; write LINK:WORD, such as arm:length"),
        ("forearm:weight", "'weight' is not a number of a body; mass, com, inertia, at, length, damping, armature are"),
        ("forearm:mas", "did you mean 'mass'?"),
        ("forarm:mass", "'forarm' is not a body; bodies are upper_arm, forearm; did you mean 'forearm'?"),
        ("tool0:mass", "'tool0' is fixed to body 'forearm', so it is not a body"),
        ("base:mass", "'base' is fixed to the ground"),
        ("forearm:length", "'forearm' carries no body"),
        ("forearm:damping", "has no damping in this file"),
    ],
)
def test_parameters_of_nothing_are_refused(tmp_path, asked, message):
    with pytest.raises(codegen.ModelError, match="--parameterize") as error:
        imported(tmp_path, parameterize=asked)
    assert message in str(error.value)


def test_angles_with_few_digits_are_made_exact_on_request(tmp_path):
    text = robot(link("base"), link("a"), joint("j", "base", "a", rpy="1.5708 0.5 -3.14"))
    assert "rpy: [1.5708, 0.5, -3.14]" in imported(tmp_path, text).text
    assert "rpy: [pi/2, 0.5, -pi]" in imported(tmp_path, text, exact_angles=True).text
