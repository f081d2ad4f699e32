# ruff: noqa: E501  (the table of mistakes reads better in one line each)
"""Loops, springs and `independent`: the meaning of their keys, and errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen.model import ModelBuilder, ModelError, parse_model
from codegen.model.model import CLOSURE_ROWS, GROUND
from codegen.model.parsing import parse

FOUR_BAR = """\
model: four_bar
gravity: [0, 0, -9.81]
parameters: {L: 1.0, k: 250, c: 2}
inputs: [pull]
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: y}, shape: &bar {type: rod, axis: z, length: L, mass: 1, center: [0, 0, L/2]}}
  coupler: {parent: crank, joint: {type: revolute, axis: y, at: [0, 0, L]}, shape: *bar}
  rocker: {parent: coupler, joint: {type: revolute, axis: y, at: [0, 0, L]}, shape: *bar}
points:
  end: {body: rocker, at: [0, 0, L]}
loops:
  foot:
    joint: {type: revolute, axis: y}
    from: end
    to: {body: ground, at: [1.2*L, 0, 0], rotate: [{axis: y, angle: 0.1*L}]}
forces:
  return: {type: spring, from: {body: crank, at: [0, 0, L]}, to: {body: ground, at: [0, 0, 2]}, stiffness: k*(1 + pull), damping: c*exp(-t), free_length: 0.8*L}
  drive: {type: joint, joint: crank, value: -0.1*u.crank}
  strut: {type: spring, from: end, to: ground, stiffness: 1}
initial:
  q: {crank: 0.3, coupler: 1.27, rocker: 1.87}
independent: [crank]
"""


def vectors(vectors):
    return [[str(e) for e in v] for v in vectors]


def test_a_four_bar():
    model = parse_model(FOUR_BAR)
    (foot,) = model.loops
    assert (foot.name, foot.type, vectors(foot.axes)) == ("foot", "revolute", [["0", "1", "0"]])
    assert (foot.start.body, vectors([foot.start.at]), foot.start.rotation) == (2, [["0", "0", "L"]], ())
    assert (foot.end.body, vectors([foot.end.at])) == (GROUND, [["1.2*L", "0", "0"]])
    ((axis, angle),) = foot.end.rotation
    assert (vectors([axis]), str(angle)) == ([["0", "1", "0"]], "0.1*L")
    assert model.closure_names == ("foot.l1", "foot.l2", "foot.l3", "foot.a1", "foot.a2")
    assert [f.name for f in model.forces] == ["drive"]
    spring, strut = model.loads
    assert (spring.start.body, spring.end.body) == (0, GROUND)
    assert vectors([spring.start.at, spring.end.at]) == [["0", "0", "L"], ["0", "0", "2"]]
    assert [str(e) for e in (spring.stiffness, spring.damping, spring.free_length)] == [
        "k*(1 + pull)",
        "c*exp(-t)",
        "0.8*L",
    ]
    assert (strut.start.name, strut.start.body, strut.end.body) == ("end", 2, GROUND)
    assert [e.value for e in (strut.stiffness, strut.damping, strut.free_length)] == [1, 0, 0]
    assert model.independent == ("crank",)
    assert {"k", "pull", "c"} <= set().union(*(e.names for e in model.expressions()))
    assert model.warnings == ()


def test_the_builder_says_the_same():
    b = ModelBuilder("four_bar", gravity=[0, 0, -9.81])
    L, k, c, pull = b.parameter("L", 1.0), b.parameter("k", 250), b.parameter("c", 2), b.input("pull")
    parent = "ground"
    for name in ("crank", "coupler", "rocker"):
        at = [0, 0, 0] if parent == "ground" else np.array(["0", "0", "L"])
        rod = {"type": "rod", "axis": "z", "length": L, "mass": 1, "center": [0, 0, L / 2]}
        parent = b.body(name, parent, "revolute", axis="y", at=at, shape=rod)
    b.point("end", parent, [0, 0, L])
    ground = {"body": "ground", "at": [1.2 * L, 0, 0], "rotate": [{"axis": "y", "angle": 0.1 * L}]}
    b.loop("foot", "revolute", "end", ground, axis="y")
    top, nail = {"body": "crank", "at": [0, 0, L]}, {"body": "ground", "at": (0, 0, 2)}
    b.spring("return", top, nail, k * (1 + pull), damping=f"{c}*exp(-t)", free_length=0.8 * L)
    b.joint_force("drive", "crank", "-0.1*u.crank")
    b.spring("strut", "end", "ground", 1)
    b.initial(q={"crank": 0.3, "coupler": 1.27, "rocker": 1.87})
    b.independent("crank")
    built, read = b.build(), parse_model(FOUR_BAR)
    values = {"L": 1.3, "k": 200.0, "c": 3.0, "pull": 0.5, "t": 0.7, "u.crank": 2.0}
    numbers = [[e.evaluate(values) for e in m.expressions()] for m in (built, read)]
    np.testing.assert_allclose(*numbers, rtol=1e-15)
    for m in (built, read):
        assert [(f.name, f.type, f.start.body, f.end.body) for f in m.loops] == [("foot", "revolute", 2, GROUND)]
        assert [(s.name, s.start.body, s.end.body) for s in m.loads] == [("return", 0, GROUND), ("strut", 2, GROUND)]
    assert built.independent == read.independent
    b.loop("other", {"type": "planar", "normal": [1, 0, L]}, "coupler", "ground")
    assert vectors(b.build().loops[1].axes) == [["1", "0", "L"]]


@pytest.mark.parametrize(
    ("joint", "type_", "axes"),
    [
        ("type: fixed", "fixed", []),
        ("type: revolute, axis: -x", "revolute", [["-1", "0", "0"]]),
        ("type: prismatic, axis: [0, L, 2]", "prismatic", [["0", "L", "2"]]),
        ("type: universal, axes: [y, [1, 0, L]]", "universal", [["0", "1", "0"], ["1", "0", "L"]]),
        ("type: spherical", "spherical", []),
        ("type: point", "spherical", []),
        ("type: cylindrical, axis: z", "cylindrical", [["0", "0", "1"]]),
        ("type: planar, normal: y", "planar", [["0", "1", "0"]]),
    ],
)
def test_every_joint_that_closes_a_loop(joint, type_, axes):
    (loop,) = parse_model(FOUR_BAR.replace("type: revolute, axis: y}\n    from", f"{joint}}}\n    from")).loops
    assert (loop.type, vectors(loop.axes)) == (type_, axes)
    assert loop.type in CLOSURE_ROWS


def test_faces_are_placed_like_joints():
    text = FOUR_BAR.replace("rotate: [{axis: y, angle: 0.1*L}]", "rpy: [0.1, 0, L]")
    (loop,) = parse_model(text).loops
    assert [(vectors([a]), str(e)) for a, e in loop.end.rotation] == [
        ([["0", "0", "1"]], "L"),
        ([["1", "0", "0"]], "0.1"),
    ]
    (loop,) = parse_model(text.replace("from: end\n    to", "from: coupler\n    to")).loops
    assert (loop.start.body, vectors([loop.start.at])) == (1, [["0", "0", "0"]])


LADDER = """\
model: ladder
constants: {n: 4}
parameters: {L: 1.0, stiff: 3}
inputs: [hold]
bodies:
  base: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  repeat i in 1..n:
    rail(i):
      parent: rung(i-1)
      joint: {type: revolute, axis: y, at: [L, 0, 0]}
      mass: 1
      inertia: {xx: 1, yy: 1, zz: 1}
      first: {parent: ground, joint: {at: [0, 0, 1]}}
    rung(i):
      parent: rail(i)
      joint: {type: universal, axes: [y, z], at: [L, 0, 0]}
      mass: 1
      inertia: {xx: 1, yy: 1, zz: 1}
points:
  repeat i in 1..n: {corner(i): {body: rung(i), at: [0, 0, L]}}
loops:
  repeat i in 1..n:
    close(i):
      joint: {type: universal, axes: [y, [1, 0, 0]]}
      from: corner(i)
      to: {body: rung(i-1), at: [L, 0, 2*L]}
      first: {to: {body: base, at: [0, 0, 0]}}
forces:
  repeat i in 2..n: {pull(i): {type: spring, from: corner(i), to: corner(i-1), stiffness: stiff*(i + hold), free_length: L/i}}
initial:
  q: {rail(1): 0.5*L}
independent: [base, rung(2), {repeat i in 3..n: {rung(i).1: }}, rail(n-1)]
"""


def test_repetition():
    model = parse_model(LADDER)
    names = [b.name for b in model.bodies]
    assert [loop.name for loop in model.loops] == ["close_1", "close_2", "close_3", "close_4"]
    joined = [(names[f.start.body], names[f.end.body]) for f in model.loops]
    assert joined == [("rung_1", "base"), ("rung_2", "rung_1"), ("rung_3", "rung_2"), ("rung_4", "rung_3")]
    for loop in model.loops[2:]:
        assert all(x is y for x, y in zip(loop.end.at, model.loops[1].end.at, strict=True))
        assert all(x is y for x, y in zip(loop.axes[1], model.loops[1].axes[1], strict=True))
    assert [str(s.stiffness) for s in model.loads] == ["stiff*(2 + hold)", "stiff*(3 + hold)", "stiff*(4 + hold)"]
    assert (model.loads[0].start.name, model.loads[0].end.name) == ("corner_2", "corner_1")
    assert model.independent == ("base", "rung_2.1", "rung_2.2", "rung_3.1", "rung_4.1", "rail_3")


def test_a_ladder_of_a_thousand_loops_parses_each_line_once():
    parse.cache_clear()
    model = parse_model(LADDER.replace("n: 4", "n: 1000"))
    assert len(model.loops) == 1000
    assert parse.cache_info().misses < 100
    assert len({(f.axes, f.start.at, f.end.at, f.end.rotation) for f in model.loops}) == 2


def test_all_of_a_joint_with_a_quaternion_is_independent():
    text = FOUR_BAR.replace(
        "points:", "  ball: {parent: crank, joint: {type: free}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}\npoints:"
    )
    model = parse_model(text.replace("[crank]", "[ball, crank]"))
    assert model.independent == ("ball.px", "ball.py", "ball.pz", "ball.qw", "ball.qx", "ball.qy", "ball.qz", "crank")


def test_a_body_that_a_loop_holds_needs_no_mass():
    rest = "at: [0, 0, L]}, shape: *bar}\npoints"
    massless = FOUR_BAR.replace(rest, "at: [0, 0, L]}}\npoints")
    assert parse_model(massless).loops
    opened = massless[: massless.index("loops:")] + massless[massless.index("forces:") :]
    with pytest.raises(ModelError, match="the revolute joint of 'rocker' moves no mass"):
        parse_model(opened)
    hanging = massless.replace("points:", "  tail: {parent: rocker, joint: {type: revolute, axis: y}}\npoints:")
    with pytest.raises(ModelError, match="the revolute joint of 'tail' moves no mass"):
        parse_model(hanging)


RIGID = """\
  tool: {parent: coupler, joint: {type: fixed}, mass: 1}
  tip: {parent: tool, joint: {type: fixed}, mass: 1}
  side: {parent: coupler, joint: {type: fixed}, mass: 1}
  plate: {parent: ground, joint: {type: fixed}}
  ball: {parent: crank, joint: {type: spherical}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
points:
"""
MANY = FOUR_BAR.replace("points:\n", RIGID)


def errors(text):
    with pytest.raises(ModelError) as info:
        parse_model(text, "m.yaml")
    return [f for f in str(info.value).splitlines() if "warning:" not in f]


JOINT, FROM = "joint: {type: revolute, axis: y}\n    from: end", "from: end"
TO = "to: {body: ground, at: [1.2*L, 0, 0], rotate: [{axis: y, angle: 0.1*L}]}"
ENDS = f"{FROM}\n    {TO}"
SPRING, HINT = "strut: {type: spring, from: end, to: ground, stiffness: 1}", "independent: [crank]"


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        # the joint
        (JOINT, "joint: {type: free}\n    from: end", "m.yaml:18:19: loops.foot.joint.type: a free joint sets no condition, so it closes no loop; one of fixed, revolute,* inline, distance, surface, curve is allowed"),
        (JOINT, "joint: {type: screw, axis: y}\n    from: end", "m.yaml:18:19: loops.foot.joint.type: a screw joint closes no loop, since its faces do not determine *"),
        (JOINT, "joint: {type: revolut, axis: y}\n    from: end", "m.yaml:18:19: loops.foot.joint.type: unknown loop joint type 'revolut'; *did you mean 'revolute'?"),
        (JOINT, "joint: {axis: y}\n    from: end", "m.yaml:18:12: loops.foot.joint: key 'type' is missing; one of fixed*"),
        (JOINT, "joint: revolute\n    from: end", "m.yaml:18:12: loops.foot.joint: 'revolute'; a mapping is needed with a type: one of fixed*"),
        (JOINT, "joint: {type: revolute}\n    from: end", "m.yaml:18:12: loops.foot.joint: key 'axis' is missing; keys here: type, axis"),
        (JOINT, "joint: {type: revolute, axis: [0, L - 1, 0]}\n    from: end", "m.yaml:18:35: loops.foot.joint.axis: the axis is zero at the default parameters; a direction is needed*"),
        (JOINT, "joint: {type: revolute, axis: up}\n    from: end", "m.yaml:18:35: loops.foot.joint.axis: 'up' is not an axis*"),
        (JOINT, "joint: {type: spherical, axis: y}\n    from: end", "m.yaml:18:30: loops.foot.joint.axis: unknown key 'axis'; keys here: type"),
        (JOINT, "joint: {type: universal, axes: [y]}\n    from: end", "m.yaml:18:36: loops.foot.joint.axes: too few numbers; two axes are needed*"),
        (JOINT, "joint: {type: universal, axes: [y, [0, 0, 0]]}\n    from: end", "m.yaml:18:40: loops.foot.joint.axes[1]: the axis is zero*"),
        (JOINT, "joint: {type: universal, axis: y}\n    from: end", "m.yaml:18:30: loops.foot.joint.axis: unknown key 'axis'; *did you mean 'axes'?"),
        (JOINT, "joint: {type: planar, axis: y}\n    from: end", "m.yaml:18:27: loops.foot.joint.axis: unknown key 'axis'; *did you mean 'normal'?"),
        (JOINT, "joint: {type: planar, normal: [0, 0, 0]}\n    from: end", "m.yaml:18:35: loops.foot.joint.normal: the axis is zero*"),
        (JOINT, "joint: {type: spherical, at: [0, 0, L]}\n    from: end", "m.yaml:18:30: loops.foot.joint.at: 'at' is not a key of a loop's joint; write it in from or to: *"),
        (JOINT, "joint: {type: revolute, axis: y, rpy: [0, 0, L]}\n    from: end", "m.yaml:18:38: loops.foot.joint.rpy: 'rpy' is not a key of a loop's joint*"),
        # the faces
        (f"    {FROM}\n", "", "m.yaml:18:5: loops.foot: key 'from' is missing; keys here: joint, from, to"),
        (FROM, "fro: end", "m.yaml:19:5: loops.foot.fro: unknown key 'fro'; keys here: joint, from, to; did you mean 'from'?"),
        (FROM, "from: edn", "m.yaml:19:11: loops.foot.from: unknown point 'edn'; a point or a body is allowed: end, crank*did you mean 'end'?"),
        (FROM, "from: 3rd", "m.yaml:19:11: loops.foot.from: '3rd' is not a valid name*"),
        (FROM, "from: [0, 0]", "m.yaml:19:11: loops.foot.from: a list of 2; the name of a point or a mapping is needed with the keys at, rotate, rpy, body"),
        (FROM, "from: {body: rockr}", "m.yaml:19:18: loops.foot.from.body: unknown body 'rockr'; ground or one of crank*did you mean 'rocker'?"),
        (FROM, "from: {bdy: rocker}", "m.yaml:19:12: loops.foot.from.bdy: unknown key 'bdy'; *did you mean 'body'?"),
        (FROM, "from: {at: [0, 0, 1]}", "m.yaml:19:11: loops.foot.from: key 'body' is missing; *"),
        (FROM, "from: {body: rocker, at: [0, 0, LL]}", "m.yaml:19:37: loops.foot.from.at[2]: unknown name 'LL'; *did you mean 'L'?"),
        (FROM, "from: {body: rocker, at: [0, 0, q.crank]}", "m.yaml:19:37: loops.foot.from.at[2]: 'q.crank', which changes with the motion, is not allowed here*"),
        ("angle: 0.1*L}]", "angle: 0}], rpy: [0, 0, 0]", "m.yaml:20:9: loops.foot.to: rotate and rpy are both given*"),
        ("rotate: [{axis: y,", "rotate: [{axis: [0, 0, 0],", "m.yaml:20:59: loops.foot.to.rotate[0].axis: the axis is zero*"),
        # names
        ("  foot:", "  crank:", "m.yaml:17:3: loops.crank: name 'crank' is already taken by a body; choose another name"),
        ("  foot:", "  ground:", "m.yaml:17:3: loops.ground: 'ground' is reserved and cannot name a loop*"),
        ("loops:", "loop:", "m.yaml:16:1: loop: unknown key 'loop'; *did you mean 'loops'?"),
        ("joint: crank,", "joint: foot,", "m.yaml:23:31: forces.drive.joint: unknown joint 'foot'; *'foot' closes a loop, and such a joint has no coordinates"),
        ("u.crank", "u.foot", "m.yaml:23:50: forces.drive.value: unknown speed 'u.foot'; *'foot' closes a loop, and such a joint has no coordinates"),
        ("q: {crank: 0.3", "q: {foot: 0.3", "m.yaml:26:7: initial.q.foot: unknown coordinate 'foot'; *'foot' closes a loop, and such a joint has no coordinates"),
        # between what cannot move
        (TO, "to: rocker", "m.yaml:20:9: loops.foot.to: loop 'foot' joins 'rocker' to itself, so it closes nothing; it needs two bodies that can move*"),
        (TO, "to: {at: [0, 0, L], body: rocker}", "m.yaml:20:31: loops.foot.to.body: loop 'foot' joins 'rocker' to itself*"),
        (ENDS, "from: ground\n    to: {body: ground, at: [1, 0, 0]}", "m.yaml:20:16: loops.foot.to.body: loop 'foot' joins the ground to itself*"),
        (ENDS, "from: plate\n    to: ground", "m.yaml:20:9: loops.foot.to: loop 'foot' joins 'plate' to the ground, which the fixed joint of plate holds together, so it closes nothing; *remove loop 'foot'"),
        (ENDS, "from: coupler\n    to: tip", "m.yaml:20:9: loops.foot.to: loop 'foot' joins 'coupler' to 'tip', which the fixed joints of tool, tip hold together*"),
        (ENDS, "from: tip\n    to: side", "m.yaml:20:9: loops.foot.to: loop 'foot' joins 'tip' to 'side', which the fixed joints of tip, tool, side hold together*"),
        (ENDS, "from: tip\n    to: tool", "m.yaml:20:9: loops.foot.to: loop 'foot' joins 'tip' to 'tool', which the fixed joint of tip holds together*"),
        (SPRING, "strut: {type: spring, from: end, to: rocker, stiffness: 1}", "m.yaml:24:40: forces.strut.to: spring 'strut' joins 'rocker' to itself, so it moves nothing*"),
        (SPRING, "strut: {type: spring, from: tip, to: tool, stiffness: 1}", "m.yaml:24:40: forces.strut.to: spring 'strut' joins 'tip' to 'tool', which the fixed joint of tip holds together, so it moves nothing*"),
        # springs
        (", stiffness: 1}", "}", "m.yaml:24:10: forces.strut: key 'stiffness' is missing; keys here: type, from, to, stiffness, damping, free_length"),
        (", stiffness: 1}", ", stifness: 1}", "m.yaml:24:48: forces.strut.stifness: unknown key 'stifness'; *did you mean 'stiffness'?"),
        (", stiffness: 1}", ", stiffness: q.crank}", "m.yaml:24:59: forces.strut.stiffness: 'q.crank', which changes with the motion, is not allowed here; only numbers, constants, parameters, inputs and t are"),
        (", stiffness: 1}", ", stiffness: 1, damping: u.crank}", "m.yaml:24:71: forces.strut.damping: 'u.crank', which changes with the motion, is not allowed here*"),
        (", stiffness: 1}", ", stiffness: 1, free_length: 1/(L - 1)}", "m.yaml:24:75: forces.strut.free_length: 1/(L - 1) has no finite value at the default parameters: division by zero"),
        (", stiffness: 1}", ", stiffness: pul}", "m.yaml:24:59: forces.strut.stiffness: unknown name 'pul'; known here: L, k, c, pull, t; did you mean 'pull'?"),
        ("from: end, to: ground, s", "from: edn, to: ground, s", "m.yaml:24:31: forces.strut.from: unknown point 'edn'; *did you mean 'end'?"),
        ("from: end, to: ground, s", "from: end, to: {body: crnk}, s", "m.yaml:24:47: forces.strut.to.body: unknown body 'crnk'; *did you mean 'crank'?"),
        ("from: end, to: ground, s", "from: end, to: {body: ground, rpy: [0, 0, 0]}, s", "m.yaml:24:55: forces.strut.to.rpy: unknown key 'rpy'; keys here: body, at"),
        ("from: end, to: ground, s", "to: ground, s", "m.yaml:24:10: forces.strut: key 'from' is missing*"),
        ("strut: {type: spring, ", "strut: {", "m.yaml:24:10: forces.strut: key 'type' is missing; one of joint, spring, force, torque, torsion, * is needed"),
        ("strut: {type: spring, ", "strut: {type: sprin, ", "m.yaml:24:17: forces.strut.type: unknown force type 'sprin'; one of joint, spring, force, torque, torsion, * is allowed; did you mean 'spring'?"),
        # the hint
        (HINT, "independent: crank", "m.yaml:27:14: independent: 'crank'; a list of names is needed: [crank]"),
        (HINT, "independent: [crnk]", "m.yaml:27:15: independent[0]: unknown coordinate or joint 'crnk'; allowed are crank, coupler, rocker, ball; did you mean 'crank'?"),
        (HINT, "independent: [q.crank]", "m.yaml:27:15: independent[0]: unknown coordinate or joint 'q.crank'; *did you mean 'crank'?"),
        (HINT, "independent: [crank, rocker, crank]", "m.yaml:27:30: independent[2]: 'crank' repeats crank; each coordinate may be given once"),
        (HINT, "independent: [crank.1]", "m.yaml:27:15: independent[0]: unknown coordinate or joint 'crank.1'; *did you mean 'crank'?"),
        (HINT, "independent: [ball.qx]", "m.yaml:27:15: independent[0]: ball.qx is one component of the spherical joint 'ball', *write ball for the whole joint"),
        (HINT, "independent: [plate]", "m.yaml:27:15: independent[0]: joint 'plate' is fixed and has no coordinates; leave it out"),
        (HINT, "independent: [foot]", "m.yaml:27:15: independent[0]: unknown coordinate or joint 'foot'; *'foot' closes a loop, and such a joint has no coordinates"),
        (HINT, "independent: [crank(k)]", "m.yaml:27:15: independent[0]: index (k) has no value; constants*"),
        (HINT, "independent: [[crank]]", "m.yaml:27:15: independent[0]: a list of 1; a name is needed"),
        (HINT, "independent: [{crank: 1}]", "m.yaml:27:23: independent[0].crank: '1' after a name; the names of this list have no value"),
    ],
)  # fmt: skip
def test_each_mistake_has_its_place_and_its_cure(old, new, line):
    assert old in MANY
    found = errors(MANY.replace(old, new, 1))
    start, *others = (part for part in line.split("*") if part)
    matching = [f for f in found if f.startswith(start) and all(p in f for p in others)]
    assert matching, "\n".join(found)
    assert len(found) == 1 or old in ("  foot:",), "\n".join(found)  # one mistake, one message


def test_the_model_with_rigid_bodies_is_good():
    assert len(parse_model(MANY).bodies) == 8


def test_all_mistakes_at_once_and_the_rest_of_a_wrong_entry_too():
    text = MANY.replace(JOINT, "joint: {type: revolut}\n    from: {body: rockr}").replace("[1.2*L,", "[1.2*M,")
    text = text.replace(SPRING, "strut: {type: spring, from: edn, to: {bdy: crank}, stiffness: K, dampng: 3}")
    text = text.replace(HINT, "independent: [crnk, 3]")
    assert [f.split(" ")[1] for f in errors(text)] == [
        "loops.foot.joint.type:", "loops.foot.from.body:", "loops.foot.to.at[0]:", "forces.strut.from:",
        "forces.strut.to.bdy:", "forces.strut.stiffness:", "forces.strut.dampng:", "independent[0]:", "independent[1]:",
    ]  # fmt: skip


def test_a_wrong_body_hides_no_loop_and_no_hint():
    found = errors(
        MANY.replace(
            "rocker: {parent: coupler, joint: {type: revolute,", "rocker: {parent: coupler, joint: {type: revolut,"
        )
    )
    assert len(found) == 1


def test_a_mistake_in_a_repeated_loop_is_said_once():
    found = errors(LADDER.replace("at: [L, 0, 2*L]", "at: [L, 0, 2*M]"))
    assert found == ["m.yaml:26:42: loops.close(i).to.at[2]: unknown name 'M'; known here: n, L, stiff (i = 2)"]
    (found,) = errors(LADDER.replace("to: {body: rung(i-1)", "to: {body: rung(i)"))
    assert "loop 'close_2' joins 'rung_2' to itself" in found
    assert "(i = 2)" in found


def test_the_builder_reports_the_same_way():
    b = ModelBuilder("m")
    b.body("a", joint="free", mass=1, inertia={"xx": 1, "yy": 1, "zz": 1})
    b.loop("a", "fixed", "a", "ground")
    b.loop("c", "free", "a", "ground")
    b.spring("s", "a", {"body": "b"}, "q.a.px")
    b.independent("a.px")
    with pytest.raises(ModelError) as info:
        b.build()
    text = str(info.value)
    assert "builder: loops.a: name 'a' is already taken by a body" in text
    assert "builder: loops.c.joint.type: a free joint sets no condition" in text
    assert "builder: forces.s.to.body: unknown body 'b'" in text
    assert "builder: forces.s.stiffness: 'q.a.px', which changes with the motion" in text
    assert "builder: independent[0]: a.px is one component of the free joint 'a'" in text


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_damaged_files_are_models_or_model_errors(data):
    text = MANY
    begin = text.index("points:")
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(begin, len(text)))
        stop = data.draw(st.integers(start, min(len(text), start + 12)))
        new = data.draw(
            st.one_of(
                st.text(max_size=5),
                st.sampled_from(["[", "}", ": ", "end", "ground", "\n  ", "from", "crank", "u.crank"]),
            )
        )
        text = text[:start] + new + text[stop:]
    try:
        parse_model(text)
    except ModelError as error:
        assert str(error)
