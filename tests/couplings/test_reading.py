"""Couplings in model files: reading, display, and errors."""

from __future__ import annotations

import pytest

import codegen
from codegen.listing import list_model
from codegen.loops.errors import AssemblyError, PartitionError
from codegen.loops.partition import partition
from codegen.model import ModelBuilder, parse_model

TEXT = """
model: train
parameters: {z1: 12, z2: 30, lead: 0.002, c: 0.3}
bodies:
  pinion: {parent: ground, joint: {type: revolute, axis: z}, mass: 1, inertia: {zz: 0.01}}
  wheel: {parent: ground, joint: {type: revolute, axis: z, at: [0.2, 0, 0]}, mass: 2, inertia: {zz: 0.05}}
  nut: {parent: ground, joint: {type: cylindrical, axis: z}, mass: 0.5, inertia: {zz: 0.001}}
  ball: {parent: ground, joint: {type: spherical}, mass: 1, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  plate: {parent: ground, joint: {type: fixed}, mass: 1}
couplings:
COUPLINGS
"""


def read(couplings: str, more: str = "") -> codegen.Model:
    lines = "\n".join(f"  {line}" for line in couplings.splitlines())
    return parse_model(TEXT.replace("COUPLINGS", lines) + more)


def test_gears_leads_and_differentials_are_read() -> None:
    model = read(
        "mesh: {joint: wheel, follows: {pinion: -z1/z2}, offset: c}\n"
        "thread: {joint: nut.1, follows: {nut.2: lead, wheel: 1e-3}}"
    )
    mesh, thread = model.loops
    assert model.closure_names == ("mesh.q", "thread.q")
    assert [(t.body, t.index, t.factor.evaluate(model.defaults)) for t in mesh.terms] == [(1, 0, 1), (0, 0, 0.4)]
    assert [(t.body, t.index, t.factor.evaluate(model.defaults)) for t in thread.terms] == [
        (2, 0, 1), (2, 1, -0.002), (1, 0, -0.001),
    ]  # fmt: skip
    shown = [line.strip() for line in list_model(model) if "coupling" in line]
    assert shown[0].endswith("2 couplings")
    assert shown[1].startswith("coupling mesh: wheel = ") and shown[1].endswith("pinion + c")
    assert shown[2] == "coupling thread: nut.1 = lead nut.2 + 0.001 wheel"
    found = partition(model)
    assert [model.speed_names[i] for i in found.dependent] == ["wheel", "nut.1"]


def test_a_name_alone_is_followed_one_to_one_and_repetitions_and_submodels_have_their_own(tmp_path) -> None:
    (tmp_path / "pair.yaml").write_text(
        "model: pair\nparameters: {ratio: 2}\nbodies:\n"
        "  a: {parent: ground, joint: {type: revolute, axis: x}, mass: 1, inertia: {xx: 1}}\n"
        "  b: {parent: a, joint: {type: revolute, axis: x}, mass: 1, inertia: {xx: 1}}\n"
        "couplings:\n  mesh: {joint: b, follows: {a: ratio}}\n"
    )
    (tmp_path / "whole.yaml").write_text(
        "model: whole\nparameters: {r: 3}\nsubmodels:\n  one: {use: pair.yaml, with: {ratio: r}}\n"
        "bodies:\n  repeat k in 1..3:\n"
        "    link(k): {parent: ground, joint: {type: revolute, axis: x}, mass: 1, inertia: {xx: 1}}\n"
        "couplings:\n  repeat k in 2..3:\n    belt(k): {joint: link(k), follows: link(k-1)}\n"
        "  across: {joint: one_a, follows: {link(3): 2*r}}\n"
    )
    model = codegen.load_model(tmp_path / "whole.yaml")
    names = [[model.bodies[t.body].name for t in x.terms] for x in model.loops]
    factors = [[t.factor.evaluate(model.defaults) for t in x.terms[1:]] for x in model.loops]
    assert sorted(zip(names, factors, strict=True)) == [
        (["link_2", "link_1"], [-1]), (["link_3", "link_2"], [-1]), (["one_a", "link_3"], [-6]), (["one_b", "one_a"], [-3]),
    ]  # fmt: skip


def test_the_builder_has_them() -> None:
    builder = ModelBuilder("train")
    builder.parameter("z", 2)
    for name in ("a", "b"):
        builder.body(name, mass=1, axis="z", inertia={"xx": 1, "yy": 1, "zz": 1})
    builder.coupling("mesh", "b", {"a": "-z"}, offset=0.5)
    (mesh,) = builder.build().loops
    assert [t.factor.evaluate({"z": 2.0}) for t in mesh.terms] == [1, 2] and mesh.offset.value == 0.5


@pytest.mark.parametrize(
    ("couplings", "message"),
    [
        (
            "m: {joint: wheel, follows: {pinon: 2}}",
            r"couplings\.m\.follows\.pinon: unknown joint .* did you mean 'pinion'\?",
        ),
        (
            "m: {joint: wheels, follows: pinion}",
            r"m\.joint: unknown joint or coordinate 'wheels'; allowed are pinion, wheel",
        ),
        ("m: {joint: nut, follows: pinion}", r"'nut' is cylindrical and has several .* write one of nut\.1, nut\.2"),
        ("m: {joint: ball, follows: pinion}", "the spherical joint 'ball' has a quaternion"),
        ("m: {joint: plate, follows: pinion}", "joint 'plate' is fixed and has no coordinate to be coupled"),
        ("m: {joint: wheel, follows: {wheel: 2}}", "'wheel' follows itself"),
        (
            "m: {joint: wheel, follows: {pinion: 0}}",
            "the ratio 0 is 0 at the default parameters, so 'pinion' has no effect",
        ),
        ("m: {joint: wheel, follows: {pinion: 1/(z1 - 12)}}", "no finite value at the default parameters"),
        ("m: {joint: wheel, follows: {pinion: q.nut.1}}", "'q.nut.1', which changes with the motion, is not allowed"),
        ("m: {joint: wheel, follows: {}}", "follows is empty; give coordinates with their ratios"),
        ("m: {joint: wheel}", "key 'follows' is missing; keys here: joint, follows, offset"),
        ("m: {joint: wheel, follows: pinion, ratio: 2}", "ratio"),
        ("m: {joint: wheel, follows: pinion, offset: nut}", "nut"),
        ("m: {joint: 3 x, follows: pinion}", "'3 x' is not a valid name"),
        (
            "m: {joint: wheel, follows: pinion}\nn: {joint: wheel, follows: nut.1}",
            "coupling 'm' already determines 'wheel'; remove one",
        ),
        ("wheel: {joint: wheel, follows: pinion}", "name 'wheel' is already taken by a body"),
    ],
)
def test_what_is_wrong_is_said_once_with_what_is_allowed(couplings: str, message: str) -> None:
    with pytest.raises(codegen.ModelError, match=message) as caught:
        read(couplings)
    assert len([p for p in caught.value.problems if p.severity == "error"]) == 1


def test_what_is_prescribed_may_be_followed_and_cannot_follow() -> None:
    mesh = "mesh: {joint: wheel, follows: {pinion: -z1/z2}}"
    assert partition(read(mesh, "motion: {pinion: t}\n")).dependent == (1,)
    with pytest.raises(codegen.ModelError, match="'wheel' is prescribed under `motion`, so it cannot follow"):
        read(mesh, "motion: {wheel: t}\n")


def test_hints_are_honoured_and_couplings_that_follow_from_others_are_refused() -> None:
    mesh = "mesh: {joint: wheel, follows: {pinion: -z1/z2}, offset: c}"
    assert partition(read(mesh, "independent: [wheel]\n")).dependent == (0,)
    with pytest.raises(PartitionError, match=r"coupling mesh: .*pinion cannot all be independent; remove one of them"):
        partition(read(mesh, "independent: [wheel, pinion]\n"))
    back = f"{mesh}\nback: {{joint: pinion, follows: {{wheel: -z2/z1}}, offset: c*z2/z1}}"
    with pytest.raises(PartitionError, match=r"couplings? .* determines? .*; remove one of them"):
        partition(read(back))
    with pytest.raises(
        AssemblyError, match=r"coupling mesh, closed together with back, cannot be met: a residual of 0\.259"
    ):
        partition(read(back.replace("c*z2", "2*c*z2")))
    bodies = "bodies:\n  a: {parent: ground, joint: {type: revolute, axis: x}, mass: 1, inertia: {xx: 1}}\n"
    bodies += "  b: {parent: a, joint: {type: revolute, axis: x}, mass: 1, inertia: {xx: 1}}\n"
    ring = "couplings: {m: {joint: b, follows: a}, n: {joint: a, follows: {b: 2}}}\n"
    with pytest.raises(PartitionError, match=r"no freedom left: .* remove a loop or a coupling"):
        partition(parse_model(f"model: ring\n{bodies}{ring}"))
