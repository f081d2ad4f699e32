"""The meaning of a model file: every key, repetition, sharing, and the builder as an alternative to the file."""

import numpy as np
import pytest

from codegen.model import ModelBuilder, ModelError, load_model, parse_model
from codegen.model.model import GROUND

CHAIN = """\
model: chain
gravity: [0, 0, -9.81]
constants: {n: 6, rho: 1, r: 0.05}
parameters:
  L: {value: 1.0, unit: m}
bodies:
  repeat k in 1..n:
    link(k):
      parent: link(k-1)
      joint: {type: revolute, axis: [1 - k % 2, k % 2, 0], at: [0, 0, -L]}
      shape: {type: cylinder, axis: z, length: L, radius: r, mass: rho*L, center: [0, 0, -L/2]}
      first: {parent: ground, joint: {at: [0, 0, 0]}}
initial:
  q: {repeat k in 1..n: {link(k): 0.3*sin(k)}}
outputs:
  kinetic: kinetic_energy
"""


def chain_by_hand(n=6):
    b = ModelBuilder("chain", gravity=[0, 0, -9.81])
    b.constant("rho", 1)
    b.parameter("L", 1.0, unit="m")
    for k in range(1, n + 1):
        b.body(
            f"link_{k}",
            parent=f"link_{k - 1}" if k > 1 else "ground",
            joint="revolute",
            axis="xy"[k % 2],
            at=[0, 0, "-L"] if k > 1 else np.zeros(3),
            shape={
                **{"type": "cylinder", "axis": "z", "length": "L", "radius": 0.05, "mass": "rho*L"},
                "center": [0, 0, "-L/2"],
            },
        )
        b.initial(q={f"link_{k}": float(0.3 * np.sin(k))})
    b.output("kinetic", "kinetic_energy")
    return b.build()


def flat(model):
    """All contents of a model as data that can be compared."""
    return (
        (model.name, model.gravity, model.parameters, model.inputs, model.initial_q, model.initial_u),
        [(b.name, b.parent, b.joint.type, b.joint.axes, b.joint.at, b.joint.rotation) for b in model.bodies],
        [(b.mass, b.com, b.inertia) for b in model.bodies],
        [(f.name, f.body, f.values) for f in model.forces],
        [(o.name, o.measure, o.axis, o.expression, [(p.name, p.body, p.at) for p in o.points]) for o in model.outputs],
    )


def test_the_builder_and_the_file_make_the_same_model():
    assert flat(parse_model(CHAIN)) == flat(chain_by_hand())


def test_a_file_and_its_text_are_the_same_model(tmp_path):
    (tmp_path / "chain.yaml").write_text("\ufeff" + CHAIN, encoding="utf-8")
    assert flat(load_model(tmp_path / "chain.yaml")) == flat(parse_model(CHAIN))


def test_repeated_bodies_share_their_expressions():
    bodies = parse_model(CHAIN.replace("n: 6", "n: 100")).bodies
    assert len(bodies) == 100
    for b in bodies[2:]:
        assert b.mass is bodies[1].mass
        assert all(x is y for x, y in zip(b.inertia, bodies[1].inertia, strict=True))
    assert bodies[3].joint.axes[0][0] is bodies[1].joint.axes[0][0]
    assert [e.value for e in bodies[0].joint.axes[0]] == [0, 1, 0]
    assert [e.value for e in bodies[1].joint.axes[0]] == [1, 0, 0]
    assert [b.parent for b in bodies[:3]] == [GROUND, 0, 1]


def test_bodies_written_out_share_their_expressions_too():
    text = "model: m\nparameters: {L: 1}\nbodies:\n" + "".join(
        f"  b{k}: {{parent: ground, joint: {{type: free}}, mass: 2*L, inertia: {{xx: L**2, yy: L**2, zz: L **2}}}}\n"
        for k in range(3)
    )
    bodies = parse_model(text).bodies
    assert len({id(b.mass) for b in bodies}) == 1
    assert len({id(e) for b in bodies for e in b.inertia[:3]}) == 1


def test_nested_repetition_labels_tables_and_all_sections():
    model = parse_model(
        """
model: vehicle
constants:
  sx: [1, -1]                 # a table: sx(1), sx(2)
  side_left: 1
  side_right: -1
parameters:
  repeat i in 1..2: {c(i): 10*i}
  a: 0.5
inputs: [steer, {repeat i in 1..2: {tau(i): }}]
bodies:
  hull: {parent: ground, joint: {type: free}, mass: 10, inertia: {xx: 1, yy: 1, zz: 1}}
  repeat i in 1..2:
    repeat s in left, right:
      hip(i)(s):
        parent: hull
        joint: {type: universal, axes: [y, x], at: [a*sx(i), 0.3*side(s), 0]}
        mass: 1
        com: [0, 0, -0.1]
        inertia: {xx: 0.1, yy: 0.1, zz: 0.1}
      knee(i)(s):
        parent: hip(i)(s)
        joint: {type: revolute, axis: y}
        mass: 1
        com: [0, 0, -0.1]
points:
  repeat i in 1..2: {foot(i): {body: knee(i)(left), at: [0, 0, -a]}}
forces:
  repeat i in 1..2:
    damp(i): {type: joint, joint: knee(i)(right), value: tau(i) - c(i)*u.knee(i)(right)}
    hold(i): {type: joint, joint: hip(i)(left), value: [-q.hip(i)(left).1, steer]}
initial:
  u: {repeat i in 1..2: {hip(i)(left).2: 0.1*i}}
outputs:
  repeat i in 1..2: {height(i): {position: foot(i), axis: z}}
"""
    )
    assert [b.name for b in model.bodies][:5] == ["hull", "hip_1_left", "knee_1_left", "hip_1_right", "knee_1_right"]
    assert len(model.bodies) == 9
    assert str(model.bodies[7].joint.at[0]) == "a*(-1)"  # hip_2_right
    assert model.bodies[7].joint.at[1].value == -0.3
    assert model.inputs == ("steer", "tau_1", "tau_2")
    assert [(p.name, p.value) for p in model.parameters] == [("c_1", 10), ("c_2", 20), ("a", 0.5)]
    assert str(model.forces[0].values[0]) == "tau_1 - c_1*u.knee_1_right"
    assert str(model.forces[1].values[0]) == "-q.hip_1_left.1"
    assert {k: e.value for k, e in model.initial_u.items()} == {"hip_1_left.2": 0.1, "hip_2_left.2": 0.2}
    assert model.outputs[1].points[0] is not None
    assert model.outputs[1].points[0].body == 6
    assert not [w for w in model.warnings if "triangle" not in w]


def test_ranges():
    def names(header, entry="a(k)"):
        entry = f"{entry}: {{parent: ground, joint: {{type: prismatic, axis: y}}, mass: 1}}"
        base = "z: {parent: ground, joint: {type: prismatic, axis: z}, mass: 1}"
        text = f"model: m\nconstants: {{n: 5}}\nbodies:\n  {base}\n  {header}:\n    {entry}\n"
        return [b.name for b in parse_model(text).bodies][1:]

    assert names("repeat k in 1..3") == ["a_1", "a_2", "a_3"]
    assert names("repeat k in 0..n step 2") == ["a_0", "a_2", "a_4"]
    assert names("repeat k in n-1 .. n") == ["a_4", "a_5"]
    assert names("repeat k in 3..2") == []
    assert names("repeat k in left, right") == ["a_left", "a_right"]
    assert names("repeat k in 7, 9", "a(k+1)") == ["a_8", "a_10"]


def test_last():
    text = CHAIN.replace("first: {parent", "last: {shape: {mass: 2*rho*L}}\n      first: {parent")
    bodies = parse_model(text).bodies
    assert bodies[5].mass.evaluate({"L": 1.0}) == 2
    assert bodies[4].mass.evaluate({"L": 1.0}) == 1
    assert len(parse_model(text.replace("n: 6", "n: 1")).bodies) == 1


def rotation_matrix(rotation, values):
    """Product of the rotations, by Rodrigues' formula."""
    result = np.eye(3)
    for axis, angle in rotation:
        a = np.array([e.evaluate(values) for e in axis], float)
        a = a / np.linalg.norm(a)
        x, y, z = a
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        phi = angle.evaluate(values)
        result = result @ (np.eye(3) + np.sin(phi) * k + (1 - np.cos(phi)) * k @ k)
    return result


def test_rotations():
    head = (
        "model: m\nparameters: {r: 0.1, p: 0.2, y: 0.3}\n"
        "bodies: {b: {parent: ground, mass: 1, joint: {type: prismatic, axis: x, "
    )
    values = {"r": 0.1, "p": 0.2, "y": 0.3}
    joint = parse_model(head + "rpy: [r, p, y]}}}").bodies[0].joint
    cr, sr, cp, sp, cy, sy = (f(v) for v in (0.1, 0.2, 0.3) for f in (np.cos, np.sin))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    np.testing.assert_allclose(rotation_matrix(joint.rotation, values), about_z @ about_y @ about_x, atol=1e-15)
    joint = (
        parse_model(
            head
            + "rotate: [{axis: z, angle: y}, {axis: [0, 2, 0], angle: p}, {axis: x, angle: 0}, {axis: x, angle: r}]}}}"
        )
        .bodies[0]
        .joint
    )
    assert len(joint.rotation) == 3
    np.testing.assert_allclose(rotation_matrix(joint.rotation, values), about_z @ about_y @ about_x, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "gravity"), [("", None), ("gravity: [0, 0.0, 1 - 1]\n", None), ("gravity: [0, g, 0]\n", "g")]
)
def test_gravity(text, gravity):
    model = parse_model(
        f"model: m\n{text}parameters: {{g: 9.81}}\n"
        "bodies: {b: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}}\n"
    )
    assert (model.gravity if gravity is None else str(model.gravity[1])) == gravity


def test_outputs_and_arrays_of_names():
    model = parse_model(
        """
model: m
bodies:
  hand: {parent: arm, joint: {type: spherical}, mass: 1, com: [1, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
  arm: {parent: ground, joint: {type: revolute, axis: -y}, mass: 1, com: [1, 0, 0]}
points: {tip: {body: hand, at: [1, 0, 0]}, base: {body: ground}}
outputs:
  a: {position: tip, axis: [1, 1, 0]}
  b: {velocity: hand, axis: z}
  c: {position: {body: arm, at: [0, 0, 2]}, axis: x}
  d: potential_energy
  e: {value: q.arm + u.hand.wx*t}
  f: {position: base, axis: x}
initial: {q: {hand.qw: 0.6, hand.qx: 0.8, arm: pi/2}, u: {hand: [1, 2, 3]}}
"""
    )
    assert model.coordinate_names == ("hand.qw", "hand.qx", "hand.qy", "hand.qz", "arm")
    assert model.speed_names == ("hand.wx", "hand.wy", "hand.wz", "arm")
    assert model.outward == (1, 0)
    assert [o.measure for o in model.outputs] == [
        "position",
        "velocity",
        "position",
        "potential_energy",
        "value",
        "position",
    ]
    assert [p.body for o in model.outputs for p in o.points] == [0, 0, 1, GROUND]
    assert model.initial_q["arm"].value == pytest.approx(np.pi / 2)
    assert [model.initial_u[f"hand.w{c}"].value for c in "xyz"] == [1, 2, 3]
    assert not model.warnings


def test_names_of_the_builder_can_be_calculated_with():
    b = ModelBuilder("m")
    L, g = b.parameter("L", 2.0), b.input("g")
    b.body("a", joint="prismatic", axis="x", mass=3 * L / (1 + L) - -(L**2))
    b.joint_force("f", "a", 2 - g * L)
    model = b.build()
    assert model.bodies[0].mass.evaluate({"L": 2.0}) == pytest.approx(3 * 2 / 3 + 4)
    assert model.forces[0].values[0].evaluate({"L": 2.0, "g": 5.0}) == -8


def test_the_builder_refuses_a_repeat_key():
    b = ModelBuilder("m")
    b.body("repeat k in 1..3", axis="x")
    b.body("a(k)", axis="x")
    with pytest.raises(ModelError, match="use a for loop that adds each item"):
        b.build()


def test_one_thousand_and_one_links_have_few_kinds():
    model = parse_model(CHAIN.replace("n: 6", "n: 1001"))
    assert model.nq == model.nu == 1001
    assert len({(b.mass, b.com, b.inertia, b.joint.axes, b.joint.at) for b in model.bodies}) == 3


@pytest.mark.parametrize("name", ["math", "json", "numpy", "codegen"])
def test_a_model_may_not_hide_a_module(name):
    text = f"model: {name}\nbodies: {{a: {{parent: ground, joint: {{type: prismatic, axis: z}}, mass: 1}}}}\n"
    with pytest.raises(ModelError, match="is a module that the package would hide"):
        parse_model(text)
