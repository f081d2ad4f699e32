# ruff: noqa: E501  (tables)
"""Strange, very large and damaged model files: an error within a time limit, and no other effect."""

from __future__ import annotations

import math
import re
import time
import warnings

import pytest
from model_mutations import FILE, bases, judge, mutated

from codegen.cli import main
from codegen.model import ModelBuilder, ModelError, parse_model
from codegen.model.repetition import MAX_REPETITIONS
from codegen.model.sections.bodies import MAX_BODIES

ARM = """\
model: arm
parameters: {L: 1.0}
bodies:
  arm:
    parent: ground
    joint: {type: revolute, axis: y}
    mass: 1
    com: [0, 0, -L]
    inertia: {xx: 1, yy: 1, zz: 1}
"""


def refused(text: str) -> list[str]:
    with pytest.raises(ModelError) as info, warnings.catch_warnings():
        warnings.simplefilter("error")
        parse_model(text, FILE)
    return [str(p) for p in info.value.problems if p.severity == "error"]


def swapped(old: str, new: str) -> str:
    assert old in ARM
    return ARM.replace(old, new)


def test_the_texts_that_are_damaged_are_good() -> None:
    assert len(bases()) >= 20
    for base in bases():
        verdict = judge(base.text)
        assert verdict.kind == "model", verdict


@pytest.mark.parametrize("chunk", range(4))
def test_damaged_models_are_models_or_model_errors(chunk: int) -> None:
    """A sample of the campaign in tests/campaigns/mutated_models.py."""
    kinds = []
    for seed in range(chunk, 600, 4):
        verdict = judge(mutated(seed))
        assert verdict.kind != "failed", f"seed {seed}: {verdict.why}"
        kinds.append(verdict.kind)
    assert 0 < kinds.count("model") < kinds.count("refused")


def test_a_seed_names_one_text() -> None:
    assert mutated(17) == mutated(17) != mutated(18)


def test_a_name_that_vanished_is_unknown_wherever_a_repeated_shape_uses_it() -> None:
    # every repetition fails where the first one did; that it was said once does not make the others sound
    text = """\
model: m
bodies:
  repeat k in 1..3:
    a(k):
      parent: ground
      joint: {type: revolute, axis: y}
      shape: {type: cylinder, axis: z, length: k, radius: radius, density: density*k, center: [0, 0, 1]}
"""
    assert refused(text) == [
        "m.yaml:7:59: bodies.a(k).shape.radius: unknown name 'radius'; known here: (none) (k = 1)",
        "m.yaml:7:76: bodies.a(k).shape.density: unknown name 'density'; known here: (none) (k = 1)",
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ARM.replace("revolute, axis: y", "spherical") + "initial: {q: {arm: [1e308, 0, 0, 0]}}\n", "has length 1e+308; 1 is needed"),
        (swapped("axis: y", "axis: [1e200, 0, 0]"), "bodies.arm.joint.axis: the axis has a length of about 1e+200"),
        (swapped("axis: y", "axis: [0, 5e-324, 0]"), "the axis has a length of about 4.9e-324"),
        (swapped("revolute, axis: y", "universal, axes: [[1e200, 0, 0], y]"), "the axis has a length of about 1e+200"),
        (swapped("mass: 1\n", "mass: 1" + 5001 * "0" + "\n"), "number 100000000000000000000000000... is too large; up to 1.8e308"),
        (swapped("mass: 1\n", "mass: " + 40 * "a" + 9960 * "b" + "\n"), "unknown name"),
    ],
)  # fmt: skip
def test_numbers_beyond_every_model(text: str, said: str) -> None:
    (line,) = refused(text)
    assert said in line
    assert len(line) < 1500


@pytest.mark.parametrize("zeros", [4999, 5001])
def test_leading_zeros_are_refused(zeros: int) -> None:
    (line,) = refused(swapped("mass: 1\n", f"mass: {zeros * '0'}7\n"))
    assert line.endswith("begins with 0; remove the leading zeros")
    assert len(line) < 200


@pytest.mark.parametrize(
    "number", [10**5001, -(10**400), 1e999, float("nan")], ids=["5002 digits", "-10**400", "inf", "nan"]
)
def test_numbers_of_python_beyond_every_model(number: float) -> None:
    b = ModelBuilder("m")
    b.body("a", mass=number, axis="y", com=[1, 0, 0])
    with pytest.raises(ModelError, match=r"builder: bodies\.a\.mass: .* a finite number or an expression is needed"):
        b.build()


def test_bodies_of_huge_mass_and_size_are_checked_without_a_warning_of_numpy() -> None:
    text = swapped("mass: 1\n", "mass: 1e200\n").replace("[0, 0, -L]", "[1e200, 0, 0]")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert math.isfinite(parse_model(text).bodies[0].mass.value)


BARS = """\
model: bars
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0.5, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
  b: {parent: a, joint: {type: revolute, axis: y, at: [1, 0, 0]}, mass: 1, com: [0.5, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
  c: {parent: b, joint: {type: revolute, axis: y, at: [1.2, 0, 0]}, mass: 1, com: [0.5, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
loops:
  pin: {joint: {type: revolute, axis: y}, from: {body: c, at: [0.9, 0, 0]}, to: {body: ground, at: [1.1, 0, 0]}}
initial:
  q: {a: 0.8, b: 0.4, c: 1.9}
"""


@pytest.mark.parametrize(
    "old, new, said",
    [
        (
            "[1.1, 0, 0]",
            "[1e160, 0, 0]",
            "loop pin, whose joints are about .* m apart, cannot be closed in floating-point",
        ),
        (
            "[1.1, 0, 0]",
            "[0, 0, 1e300]",
            "loop pin, whose joints are about .* m apart, cannot be closed in floating-point",
        ),
        ("[1.1, 0, 0]", "[1e100, 0, 0]", "loop pin .* cannot be closed"),
        ("a: 0.8", "a: 1e300", ""),
        ("com: [0.5, 0, 0]", "com: [0, 1e300, 0]", "numbers of the model overflow when they are multiplied"),
    ],
)
def test_huge_loops_are_told_without_a_warning_of_numpy(old: str, new: str, said: str, tmp_path, capsys) -> None:
    file = tmp_path / "bars.yaml"
    file.write_text(BARS.replace(old, new))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(["check", str(file)]) == bool(said)
    assert re.search(said, capsys.readouterr().err)


def test_warnings_of_any_number_are_no_mistakes() -> None:
    lines = [
        f"  b{i}: {{parent: ground, joint: {{type: revolute, axis: {x}}}, mass: 1, com: [1, 1, 0], inertia: {{{x}{x}: 1}}}}"
        for i, x in enumerate("xy" * 125)
    ]
    text = "\n".join(["model: many", "bodies:", *lines, ""])
    assert len(parse_model(text).warnings) == 250
    errors = refused(text.replace("mass: 1", "mas: 1"))
    assert len(errors) == 201 and "more than 200 problems" in errors[200]


def test_a_warning_in_a_loop_does_not_keep_massless_joints_from_being_found() -> None:
    text = BARS.replace("loops:\n", "  d: {parent: ground, joint: {type: revolute, axis: y}, mass: 1}\nloops:\n")
    (expected,) = refused(text)
    assert "the revolute joint of 'd' rotates a point mass about its centre" in expected
    assert refused(text.replace("at: [1.1, 0, 0]", "at: [1.1, 0, 0], rpy: [0, 1.5708, 0]")) == [expected]


@pytest.mark.parametrize(
    "header",
    [
        "1..1000000",
        "1..999999999",
        "1..9007199254740991",
        "-9007199254740991..9007199254740991",
        "1..10**30",
        "1..n**n",
    ],
)
def test_huge_ranges_are_refused_at_once(header: str) -> None:
    text = f"model: m\nconstants: {{n: 9}}\nbodies:\n  repeat k in {header}:\n    a(k): {{parent: ground}}\n"
    start = time.process_time()
    (line,) = refused(text)
    assert time.process_time() - start < 1
    assert line.startswith("m.yaml:4:3: bodies.repeat k in")
    assert f"up to {MAX_REPETITIONS} are allowed" in line or "an integer is needed" in line


def test_mistakes_in_every_repetition_do_not_take_forever() -> None:
    text = "model: m\nbodies:\n  repeat k in 1..100000:\n    a(k): {parent: b(k), joint: {type: revolute, axis: y}, mass: m}\n"
    start = time.process_time()
    assert len(refused(text)) == 3  # the body, the mass, and that there are too many
    assert time.process_time() - start < 5


def test_many_bodies_whose_numbers_differ_are_refused() -> None:
    text = "model: m\nbodies:\n  repeat k in 1..60000:\n    a(k): {parent: ground, joint: {type: revolute, axis: y}, mass: k, com: [1, 0, 0]}\n"
    assert "repeated bodies with different numbers" in refused(text)[0]


def test_too_many_bodies_are_refused_before_they_are_built() -> None:
    text = "model: m\nbodies:\n  repeat k in 1..%d:\n    a(k): {parent: ground, joint: {type: revolute, axis: y}, mass: 1}\n"
    start = time.process_time()
    (line,) = refused(text % (MAX_BODIES + 1))
    assert time.process_time() - start < 5
    assert (
        line
        == f"m.yaml:4:11: bodies.a(k): more than {MAX_BODIES} bodies; reading them would take too long: use fewer (k = {MAX_BODIES + 1})"
    )


def test_reading_a_chain_takes_linear_time_and_little_memory() -> None:
    import tracemalloc

    text = """\
model: chain
parameters: {L: 1.0}
bodies:
  repeat k in 1..%d:
    link(k):
      parent: link(k-1)
      joint: {type: revolute, axis: [1 - k %% 2, k %% 2, 0], at: [0, 0, -L]}
      shape: {type: cylinder, axis: z, length: L, radius: 0.05, mass: L, center: [0, 0, -L/2]}
      first: {parent: ground}
"""
    parse_model(text % 10)
    times = []
    for n in (1000, 10_000):
        best = math.inf
        for _ in range(3):
            start = time.process_time()
            model = parse_model(text % n)
            best = min(best, time.process_time() - start)
        times.append(best / n)
    assert times[1] < 3 * times[0]  # 10 times if it were quadratic
    # odd and even links are made of the same objects
    assert len({id(b.joint) for b in model.bodies}) == 3  # the first, even, odd
    tracemalloc.start()
    parse_model(text % 3000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak / 3000 < 3000  # bytes a body


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("- " * 500_000, "more than 60 levels of nesting"),
        ("a: [" + "x," * 1_000_001 + "]", "more than 1000000 keys and values"),
        ("a: 1\n" * 100_000, "key 'a' is already used on line 1"),
        ("a: " + "x" * 9_000_000, "larger than 8 MB"),
        ("model: m\nbodies:\n" + "".join(f"  a{i}: {{parent: b{i}, joint: {{type: free}}, mass: 1}}\n" for i in range(3000)), "more than 200 problems"),
    ],
    ids=["deep", "long", "the same", "large", "mistaken"],
)  # fmt: skip
def test_huge_texts_are_refused_in_time(text: str, said: str, tmp_path) -> None:
    (tmp_path / FILE).write_text(text)
    start = time.process_time()
    with pytest.raises(ModelError) as info:
        from codegen.model import load_model

        load_model(tmp_path / FILE)
    assert time.process_time() - start < 10
    assert len(info.value.problems) <= 202
    assert said in str(info.value)


@pytest.mark.campaign
def test_many_damaged_models(tmp_path) -> None:
    """A tenth of tests/campaigns/mutated_models.py, which says more."""
    for seed in range(1000, 21_000):
        verdict = judge(mutated(seed))
        assert verdict.kind != "failed", f"seed {seed}: {verdict.why}"


@pytest.mark.parametrize(
    ("section", "place"),
    [
        (
            "bodies: {repeat s in left, right: {c(s): {parent: ground, joint: {type: free}, mass: 1}}}",
            "m.yaml:2:10: bodies.repeat s in left:",
        ),
        (
            "bodies:\n  {repeat s in left, middle, right: {c(s): {parent: ground}}, d: {parent: c_left}}",
            "m.yaml:3:4: bodies.repeat s in left:",
        ),
    ],
)
def test_a_key_that_yaml_cuts_at_its_comma_is_one_mistake(section: str, place: str) -> None:
    (line,) = refused(f"model: m\n{section}\n")
    assert line.startswith(place)
    assert "quote the key" in line


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("ln(q.arm)", ", sinh, cosh, tanh, asinh, acosh, atanh, exp, log, erf, erfc, sqrt, abs, sign, max, min, mod, if, step, distance, rate; did you mean 'log'?"),
        ("step(q.arm)", "step with 1 arguments; write step(x, from, to)"),
        ("heaviside(q.arm, 1)", "rate; a step is if(x > 0, 1, 0), a smooth one step(x, from, to); in a name, two indices are written heaviside(i)(j)"),
        ("coss(u.arm)", "did you mean 'cos'?"),
        ("Pow(q.arm, 2)", "a power is written a**b"),
    ],
)  # fmt: skip
def test_functions_that_are_none_name_those_that_are(value: str, said: str) -> None:
    (line,) = refused(f"{ARM}forces:\n  f: {{type: joint, joint: arm, value: '{value}'}}\n")
    assert line.startswith("m.yaml:11:") and said in line


def test_entries_know_their_places() -> None:
    model = parse_model(ARM + "forces:\n  repeat k in 1..2:\n    f(k): {type: joint, joint: arm, value: k}\n", FILE)
    assert str(model.problem("bodies.arm.joint", "x")) == "m.yaml:4:3: bodies.arm.joint: x"
    assert str(model.problem("forces.f_2.value", "x")) == "m.yaml:12:5: forces.f_2.value: x"
    assert str(model.problem("loops", "x")) == "m.yaml: loops: x"


@pytest.mark.parametrize("power", ["x**1e308*10*x**1e308 + z", "z + sqrt(x**1.7e308*x**1e308)*x"])
def test_exponents_that_add_up_to_too_large_a_number(power: str) -> None:
    """Each is a number; their sum is none."""
    [message] = refused(f"""\
model: valve
bodies:
  cam: {{parent: ground, joint: {{type: revolute, axis: y}}, mass: 1, inertia: {{xx: 1, yy: 1, zz: 1}}}}
  tappet: {{parent: ground, joint: {{type: prismatic, axis: z, at: [0, 0, 0.1]}}, mass: 1}}
loops:
  profile: {{joint: {{type: surface, equation: "{power}"}}, from: cam, to: tappet}}
""")
    assert re.match(rf"{FILE}:6:.*up to 1.8e308", message)
    [message] = refused(
        f"{ARM}forces:\n  push: {{type: joint, joint: arm, value: 'q.arm*sqrt(q.arm**1e308*q.arm**1.7e308)'}}\n"
    )
    assert re.match(rf"{FILE}:11:.*up to 1.8e308", message)


def test_a_warning_hides_no_model_without_bodies() -> None:
    text = "model: chain\nconstants: {n: 0}\nparameters: {L: {value: 1, min: 2}}\nbodies:\n  repeat k in 1..n:\n    rod(k): {mass: L}\n"
    with pytest.raises(ModelError) as caught:
        parse_model(text, FILE)
    assert {p.severity for p in caught.value.problems} == {"error", "warning"}
    assert "there are no bodies; give at least one" in str(caught.value)
