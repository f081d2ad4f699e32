"""Derivatives of repeated eigenvalues: those of the branches into which they split, or NaN if none exist."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.model import parse_model

TWINS = """\
model: twins
gravity: [0, 0, -9.81]
parameters: {L: 0.7, first: 1.0, c: 0.1}
bodies:
  one: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -L*first], inertia: {yy: 0}}
  other: {parent: ground, joint: {type: revolute, axis: y, at: [1, 0, 0]}, mass: 1, com: [0, 0, -L], inertia: {yy: 0}}
forces:
  rub_one: {type: joint, joint: one, value: -c*u.one*L**2}
  rub_other: {type: joint, joint: other, value: -c*u.other*L**2}
"""


def test_twins(tmp_path: Path) -> None:
    """Two pendulums with ``s^2 + c s + g/L = 0`` each, of which one is longer by the factor `first`."""
    codegen.generate(parse_model(TWINS), tmp_path / "twins", target="numpy")
    found = codegen.load(tmp_path / "twins").linearize([0.0, 0.0])
    s = found.eigenvalues()
    by_length = 9.81 / 0.7**2 / (2 * s + 0.1)
    by_friction = -s / (2 * s + 0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        both = found.eigenvalue_sensitivities(["L", "c"])
    np.testing.assert_allclose(both, [by_length, by_friction], rtol=1e-9)
    with pytest.warns(RuntimeWarning, match="along each parameter alone"):
        split = found.eigenvalue_sensitivities("first")[0]
    # L**2 in the friction of the first stays, so c becomes c/first**2
    alone = (9.81 / 0.7 + 2 * 0.1 * s) / (2 * s + 0.1)
    for sign in (-1, 1):
        pair = np.flatnonzero(np.sign(s.imag) == sign)
        expected = sorted([0.0, alone[pair[0]]], key=lambda x: (x.real, sign * x.imag))
        np.testing.assert_allclose(split[pair], expected, rtol=1e-8, atol=1e-8)


def test_a_jordan_block_has_no_derivative_in_either_part(tmp_path: Path) -> None:
    text = """\
model: free
parameters: {m: 2, k: 3}
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: m}
  bob: {parent: cart, joint: {type: prismatic, axis: x}, mass: m}
forces:
  spring: {type: joint, joint: bob, value: -k*q.bob}
"""
    codegen.generate(parse_model(text), tmp_path / "free", target="numpy")
    found = codegen.load(tmp_path / "free").linearize([0.0, 0.0])
    with pytest.warns(RuntimeWarning, match="too few eigenvectors"):
        by = found.eigenvalue_sensitivities("k")[0]
    zero = np.abs(found.eigenvalues()) < 1e-6
    assert np.isnan(by[zero].real).all() and np.isnan(by[zero].imag).all()
    assert np.isfinite(by[~zero]).all()


def test_where_all_eigenvalues_are_one_jordan_block(tmp_path: Path) -> None:
    """A ball in the air, of which Hertz's law asks nothing: two zeros, one eigenvector."""
    text = """\
model: ball
parameters: {k: 1e5, n: 1.5}
bodies: {ball: {parent: ground, joint: {type: prismatic, axis: z}, mass: 1}}
forces: {floor: {type: joint, joint: ball, value: "k*max(0, -q.ball)**n"}}
"""
    codegen.generate(parse_model(text), tmp_path / "ball", target="numpy")
    found = codegen.load(tmp_path / "ball").linearize([0.05])
    assert not found.sensitivities(["k", "n"]).A.any()
    with pytest.warns(RuntimeWarning, match="too few eigenvectors"):
        by = found.eigenvalue_sensitivities("n")
    assert np.isnan(by.real).all() and np.isnan(by.imag).all()
