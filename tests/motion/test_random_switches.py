"""Random trees and mechanisms with forces that jump or have kinks: derivatives of motions against central differences."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motion.models import mechanism, parsed, tree
from random_models import expression

import codegen
from codegen.model.expressions import Expression
from codegen.model.forces import JointForce
from codegen.model.model import Model, Parameter
from codegen.model.tables import Table
from codegen.runtime import Final, SimulationError

END = 0.5
SIZE = 1e-4
"""Of the differences, of order four, of motions at 1e-13."""

CLOSE = 1e-6

GROWN = 1e6
"""rad/s or m/s: a speed that grows beyond all bounds."""

MOST = 3000
"""Steps; drawn models that take more have a torsion spring that is turned over across its axis, or the like."""

KINDS = (
    "f*if({x} > a, 1, -1)", "f*sign({x} - a)", "f*abs({x} - a)", "f*max(0, {x} - a)", "f*min(a, {x})*{x}", "f*if(t < b, 1, {x})",
    "f*if({v} > c, {x}, 1)", "f*max(a, {x})*abs({v} - c)", "f*if({x} > a and {v} > c, 1, 0)", "f*mod({x} - a, 0.3)", "table",
    "f*if(max({x} - a, {v} - c) > 0, t, 1)", "f*max(min({x}, a), b)",
)  # fmt: skip


def forces(rng: np.random.Generator, model: Model, q: dict[str, float]) -> list[JointForce]:
    """Joint forces that change their branch where parameters say; tables near initial coordinates."""
    found = []
    joints = [
        k
        for k, b in enumerate(model.bodies)
        if b.joint.type in ("revolute", "prismatic") and b.name in model.speed_names
    ]
    for n, k in enumerate(rng.permutation(joints)[:3]):
        name = model.bodies[k].name
        kind = str(rng.choice(KINDS))
        if kind == "table":
            x = np.sort(q[name] + rng.uniform(-0.2, 0.2, 4)).round(3)
            if (np.diff(x) <= 0.0).any():
                x += 1e-3 * np.arange(4)
            y = tuple(Expression.number(float(v)) for v in rng.uniform(-1, 1, 4).round(2))
            outside = str(rng.choice(["constant", "linear"]))
            table = Table(tuple(map(float, x)), y, "linear", outside).at(("name", f"q.{name}"))
            value = Expression(("*", ("name", f"f_{n}"), table))
        else:
            text = kind.format(x=f"q.{name}", v=f"u.{name}")
            value = expression(
                "".join(f"{c}_{n}" if c in "abcf" and not _within(text, i) else c for i, c in enumerate(text))
            )
        found.append(JointForce(f"switch_{n}", int(k), (value,)))
    return found


def _within(text: str, i: int) -> bool:
    """Whether a letter is part of a longer word."""
    before, after = text[i - 1 : i], text[i + 1 : i + 2]
    return before.isalnum() or after.isalnum() or before in ("_", ".") or after == "_"


def drawn(seed: int, folder: Path, functions: str = "motion") -> tuple[Any, Any, Any, list[str]]:
    """A solver of a random model with switches, a state and parameters to begin with, and what derivatives are by.

    Thresholds are what a motion without these forces passes at a time.
    """
    rng = np.random.default_rng(seed)
    model, q, p = (
        mechanism(seed, "planar") if seed % 4 == 3 else tree(seed, 3, joints=("revolute", "prismatic", "universal"))
    )
    names = model.coordinate_names
    start = (
        dict(zip(names, q, strict=True))
        if q is not None
        else {n: float(model.initial_q[n].evaluate(model.defaults)) for n in names}
    )
    known = list(model.parameter_names[:2])
    added = forces(rng, model, start)
    more = [Parameter(f"{letter}_{n}", 0.0) for n in range(len(added)) for letter in "abcf"]
    p = np.array([*(model.defaults.values() if p is None else p), *np.zeros(len(more))])
    model = dataclasses.replace(model, forces=(*model.forces, *added), parameters=(*model.parameters, *more))
    codegen.generate(model, folder, functions=functions, check=False, compile="all")
    solver = codegen.load(folder)
    given: dict[str, Any] = {"p": p, "inputs": [0.0] * solver.ninputs, "most_steps": MOST}
    try:
        run = solver.simulate([0.0, 0.4 * END, END], q, **given)
    except SimulationError:
        solver.simulate(END, q, **given)  # fails with all steps in its trajectory
        raise
    for n, f in enumerate(added):
        name = model.bodies[f.body].name
        at = (
            run.q[1, names.index(name)],
            rng.uniform(0.3, 0.7) * END,
            run.u[1, model.speed_names.index(name)],
            rng.uniform(0.5, 2.0),
        )
        p[len(p) - len(more) + 4 * n :][:4] = at
    return solver, q, p, [*(x.name for x in more), *known]


def judged(solver: Any, q: Any, p: Any, **options: Any) -> Any:
    wanted = [Final(o) for o in solver.output_names]
    return solver.judge(END, wanted, q, p=p, inputs=[0.0] * solver.ninputs, most_steps=MOST, **options)


def differences(solver: Any, q: Any, p: Any, name: str, size: float) -> Any:
    """Central differences of order four."""
    i = solver.parameter_names.index(name)
    found = []
    for n in (1, -1, 2, -2):
        moved = p.copy()
        moved[i] += n * size
        found.append(np.array(judged(solver, q, moved, rtol=1e-13, atol=1e-13).values))
    return (8 * (found[0] - found[1]) - (found[2] - found[3])) / (12 * size)


def _has_grown(error: SimulationError) -> bool:
    """Whether a motion ends where speeds grow without bounds, as by their squares, or accelerations, as at a pole."""
    of = error.trajectory
    if "may be unbounded" not in str(error) or of is None:
        return False
    return bool(np.abs(of.u[-1]).max() > GROWN or np.abs((of.u[-1] - of.u[-2]) / (of.t[-1] - of.t[-2])).max() > GROWN)


def compare(seed: int, folder: Path) -> str:
    """Compares forward derivatives and those of the adjoint with differences; returns why there are none.

    Thresholds that one motion passes at one time are passed together: derivatives that depend on the order are NaN.
    """
    try:
        solver, q, p, names = drawn(seed, folder)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            plain = judged(solver, q, p, wrt=names, method="forward", rtol=1e-12, atol=1e-12)
    except SimulationError as error:
        ends = any(w in str(error) for w in ("sticks or slides", "loses rank", "after 3000 steps", "is not finite"))
        assert ends or _has_grown(error), error
        return str(error)
    back = judged(solver, q, p, wrt=names, method="adjoint", rtol=1e-12, atol=1e-12)
    lost = np.isnan(plain.gradients).any(axis=0)
    assert lost.any() == any("depend on the order" in str(w.message) for w in said)
    scale = 1.0 + np.abs(plain.gradients)
    np.testing.assert_allclose(back.gradients / scale, plain.gradients / scale, rtol=0.0, atol=1e-9)
    for column, name in enumerate(names):
        if lost[column]:
            continue
        try:
            coarse, fine = (differences(solver, q, p, name, s) for s in (SIZE, SIZE / 4))
        except SimulationError as error:  # one of the motions beside it ends
            assert "sticks or slides" in str(error), error
            continue
        if (np.abs(coarse - fine) / scale[:, column]).max() > CLOSE:
            continue  # a switch comes or goes in between
        error = (np.abs(fine - plain.gradients[:, column]) / scale[:, column]).max()
        assert error < CLOSE, (seed, name, error)
    return ""


@pytest.mark.parametrize("seed", [2, 7])
def test_random_switches(tmp_path: Path, seed: int) -> None:
    compare(seed, tmp_path)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(1000, 1200))
def test_campaign_of_switches(tmp_path: Path, seed: int) -> None:
    compare(seed, tmp_path)


__all__ = ["parsed"]
