"""Batches of every size against single states: every function of a package, in C, in NumPy and in more digits."""

from __future__ import annotations

import dataclasses
import itertools
import math
import warnings
from typing import Any

import numpy as np
import pytest
from prescribed_models import with_prescribed, with_prescribed_at
from random_elements import with_random_elements
from random_mechanisms import Mechanism, random_mechanism
from random_models import EVERY, expression, random_state, random_tree
from rotor_models import with_rotors, with_rotors_at

import codegen
from codegen.model import Model
from codegen.runtime.standalone.calls import batches
from codegen.runtime.standalone.calls.arguments import NO_SEEDS, Seeds
from codegen.runtime.standalone.errors import SingularJointError

Array = np.ndarray
SIZES = tuple(range(1, 13))
"""From one state to more than a vector holds, past the numbers of coordinates and hinges of the models."""

ALIKE = 1e-11
"""Rounding of sums that compilers order differently in vectors, against the largest entry."""

DIGITS = 30

MASS = "mass: {m}, com: [0.3, 0, 0], inertia: {{xx: 0.1, yy: 0.1, zz: 0.1}}"
TURNED = f"""
model: turned
gravity: [0, 0, -9.81]
parameters: {{m: 1.3}}
bodies:
  a: {{parent: ground, joint: {{type: revolute, axis: y, rpy: [0, 0.4, 0]}}, {MASS.format(m="m")}}}
  b: {{parent: a, joint: {{type: revolute, axis: y, at: [0.5, 0, 0], rpy: [0, 0.3, 0]}}, {MASS.format(m=1)}}}
  slide: {{parent: a, joint: {{type: prismatic, axis: x}}, {MASS.format(m=1)}}}
  c: {{parent: slide, joint: {{type: revolute, axis: z, at: [0.5, 0, 0], rpy: [0, 0, -1.1]}}, {MASS.format(m=1)}}}
"""


def turned(rng: np.random.Generator, model: Model) -> Model:
    """The model with some of its hinges rotated about their own axes by numbers."""
    bodies = []
    for b in model.bodies:
        if b.joint.type == "revolute" and rng.random() < 0.6:
            turn = (b.joint.axes[0], expression(round(float(rng.uniform(-2, 2)), 3)))
            b = dataclasses.replace(b, joint=dataclasses.replace(b.joint, rotation=(*b.joint.rotation, turn)))
        bodies.append(b)
    return dataclasses.replace(model, bodies=tuple(bodies))


def drawn_tree(rng: np.random.Generator) -> tuple[Model, list[tuple[Any, ...]]]:
    model = turned(rng, random_tree(rng, int(rng.integers(1, 7)), EVERY))
    if rng.random() < 0.5:
        model = with_random_elements(rng, model)
    if rng.random() < 0.3:
        model = with_rotors(rng, model)
    if rng.random() < 0.4:
        model = with_prescribed(rng, model)
    return model, [tuple(random_state(rng, model)) for _ in SIZES]


def drawn_mechanism(rng: np.random.Generator) -> tuple[Model, list[tuple[Any, ...]]] | None:
    drawn: Any = random_mechanism(rng)
    if not isinstance(drawn, Mechanism):
        return None
    if rng.random() < 0.3:
        drawn = with_rotors_at(rng, drawn)
    if rng.random() < 0.3:
        drawn = with_prescribed_at(rng, drawn) or drawn
    states = []
    for _ in SIZES:
        q = drawn.q + 1e-4 * rng.normal(size=drawn.q.shape)
        u = drawn.u + 1e-2 * rng.normal(size=drawn.u.shape)
        inputs = drawn.inputs + 0.1 * rng.normal(size=drawn.inputs.shape)
        states.append((q, u, drawn.p, inputs, drawn.t + 1e-4 * rng.normal()))
    return drawn.model, states


def arguments(
    solver: codegen.Solver, states: list[tuple[Any, ...]], rng: np.random.Generator, k: int
) -> dict[str, Any]:
    """All arguments of the functions for all states: arguments (states, entries), seeds (k, states, entries)."""
    n = len(states)
    given = {name: np.array([s[i] for s in states], float) for i, name in enumerate(("q", "u", "p", "inputs", "t"))}
    shapes = solver._shapes
    for f in solver._opened.functions.values():
        for name in f.arguments:
            if name not in given:
                given[name] = rng.uniform(-1, 1, (n, *shapes[name]))
        for name, size in f.seeds.items():
            if name not in given:
                given[name] = rng.uniform(-1, 1, (k, n, size))
    return given


def some(given: dict[str, Any], f: Any, states: slice, shared: set[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments and seeds of some of the states; shared ones have no batch axis, or in seeds an axis of length one."""
    taken = {a: given[a][0] if a in shared else given[a][states] for a in f.arguments}
    along = {s: given[s][:, :1] if s in shared else given[s][:, states] for s in f.seeds}
    return taken, along


def call(
    target: Any, f: Any, taken: dict[str, Any], along: dict[str, Any], batch: tuple[int, ...], k: int
) -> list[Array]:
    taken = {n: float(x) if n == "t" and np.ndim(x) == 0 else x for n, x in taken.items()}
    return target.compute(f, taken, batch, Seeds(along, k) if f.seeds else NO_SEEDS)


def singles(target: Any, f: Any, given: dict[str, Any], n: int, k: int, shared: set[str]) -> list[Array] | None:
    """Results of the states one by one; None if one of them is singular."""
    found = []
    try:
        for i in range(n):
            taken, along = some(given, f, slice(i, i + 1), shared)
            taken = {a: x if a in shared else x[0] for a, x in taken.items()}
            along = {s: x[:, 0] for s, x in along.items()}
            found.append(call(target, f, taken, along, (), k))
    except SingularJointError:
        return None
    return [np.stack(x, axis=1 if d else 0) for x, d in zip(zip(*found, strict=True), f.derived, strict=True)]


def disagreement(target: Any, f: Any, given: dict[str, Any], sizes: tuple[int, ...], k: int, shared: set[str]) -> float:
    """The largest error of batches of these sizes, relative to the results of single states."""
    n = max(sizes)
    expected = singles(target, f, given, n, k, shared)
    if expected is None:
        return 0.0
    worst = 0.0
    for size in sizes:
        start = (7 * size) % (n - size + 1)
        states = slice(start, start + size)
        taken, along = some(given, f, states, shared)
        if all(a in shared for a in (*f.arguments, *f.seeds)):
            continue  # no argument has a batch axis
        found = call(target, f, taken, along, (size,), k)
        check_few(target, f, taken, along, found)
        for name, x, y, derived in zip(f.results, found, expected, f.derived, strict=True):
            one = y[:, states] if derived else y[states]
            assert np.shape(x) == one.shape, (f.name, name, size)
            scale = np.max(np.abs(one.astype(float)), initial=1e-3)
            difference = np.abs((x - one).astype(float))
            same = (difference <= ALIKE * scale) | (np.isnan(x.astype(float)) & np.isnan(one.astype(float)))
            assert same.all(), (f.name, name, size, float(difference.max()) / scale)
            worst = max(worst, float(np.max(difference, initial=0.0)) / scale)
    return worst


def check_few(target: Any, f: Any, taken: dict[str, Any], along: dict[str, Any], found: list[Array]) -> None:
    """Check that the function for small batches, if it takes these arguments, gives the same results."""
    given = tuple([taken.get(n, 0.0 if n == "t" else None) for n in f.order])
    small = target.calls[f.name](given, tuple([along.get(s) for s in f.directions]) if f.seeds else None, None)
    for name, x, y in zip(f.results, small or (), found, strict=small is not None):
        scale = np.max(np.abs(y), initial=1e-3)
        assert x.shape == y.shape and np.max(np.abs(x - y), initial=0.0) <= ALIKE * scale, (f.name, name)


def check(
    model: Model, states: list[tuple[Any, ...]], folder: Any, rng: np.random.Generator, sizes: tuple[int, ...]
) -> None:
    """Check every function of a package on batches of these sizes, with separate and with shared arguments."""
    codegen.generate(model, folder, check=False)
    solver = codegen.load(folder)
    k = int(rng.integers(1, 4))
    if solver.closure_names:
        q, u, p, inputs, t = (np.array([s[i] for s in states]) for i in range(5))
        q, u = solver.assemble(q, u, p, inputs, t)
        states = list(zip(q, u, p, inputs, t, strict=True))
    given = arguments(solver, states, rng, k)
    names = ("q", "u", "p", "inputs", "t", *(n for n in given if n not in ("q", "u", "p", "inputs", "t")))
    for target in (solver._target, codegen.load(folder, target="numpy")._target):
        for f in solver._opened.functions.values():
            if not f.has_entries():
                continue
            for shared in (set(), {n for n in names if rng.random() < 0.4} - {"q"}):
                disagreement(target, f, given, sizes, k, shared)
    exact = solver.in_precision(DIGITS)
    for f in (exact._opened.functions[n] for n in ("accelerations", "sensitivities") if n in exact._opened.functions):
        decimals = {n: exact._digits.as_mpf(x) for n, x in given.items()}
        disagreement(exact._target, f, decimals, (1, 2, 3, min(model.nq or 1, SIZES[-1])), k, set())


def drawn(rng: np.random.Generator) -> tuple[Model, list[tuple[Any, ...]]]:
    while True:
        found = drawn_mechanism(rng) if rng.random() < 0.4 else drawn_tree(rng)
        if found is not None and found[0].nu:
            return found


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiles functions over several states at the first batch."""
    monkeypatch.setattr(batches, "WORTH_COMPILING", 0)


def test_hinges_turned_about_their_axes(tmp_path: Any, at_once: None) -> None:
    """Sizes that are the number of hinges, and others."""
    model, rng = codegen.parse_model(TURNED), np.random.default_rng(0)
    check(model, [tuple(random_state(rng, model)) for _ in SIZES], tmp_path / "turned", rng, SIZES)


def test_grids_of_states_are_their_states(tmp_path: Any) -> None:
    """Several batch axes, in both targets, through the members of a solver."""
    model = codegen.parse_model(TURNED)
    codegen.generate(model, tmp_path / "turned", check=False)
    rng = np.random.default_rng(1)
    q, u = rng.normal(size=(2, 3, 1, model.nq)), rng.normal(size=(3, 4, model.nu))
    for target in ("c", "numpy"):
        solver = codegen.load(tmp_path / "turned", target=target)
        found = solver.accelerations(q, u)
        for i, j, n in itertools.product(range(2), range(3), range(4)):
            one = solver.accelerations(q[i, j, 0], u[j, n])
            np.testing.assert_allclose(found[i, j, n], one, rtol=ALIKE, atol=ALIKE * float(np.abs(one).max()))
    assert math.prod(found.shape) == 2 * 3 * 4 * model.nu


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(300))
def test_random_models_over_batches_of_every_size(seed: int, tmp_path: Any, at_once: None) -> None:
    rng = np.random.default_rng([30, seed])
    model, states = drawn(rng)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*redundant condition.*")
        check(model, states, tmp_path / "model", rng, SIZES)
