# ruff: noqa: E501  (the tables of mistakes read better in one line each)
"""Bad input: all problems at once, each with its place, its key, the value seen, and the values allowed."""

import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen.model import ModelBuilder, ModelError, load_model, parse_model

GOOD = """\
model: m
gravity: [0, 0, -9.81]
parameters:
  L: 1.0
inputs: [motor]
bodies:
  arm:
    parent: ground
    joint: {type: revolute, axis: y}
    mass: 2*L
    inertia: {yy: 0.1}
  hand:
    parent: arm
    joint: {type: spherical, at: [0, 0, L]}
    mass: 1
    inertia: {xx: 1, yy: 1, zz: 1}
forces:
  drive: {type: joint, joint: arm, value: motor - 0.1*u.arm}
outputs:
  height: {position: hand, axis: z}
"""


def problems(text):
    with pytest.raises(ModelError) as info:
        parse_model(text, "m.yaml")
    return str(info.value).splitlines()


def swapped(old, new):
    assert old in GOOD
    return GOOD.replace(old, new)


def test_the_model_the_others_are_made_from_is_good():
    assert parse_model(GOOD).warnings == ("<string>:11:14: warning: bodies.arm.inertia: the principal moments of 'arm', "
        "0, 0, 0.1, violate the triangle inequality (0.1 > 0 + 0), which is impossible; it has no effect in a planar model",)  # fmt: skip


@pytest.mark.parametrize(
    ("joint", "warns"),
    [
        ("{type: revolute, axis: -y}", False), ("{type: prismatic, axis: [1, 0, 1]}", False), ("{type: fixed}", False),
        ("{type: revolute, axis: x}", True), ("{type: prismatic, axis: [1, 1, 0]}", True), ("{type: spherical}", True),
        ("{type: revolute, axis: y, rotate: [{axis: z, angle: 0.3}]}", True), ("{type: screw, axis: y, pitch: 0.1}", True),
    ],
)  # fmt: skip
def test_moments_without_effect_in_planar_models_cause_no_warning(joint, warns):
    body = "{{parent: {}, joint: {}, mass: 1, inertia: {{{}}}}}"
    model = "model: m\nbodies:\n  a: " + body.format("ground", "{type: revolute, axis: y}", "yy: 0.1") + "\n  b: "
    said = parse_model(model + body.format("a", joint, "xx: 1, yy: 1, zz: 1")).warnings
    assert any("triangle" in w for w in said) == warns


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("    mass: 2*L", "    mas: 2*L", "m.yaml:10:5: bodies.arm.mas: unknown key 'mas'; * did you mean 'mass'?"),
        ("type: revolute", "type: revolut", "m.yaml:9:19: bodies.arm.joint.type: unknown joint type 'revolut'; * 'revolute'?"),
        ("type: revolute", "type: screw", "m.yaml:9:12: bodies.arm.joint: key 'pitch' is missing*"),
        ("joint: {type: revolute, axis: y}", "joint: {axis: y}", "m.yaml:9:12: bodies.arm.joint: key 'type' is missing*"),
        (", axis: y}", "}", "m.yaml:9:12: bodies.arm.joint: key 'axis' is missing*"),
        ("2*L", "2*LL", "m.yaml:10:13: bodies.arm.mass: unknown name 'LL'; known here: L; did you mean 'L'?"),
        ("2*L", "2*t", "m.yaml:10:13: bodies.arm.mass: 't', which changes with the motion, is not allowed here*"),
        ("2*L", "2*motor", "m.yaml:10:13: bodies.arm.mass: input 'motor' is not allowed here*"),
        ("u.arm", "u.amr", "m.yaml:18:55: forces.drive.value: unknown speed 'u.amr'; * did you mean 'u.arm'?"),
        ("u.arm", "q.hand", "m.yaml:18:55: forces.drive.value: q.hand has several degrees of freedom; write one of q.hand.qw*"),
        ("parent: arm", "parent: amr", "m.yaml:13:13: bodies.hand.parent: unknown body 'amr'; * did you mean 'arm'?"),
        ("parent: ground", "parent: hand", "m.yaml:8:13: bodies.arm.parent: the parents form a circle, arm -> hand -> arm*"),
        ("parent: ground", "parent: arm", "m.yaml:8:13: bodies.arm.parent: body 'arm' is its own parent*"),
        ("    parent: arm\n", "", "m.yaml:13:5: bodies.hand: key 'parent' is missing*"),
        ("2*L", "-2*L", "m.yaml:10:11: bodies.arm.mass: mass of 'arm', (-2)*L = -2, is negative*"),
        ("yy: 1,", "yy: -1,", "m.yaml:16:14: bodies.hand.inertia: the inertia of 'hand' has the negative principal moment -1*"),
        ("axis: y}", "axis: [0, 0, L - 1]}", "m.yaml:9:35: bodies.arm.joint.axis: the axis is zero*"),
        ("axis: y}", "axis: w}", "m.yaml:9:35: bodies.arm.joint.axis: 'w' is not an axis*"),
        ("  hand:", "  arm:", "m.yaml:12:3: bodies: key 'arm' is already used on line 7*"),
        ("inputs: [motor]", "inputs: [L]", "m.yaml:5:10: inputs[0]: name 'L' is already taken by a parameter*"),
        ("  hand:", "  3rd:", "m.yaml:12:3: bodies.3rd: '3rd' is not a valid name*"),
        ("  L: 1.0", "  sin: 1.0", "m.yaml:4:3: parameters.sin: 'sin' is reserved*"),
        ("model: m", "model:m", "m.yaml:2:8: this is not YAML: a colon is not allowed here; a line above may lack the space after its colon*"),
        ("model: m", "model: while", "m.yaml:1:8: model: 'while' is a reserved word*"),
        ("model: m", "model: 4bar", "m.yaml:1:8: model: '4bar' is not a valid name*"),
        ("mass: 1\n", "mass: __import__('os')\n", "m.yaml:15:22: bodies.hand.mass: \"__import__('os')\"*"),
        ("L: 1.0", "L: 1e999", "m.yaml:4:6: parameters.L: '1e999': number 1e999 is too large*"),
        ("L: 1.0", "L: 10**400", "m.yaml:4:6: parameters.L: 10**400 is too large*"),
        ("L: 1.0", "L: .nan", "m.yaml:4:6: parameters.L: '.nan': character '.'*finite*"),
        ("2*L", "1/(L - 1)", "m.yaml:10:11: bodies.arm.mass: 1/(L - 1) has no finite value * division by zero"),
        ("at: [0, 0, L]", "at: [0, L]", "m.yaml:14:34: bodies.hand.joint.at: too few numbers; three numbers*"),
        ("at: [0, 0, L]", "at: 3", "m.yaml:14:34: bodies.hand.joint.at: '3'; three numbers are needed*"),
        ("motor - 0.1*u.arm", "[1, 2]", "m.yaml:18:43: forces.drive.value: 2 values for the revolute joint 'arm'; 1 are*"),
        ("type: joint", "type: body", "m.yaml:18:17: forces.drive.type: unknown force type 'body'; one of joint, *"),
        ("type: joint", "type: damper", "m.yaml:18:17: forces.drive.type: unknown force type 'damper'; *did you mean 'spring'?"),
        ("joint: arm,", "joint: amr,", "m.yaml:18:31: forces.drive.joint: unknown joint 'amr'; *did you mean 'arm'?"),
        ("position: hand", "position: tip", "m.yaml:20:22: outputs.height.position: unknown point 'tip'*"),
        (", axis: z}", "}", "m.yaml:20:11: outputs.height: position needs axis*"),
        ("type: revolute", "type: planar", "m.yaml:9:*: bodies.arm.joint.axis: unknown key 'axis'; keys here: at, rotate, rpy, armature, type, normal; did you mean 'normal'*"),
        ("outputs:", "ouputs:", "m.yaml:19:1: ouputs: unknown key 'ouputs'; * did you mean 'outputs'?"),
        ("gravity: [0, 0, -9.81]", "gravity: -9.81", "m.yaml:2:10: gravity: '-9.81'; three numbers are needed*"),
        ("    mass: 2*L", "    mass:", "m.yaml:10:10: bodies.arm.mass: nothing; a number or an expression is needed"),
        ("mass: 2*L", "mass: !!python/name:os.system 2", "m.yaml:10:11: bodies.arm.mass: tag * is not allowed in a model file*"),
        ("inertia: {yy: 0.1}", "first: {mass: 1}", "m.yaml:11:5: bodies.arm.first: 'first' is only allowed directly inside*"),
    ],
)  # fmt: skip
def test_each_mistake_has_its_place_and_its_cure(old, new, line):
    found = problems(swapped(old, new))
    parts = line.split("*")
    if line.startswith(("m.yaml:10:11: bodies.arm.mass: 1/", "m.yaml:4:6: parameters.L: 10**")):
        parts = [line] if "10**400" in line else [line.split(" * ")[0], line.split(" * ")[1]]
        parts = [p.rstrip("*") for p in parts]
    elif "(-2)*L" in line or "2*" in line:
        parts = [line.rstrip("*")]
    errors = [f for f in found if "warning:" not in f]
    matching = [f for f in errors if f.startswith(parts[0]) and all(p in f for p in parts)]
    assert matching, "\n".join(found)
    renames = ("  hand:", "  L: 1.0", "inputs: [motor]")  # these leave names without a meaning
    assert len(errors) == 1 or old in renames, "\n".join(found)  # one mistake, one message


def test_all_errors_at_once_and_in_the_order_of_the_file():
    text = swapped("    mass: 2*L", "    mas: 2*L").replace("L: 1.0", "L: 1..0").replace("mass: 1\n", "mass: -1\n")
    text = text.replace("position: hand", "position: hnad").replace("u.arm", "x")
    found = problems(text)
    assert [f.split(":")[1] for f in found if "warning" not in f] == ["4", "10", "15", "18", "20"]


def test_the_rest_of_a_wrong_entry_is_read_too():
    text = swapped("    mass: 2*L", "    mas: 2\n    com: [0, 0, Q]").replace("parent: ground", "parent: grund")
    text = text.replace("{xx: 1, yy: 1, zz: 1}", "{xx: 1, yx: 1, zz: P}").replace("[0, 0, L]", "[0, 0, L")
    found = problems(text.replace("[0, 0, L", "[0, 0, L]"))
    assert [f.split(" ")[0] for f in found if "warning" not in f] == [
        "m.yaml:8:13:", "m.yaml:10:5:", "m.yaml:11:17:", "m.yaml:17:22:", "m.yaml:17:33:",
    ], found  # fmt: skip


def test_problems_are_data():
    with pytest.raises(ModelError) as info:
        parse_model(swapped("mass: 1\n", "mass: x y\n"), "m.yaml")
    (problem,) = [p for p in info.value.problems if p.severity == "error"]
    assert (problem.file, problem.line, problem.column, problem.path) == ("m.yaml", 15, 13, "bodies.hand.mass")


def test_an_unused_parameter_is_a_warning():
    model = parse_model(swapped("  L: 1.0", "  L: 1.0\n  spare: 2"), "m.yaml")
    assert "m.yaml:5:3: warning: parameters.spare: parameter 'spare' is not used" in model.warnings


def test_massless_ends_of_a_branch():
    found = problems(
        "model: m\nbodies:\n"
        "  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [1, 0, 0]}\n"
        "  b: {parent: a, joint: {type: fixed}}\n"
        "  c: {parent: b, joint: {type: revolute, axis: y}}\n"
        "  d: {parent: c, joint: {type: prismatic, axis: x}}\n"
    )
    assert len(found) == 1
    assert found[0].startswith("m.yaml:5:25: bodies.c.joint: the revolute joint of 'c' moves no mass")


@pytest.mark.parametrize(
    ("joint", "rest"),
    [
        ("revolute, axis: y", "mass: 1"),
        ("revolute, axis: z", "shape: {type: rod, axis: z, length: 1, mass: 1}"),
        ("spherical", "shape: {type: rod, axis: z, length: 1, mass: 1, center: [0, 0, 1]}"),
        ("prismatic, axis: y", "inertia: {xx: 1, yy: 1, zz: 1}"),
        ("free", "mass: 1"),
    ],
)
def test_a_freedom_without_inertia_names_its_body(joint, rest):
    found = problems(f"model: m\nbodies:\n  ball: {{parent: ground, joint: {{type: {joint}}}, {rest}}}\n")
    assert len(found) == 1
    assert "bodies.ball.joint" in found[0]
    assert "'ball'" in found[0]


def test_universal_axes_are_perpendicular():
    text = GOOD.replace("{type: spherical,", "{type: universal, axes: [y, [1, 1e-6, 0]],")
    assert "bodies.hand.joint.axes: the two axes have cosine 1e-06" in problems(text)[0]


def test_quaternions():
    off = GOOD + "initial: {q: {hand: [1, 0, 0, 0.1]}}\n"
    assert "m.yaml:21:21: initial.q.hand" in problems(off)[0]
    model = parse_model(GOOD + "initial: {q: {hand: [0.7071, 0, 0.7071, 0]}}\n")
    assert "was normalised" in model.warnings[-1] or "was normalised" in " ".join(model.warnings)
    values = [model.initial_q[f"hand.q{c}"].value for c in "wxyz"]
    assert sum(v * v for v in values) == pytest.approx(1, abs=1e-15)


def test_a_mistake_in_a_repeated_entry_is_said_once():
    text = (
        "model: m\nbodies:\n  repeat k in 1..50:\n    a(k):\n      parent: a(k-1)\n"
        "      first: {parent: ground}\n      joint: {type: revolute, axis: y}\n      mass: m*k\n      com: [1, 0, 0]\n"
    )
    assert problems(text) == ["m.yaml:8:13: bodies.a(k).mass: unknown name 'm'; known here: (none) (k = 1)"]
    missing = text.replace("      first: {parent: ground}\n", "").replace("m*k", "k")
    assert "first: {parent: ground}" in problems(missing)[0]


@pytest.mark.parametrize(
    "header",
    ["repeat", "repeat k", "repeat k in", "repeat k in 1..x", "repeat k in 1..2.5", "repeat t in 1..3", "repeat k in 1..9 step 0",
     "repeat k in 1..9999999", "repeat k in a b", "repeat k in left, left"],
)  # fmt: skip
def test_bad_repetitions(header):
    found = problems(f"model: m\nbodies:\n  {header}:\n    a(k): {{parent: ground, joint: {{type: free}}, mass: 1}}\n")
    assert any(f.startswith("m.yaml:3:3: bodies.repeat") for f in found), found


@pytest.mark.parametrize(
    "text",
    [
        "", "   \n", "- a", "just text", "a: [", "a: b: c", "\t- a", "a: *b", "? [a]\n: 1", "--- {}\n--- {}", "\x00\x01", "%",
        "a: &a [*a]", "[" * 100_000, "{a: " * 50_000, "- " * 10_000, "<<: 3", "a: \ud800", "&a", "!!python/object:os.system {}",
        "\n".join(" " * i + "a:" for i in range(2000)), "bodies: 3\ninputs: 4\ninitial: 5\nforces: x\nconstants: [1]",
    ],
)  # fmt: skip
def test_what_is_no_model_is_a_model_error(text):
    for line in problems(text):
        assert line.startswith("m.yaml:")


def test_aliases_do_not_explode():
    layers = "\n".join(f"{b}: &{b} [{', '.join(['*' + a] * 10)}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True))
    assert "aliases repeat more than" in problems(f"a: &a [x]\n{layers}\n")[0]


@pytest.mark.parametrize("text", ["a: *{name}", "a: &{name} [*{name}]"])
def test_names_of_aliases_are_cut(text):
    (told,) = problems(text.format(name="n" * 5000))
    assert "nnn..." in told and len(told) < 300


def test_anchors_and_merge_keys_work():
    text = GOOD.replace("inertia: {xx: 1, yy: 1, zz: 1}", "inertia: &ball {xx: 1, yy: 1, zz: 1}")
    text = (
        text.replace("inertia: {yy: 0.1}", "inertia: {<<: *ball, zz: 2}")
        .replace("bodies:", "x-: 1\nbodies:")
        .replace("x-: 1\n", "")
    )
    with pytest.raises(ModelError):
        parse_model(text)  # an alias before its anchor
    first, second = text.index("  arm:"), text.index("  hand:")
    end = text.index("forces:")
    model = parse_model(text[:first] + text[second:end] + text[first:second] + text[end:])
    assert [e.value for e in model.bodies[1].inertia][:3] == [1, 1, 2]


def test_paths_and_other_objects_in_place_of_a_text():
    assert problems("parts/m.yml") == [
        "m.yaml:1:1: 'parts/m.yml' is the path of a file; the text of a model is needed here, and load_model reads a file"
    ]
    for other in (3, Path("m.yaml")):
        with pytest.raises(TypeError, match="is given; the text of a model is needed; load_model reads a file"):
            parse_model(other)


@pytest.mark.parametrize(
    "text", ["<robot name='a'/>", "\n<?xml version='1.0'?>\n<sdf>\n<model/></sdf>\n", "<!-- a -->\n<mujoco/>"]
)
def test_robots_are_imported(text):
    assert problems(text) == [
        "m.yaml:1:1: this is XML, not a model; a robot in URDF, MJCF or SDF is converted by: ordernm import m.yaml"
    ]


def test_unreadable_files(tmp_path):
    for path in (tmp_path / "missing.yaml", tmp_path):
        with pytest.raises(ModelError) as info:
            load_model(path)
        assert str(info.value).startswith(f"{path}:1:1: cannot be read")
    with pytest.raises(
        ModelError, match=r"^<string>: this is the text of a model; a path is needed here, and parse_model"
    ):
        load_model(GOOD)
    for other, article in ((3, "an int"), (b"model.yaml", "a bytes"), (parse_model(GOOD), "a Model")):
        with pytest.raises(TypeError, match=f"^{article} is given; a Model, or the path of its file, is needed"):
            load_model(other)
    (tmp_path / "binary.yaml").write_bytes(b"model: m\nx: \xff\xfe")
    with pytest.raises(ModelError) as info:
        load_model(os.fspath(tmp_path / "binary.yaml"))
    assert "binary.yaml:2:4: byte 0xff" in str(info.value)


def test_the_builder_reports_the_same_way():
    b = ModelBuilder("m")
    b.body("a", parent="b", axis="y", mass=float("nan"))
    b.body("a")
    b.body("c", joint="revolut")
    with pytest.raises(ModelError) as info:
        b.build()
    text = str(info.value)
    assert "builder: bodies.a: name 'a' is given twice" in text
    assert "builder: bodies.a.mass: nan" in text
    assert "builder: bodies.a.parent: unknown body 'b'" in text
    assert "builder: bodies.c.joint.type: unknown joint type 'revolut'" in text


@pytest.mark.parametrize(
    "change, said",
    [
        (lambda b: b.initial(q=np.zeros(2)), "initial.q: ndarray; a mapping from names to values is needed"),
        (lambda b: b.initial(u="a"), "initial.u: str; a mapping from names to values is needed"),
        (lambda b: b.input({1: 2}), "inputs"),
        (lambda b: b.independent({1: 2}), "independent"),
        (lambda b: b.constant("c", {1: {2: 3}}), "constants.c"),
        (lambda b: b.output("e", np.array([])), "outputs.e"),
        (lambda b: b.output("e", measure=["kinetic_energy"]), "outputs.e"),
        (lambda b: b.body("c", joint={"type": np.array([])}), "bodies.c.joint.type"),
        (lambda b: b.body("c", shape={"type": {}}), "bodies.c.shape.type"),
        (lambda b: b.loop("l", {"type": np.array([])}, "a", "ground"), "loops.l.joint.type"),
    ],
)
def test_whatever_python_gives_the_builder_is_told(change, said):
    b = ModelBuilder("m")
    b.body("a", axis="y", mass=1, com=[0.1, 0, 0], inertia={"xx": 1, "yy": 1, "zz": 1})
    b.build()
    change(b)
    with pytest.raises(ModelError) as info:
        b.build()
    assert f"builder: {said}" in str(info.value)


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_damaged_files_are_models_or_model_errors(data):
    text = GOOD
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        stop = data.draw(st.integers(start, min(len(text), start + 12)))
        new = data.draw(
            st.one_of(st.text(max_size=5), st.sampled_from(["[", "}", ": ", "repeat k in 1..3:", "\n  ", "*", "first"]))
        )
        text = text[:start] + new + text[stop:]
    try:
        parse_model(text)
    except ModelError as error:
        assert str(error)


@settings(max_examples=200, deadline=None)
@given(
    st.recursive(
        st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=4), st.sampled_from(["ground", "a", "y", "joint"])),
        lambda inner: st.one_of(
            st.lists(inner, max_size=4),
            st.dictionaries(st.sampled_from(["type", "joint", "parent", "mass", "shape", "axis", "at", "q", "a", "value", "body", "from", "to"]), inner),
        ),
        max_leaves=8,
    ),
    st.sampled_from(["gravity", "constants", "parameters", "inputs", "bodies", "points", "forces", "initial", "outputs", "loops", "independent", "model"]),
)  # fmt: skip
def test_any_structure_anywhere_is_a_model_or_a_model_error(value, section):
    import yaml

    for root in ({"model": "m", section: value}, {"model": "m", "bodies": {"a": value}, section: {"a": value}}):
        try:
            parse_model(yaml.safe_dump(root))
        except ModelError as error:
            assert str(error)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: {b: 1\nc: 2", "2:2: this is not YAML: the { of line 1 is not closed before this place, or a comma is missing"),
        ("a: [1, 2\nb: 3", "2:2: this is not YAML: the [ of line 1 is not closed before this place, or a comma is missing"),
        ("a: {b: c: 1}", "1:9: this is not YAML: the { of line 1 is not closed before this place, or a comma is missing"),
        ("b: 1\na: 'x\nc: 2\n", "2:4: this is not YAML: the quote that begins here is not closed"),
        ('a: "x\ny: 2\n', "1:4: this is not YAML: the quote that begins here is not closed"),
        ("a:\n\t- 1\n", "2:1: this is not YAML: a tab is not allowed here; indent with spaces"),
        ("a: 1\n  b: 2\n", "2:4: this is not YAML: a colon is not allowed here; * indented too far"),
        ("- a\nb: 1", "2:1: this is not YAML: the list from line 1 on ends here"),
        ('a: "\\q"', "1:4: this is not YAML: an unknown escape after \\ in double quotes"),
        ("a: @x", "1:4: this is not YAML: a value does not begin with '@'; a text that does needs quotes"),
        ("a: ]\n", "1:4: this is not YAML: a value does not begin with ']'"),
        ("a: |bad\n", "1:4: this is not YAML: a text after | or > begins on the next line"),
        ("a: > bad\n", "1:4: this is not YAML: a text after | or > begins on the next line"),
        ("a: &\n", "1:4: this is not YAML: a name is needed after &"),
        ("a: *\n", "1:4: this is not YAML: a name is needed after *"),
        ("a: !<x\n", "1:4: this is not YAML: a value that begins with ! is not allowed"),
        ("%TAG foo", "1:1: this is not YAML: a line that begins with % is not allowed"),
        ("%YAML 3.0\n---\na: 1", "1:1: this is not YAML: a line that begins with % is not allowed"),
        ("a: 1\nb\n", "2:1: this is not YAML: this line has no colon"),
        ("a: {b: 1}}\n", "1:10: this is not YAML: } closes nothing here"),
        ("a:\n  b: 1\n c: 2\n", "3:2: this is not YAML: a key with a colon is needed here, at the same indentation as * line 1"),
        ("key: - 1\n", "1:6: this is not YAML: a list does not begin on the line of its key"),
        ("a: ? b", "1:4: this is not YAML: ? is not allowed here"),
        ("a: 1\n...\nb", "3:1: this is not YAML: the document has ended above this line"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("loader", ["CBaseLoader", "BaseLoader"])
def test_faults_of_yaml_are_named_in_words_of_the_project(text, message, loader, monkeypatch):
    if loader == "BaseLoader":
        monkeypatch.delattr(yaml, "CBaseLoader", raising=False)
    with pytest.raises(ModelError) as caught:
        parse_model(text, "m.yaml")
    (line,) = str(caught.value).splitlines()
    before, _, after = message.partition(" * ")
    assert after in line and not any(words in line for words in ("while ", "expected", "token", "scalar", "mapping"))
    place, _, words = before.partition(": ")
    assert words in line
    if loader == "CBaseLoader":
        assert line.startswith(f"m.yaml:{place}: ")
