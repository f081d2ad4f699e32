"""Couplings in `codegen.loops`: rows, residuals, dependents, ears, components, long chains."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from loop_closure import closure, closure_matrix

import codegen
from codegen.loops.components import components
from codegen.loops.geometry import Geometry
from codegen.loops.partition import partition
from codegen.model import parse_model

LINKS = """
model: links
gravity: [0, 0, -9.81]
parameters: {r: 2, c: 0.1, L: 1}
bodies:
  repeat k in 1..N:
    link(k):
      parent: link(k-1)
      joint: {type: revolute, axis: [1 - k%2, k%2, 0], at: [0, 0, -L]}
      shape: {type: cylinder, axis: z, length: L, radius: 0.1, mass: 1, center: [0, 0, -L/2]}
      first: {parent: ground, joint: {at: [0, 0, 0]}}
couplings:
"""


def links(n: int, couplings: str, more: str = "") -> codegen.Model:
    return parse_model(LINKS.replace("N:", f"{n}:") + "".join(f"  {x}\n" for x in couplings.splitlines()) + more)


def test_the_row_has_the_factors_and_the_residual_what_coordinates_miss() -> None:
    model = links(4, "g: {joint: link(3), follows: {link(1): r, link(4): -0.5}, offset: c}")
    q, u, p = np.array([0.3, 0.2, 0.9, -0.4]), np.array([1.0, 2.0, 3.0, 4.0]), [3.0, 0.25, 1.0]
    speeds, E = closure_matrix(model, 0, q, p)
    assert dict(zip(speeds, E[0], strict=True)) == {0: -3.0, 2: 1.0, 3: 0.5}
    position, velocity = closure(model, q, u, p)
    assert position == pytest.approx([0.9 - 0.9 - 0.2 - 0.25], rel=1e-14)
    assert velocity == pytest.approx([3 - 3 + 2], rel=1e-14)


def test_each_determines_the_coordinate_that_the_file_gives_and_closes_by_itself() -> None:
    """The third one relates what the others have: it comes between them."""
    model = links(5, "a: {joint: link(2), follows: {link(1): 100}}\nb: {joint: link(4), follows: {link(5): 0.01}}\n"
                     "e: {joint: link(5), follows: {link(2): r}}")  # fmt: skip
    found = partition(model)
    assert [model.loops[ear.loops[0]].name for ear in found.ears] in (["a", "e", "b"], ["e", "a", "b"], ["b", "a", "e"])
    assert all(len(ear.loops) == 1 and ear.rank == 1 and ear.condition == 1 for ear in found.ears)
    alone = links(3, "a: {joint: link(2), follows: {link(1): 100}}\nb: {joint: link(3), follows: {link(1): 0.01}}")
    assert partition(alone).dependent == (1, 2)
    assert partition(links(3, "a: {joint: link(1), follows: {link(3): 1e-4}}")).dependent == (0,)


def test_couplings_that_share_coordinates_are_of_one_component() -> None:
    model = links(8, "a: {joint: link(2), follows: link(1)}\nb: {joint: link(8), follows: link(7)}\n"
                     "e: {joint: link(4), follows: link(2)}\nf: {joint: link(5), follows: link(6)}")  # fmt: skip
    assert components(Geometry(model)) == [[0, 2], [1], [3]]


def test_a_long_chain_keeps_its_digits(tmp_path: Path) -> None:
    """Forty-eight links, every second one following; the mass matrix of the independents has a condition of 1e6."""
    model = links(48, "repeat k in 1..24:\n  g(k): {joint: link(2*k), follows: {link(2*k-1): r}}")
    assert len(partition(model).ears) == 24
    codegen.generate(model, tmp_path / "links", target="numpy")
    solver = codegen.load(tmp_path / "links")
    rng = np.random.default_rng(1)
    q, u = solver.assemble(0.25 * rng.normal(size=48), 0.5 * rng.normal(size=48))
    found, exact = solver.accelerations(q, u), solver.in_precision(30).accelerations(q, u)
    assert np.abs(found - np.array(exact, float)).max() < 1e-13 * np.abs(found).max()
