"""Random mechanisms whose forces jump, are steep, or have singular points: exact derivatives, or a warning.

Derivatives with the default tolerances, of both adaptive integrators and both ways, are compared with a motion at 1e-12, and that
one with central differences of motions at 1e-13.
"""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motion.models import mechanism
from motion.test_random_switches import END, KINDS, MOST, judged
from random_models import expression

import codegen
from codegen.model.forces import JointForce
from codegen.model.model import Parameter
from codegen.runtime import SimulationError

STEEP = (
    "-f*tanh(({v} - c)/w)", "-f*atan(({v} - c)/w)", "-f*({v} - c)/sqrt(({v} - c)**2 + w**2)",
    "-f*(2*step({v}, c - w, c + w) - 1)", "f*tanh(({x} - a)/w)", "f*tanh((t - b)/w)", "f*sqrt(({x} - a)**2 + w**2)",
)  # fmt: skip
SINGULAR = (
    "f*abs({x} - a)**1.5", "f*sin({x} - a)/({x} - a)", "f*sqrt(({x} - a)**2 + ({v} - c)**2)", "f*max(0, {x} - a)**1.5",
    "f*({x} - a)**3/(({x} - a)**2 + ({v} - c)**2)", "f*sqrt(max(0, {x} - a))",
)  # fmt: skip
JUMPS = tuple(kind for kind in KINDS if kind != "table")
FAMILIES = {"steep": STEEP, "singular": SINGULAR, "jumps": JUMPS}

CLOSE = {"dop853": 2e-6, "radau": 1e-5}
"""Allowed errors with the default tolerances, 1e-9, relative to 1 + derivative."""

LETTERS = "abcfw"
SIZES = (2e-6, 5e-7)
"""Steps of the differences."""


def drawn(seed: int, family: str, folder: Path) -> tuple[Any, np.ndarray, list[str]]:
    """A solver of a random mechanism with two such forces, on independent and dependent joints, parameters, and names of
    directions."""
    rng = np.random.default_rng([seed, 77])
    model, _, _ = mechanism(seed, ("planar", "spatial")[seed % 2])
    known = list(model.parameter_names[:2])
    joints = [
        k
        for k, b in enumerate(model.bodies)
        if b.joint.type in ("revolute", "prismatic") and b.name in model.speed_names
    ]
    added, kinds = [], []
    for n, k in enumerate(rng.permutation(joints)[:2]):
        name, kind = model.bodies[k].name, str(rng.choice(FAMILIES[family]))
        text = kind.format(x=f"q.{name}", v=f"u.{name}")
        value = "".join(f"{c}_{n}" if c in LETTERS and not _within(text, i) else c for i, c in enumerate(text))
        added.append(JointForce(f"added_{n}", int(k), (expression(value),)))
        kinds.append((name, kind))
    more = [Parameter(f"{c}_{n}", 1.0 if c == "w" else 0.0) for n in range(len(added)) for c in LETTERS]
    model = dataclasses.replace(model, forces=(*model.forces, *added), parameters=(*model.parameters, *more))
    codegen.generate(model, folder, functions=["motion"], check=False, compile="all")
    solver = codegen.load(folder)
    p = np.array(list(model.defaults.values()))
    run = solver.simulate([0.0, 0.4 * END, END], p=p, inputs=[0.0] * solver.ninputs, most_steps=MOST)
    names = []
    for n, (name, kind) in enumerate(kinds):
        place, speed = (
            of[1, names_.index(name)] for of, names_ in ((run.q, model.coordinate_names), (run.u, model.speed_names))
        )
        if abs(speed) < 1e-3:  # no force on it has any effect
            raise SimulationError(f"{name} rests", run)
        values = place, 0.4 * END, speed, rng.uniform(0.5, 2.0), 10.0 ** rng.uniform(-3.5, -1.5)
        for c, x in zip(LETTERS, values, strict=True):
            p[solver.parameter_names.index(f"{c}_{n}")] = x
        names += [
            f"{c}_{n}" for c in "acf" if c == "f" or f"{c}" in {t for i, t in enumerate(kind) if not _within(kind, i)}
        ]
    return solver, p, [*names, *known]


def _within(text: str, i: int) -> bool:
    """Whether a letter is part of a longer word."""
    before, after = text[i - 1 : i] if i else "", text[i + 1 : i + 2]
    return before.isalnum() or after.isalnum() or before in ("_", ".") or after == "_"


def gradients(solver: Any, p: np.ndarray, names: list[str], **options: Any) -> tuple[np.ndarray, list[str]]:
    """Derivatives of all outputs at the end, and the messages."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = judged(solver, None, p, wrt=names, **options).gradients
    return found, [str(w.message) for w in said]


def differences(solver: Any, p: np.ndarray, name: str, size: float) -> np.ndarray:
    """Central differences of order four."""
    i, found = solver.parameter_names.index(name), []
    for n in (1, -1, 2, -2):
        moved = p.copy()
        moved[i] += n * size
        found.append(np.array(judged(solver, None, moved, rtol=1e-13, atol=1e-13).values))
    return (8 * (found[0] - found[1]) - (found[2] - found[3])) / (12 * size)


def compare(seed: int, family: str, folder: Path) -> str:
    """Compares derivatives; returns why there are none. Derivatives that are NaN have a warning."""
    try:
        solver, p, names = drawn(seed, family, folder)
        exact, messages = gradients(solver, p, names, method="forward", rtol=1e-12, atol=1e-12)
    except SimulationError as error:
        return str(error)
    assert np.isfinite(exact).all() or messages
    scale = 1.0 + np.abs(exact)
    for column, name in enumerate(names):
        if np.isnan(exact[:, column]).any():
            continue
        try:
            coarse, fine = (differences(solver, p, name, size) for size in SIZES)
        except SimulationError:  # one of the motions beside it ends
            continue
        if (
            np.abs(coarse - fine) / scale[:, column]
        ).max() < 1e-5:  # else rounding, or a switch comes or goes in between
            # rounding may spoil one of the two: a motion's error of 1e-11 makes 2e-5 of the finer one
            errors = [(np.abs(x - exact[:, column]) / scale[:, column]).max() for x in (coarse, fine)]
            assert min(errors) < 2e-5, (seed, name, "differences")
    for integrator, allowed in CLOSE.items():
        for way in ("forward", "adjoint"):
            found, said = gradients(solver, p, names, method=way, integrator=integrator)
            lost = np.isnan(found)
            assert not lost.any() or said, (seed, integrator, way)
            error = np.where(lost | np.isnan(exact), 0.0, np.abs(found - exact) / scale).max()
            assert error < allowed or said, (seed, family, integrator, way, error)
            assert not (np.isnan(exact).all(axis=0) & ~lost.any(axis=0)).any(), (seed, integrator, way)
    return ""


def test_a_layer_in_a_loop_that_is_always_poor(tmp_path: Path) -> None:
    """Derivatives of radau were off by 3e-5, because the loop's condition number is always above 30."""
    solver, p, names = drawn(103, "steep", tmp_path)
    exact, _ = gradients(solver, p, names, method="forward", rtol=1e-12, atol=1e-12)
    found, _ = gradients(solver, p, names, method="forward", integrator="radau")
    assert (np.abs(found - exact) / (1.0 + np.abs(exact))).max() < CLOSE["radau"]


def test_a_switch_that_is_zero_together_with_another(tmp_path: Path) -> None:
    """Rounding had left its function beyond zero where `mod` begins again, and its jump of derivatives was lost in silence."""
    assert not compare(140, "jumps", tmp_path)


@pytest.mark.campaign
@pytest.mark.parametrize("family", list(FAMILIES))
@pytest.mark.parametrize("seed", range(101, 141))
def test_campaign_of_loops(tmp_path: Path, family: str, seed: int) -> None:
    compare(seed, family, tmp_path)
