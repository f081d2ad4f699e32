"""The description of regions: the base of each and the reason, on models whose bases are known."""

from __future__ import annotations

from pathlib import Path

import pytest

from codegen.loops.partition import partition
from codegen.mechanics.structure.description import LINES, describe_regions
from codegen.model import Model, load_model, parse_model

EXAMPLES = Path(__file__).parents[2] / "examples"

ARMS = """
model: arms
gravity: [0, 0, -9.81]
bodies:
  repeat s in 0..1:
    repeat k in 1..6:
      b(s)(k):
        parent: b(s)(k-1)
        joint: {type: revolute, axis: [1 - k % 2, k % 2, 0], at: [0, 0, -1]}
        mass: 1
        inertia: {xx: 1, yy: 1, zz: 1}
        first: {parent: ground, joint: {at: [3*s, 0, 0]}}
loops:
  hold: {joint: {type: spherical}, from: {body: b_0_6, at: [0, 0, -1]}, to: {body: b_1_6, at: [0, 0, -1]}}
initial: {q: {b_0_1: 0.3, b_0_3: 0.2, b_1_1: -0.3, b_0_2: 0.1, b_1_4: 0.2}}
independent: [b_0_1, b_0_2, b_0_3, b_0_4, b_0_5, b_1_1, b_1_2, b_1_3, b_1_4]
"""
"""Two arms that hold each other: more than five independent speeds, and two links to start from."""


def said(model: Model) -> list[str]:
    return describe_regions(model, partition(model))


@pytest.mark.parametrize(
    ("name", "line"),
    [
        (
            "andrews",
            "region of E3, E4, E6 (links k1, k2, k3, k5, k4, k7 and 1 more): base ground, where the paths inward from the faces "
            "of its loops meet; moves with 1 independent speed (k1)",
        ),
        (
            "closed_chain",
            "region of end (links link_12, link_13, link_14, link_15, link_16): base link_11, a region of one ear, since its "
            "loops share links with more than 5 independent speeds and a common region would not save enough operations "
            "(docs/theory.md, 4.3); the base is the only moving link that carries links of the region or faces of its loops; "
            "the ground carries the others; moves with the motion of the base",
        ),
    ],
)
def test_of_examples(name: str, line: str) -> None:
    assert said(load_model(EXAMPLES / f"{name}.yaml")) == [line]


def test_of_links_on_two_branches() -> None:
    assert said(parse_model(ARMS)) == [
        "region of hold (links b_0_6, b_1_5, b_1_6): base b_0_5, a region of one ear, since its loops share links with more than "
        "5 independent speeds and a common region would not save enough operations (docs/theory.md, 4.3); the base is the moving "
        "link that carries most links of the region, or the first of several such links: 1 on b_0_5, 1 on b_1_4; moves with the "
        "motion of b_1_4 relative to the base"
    ]


def test_of_a_loop_that_a_body_carries_and_of_many() -> None:
    bars = """
    repeat k in 1..15:
      a(k): &bar {parent: cart, joint: {type: revolute, axis: y, at: [k, 0, 0]}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
      b(k): {<<: *bar, parent: a(k), joint: {type: revolute, axis: y, at: [0, 0, 1]}}
      c(k): {<<: *bar, joint: {type: revolute, axis: y, at: [k + 0.5, 0, 0]}}
"""
    model = parse_model(
        "model: carts\nbodies:\n  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}" + bars.replace("\n  ", "\n")
        + "loops:\n  repeat k in 1..15:\n    pin(k): {joint: {type: revolute, axis: y}, from: {body: b(k), at: [0.5, 0, 0]}, "
        "to: {body: c(k), at: [0, 0, 1]}}\nindependent: [a_1]\n"
    )  # fmt: skip
    lines = said(model)
    assert lines[0].startswith(
        "region of pin_1 (links a_1, b_1, c_1): base cart, where the paths inward from the faces of its loops meet; moves with 1 "
    )
    assert len(lines) == LINES + 1 and lines[-1] == "and 3 more regions"
