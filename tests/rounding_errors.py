"""Estimated and actual rounding errors, in 40 digits, of random trees and mechanisms and of difficult states."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import made_once
import mpmath
import numpy as np
from random_mechanisms import Discarded, random_mechanism
from random_models import ALL, random_seeds, random_state, random_tree

import codegen
from codegen.loops.errors import PartitionError
from codegen.loops.partition import partition
from codegen.model import Model
from codegen.reference import RecursiveEngine

UNIT = 2.0**-53
FUNCTIONS = ("accelerations", "sensitivities")
FACTOR = 30.0

CLOSED = 5e-16
"""The largest residual of loops that are closed."""


class Judged(NamedTuple):
    """The estimated and the actual error of a result, relative to its largest entry."""

    case: str
    what: str
    estimated: float
    actual: float

    @property
    def ratio(self) -> float:
        return max(self.estimated, UNIT) / max(self.actual, UNIT)

    @property
    def right(self) -> bool:
        return 1.0 / FACTOR <= self.ratio <= FACTOR


def judged(case: str, solver: codegen.Solver, model: Model, state: Any, seeds: dict[str, Any]) -> list[Judged]:
    """Errors of udot and of the derivative along each direction; empty if a result is not a finite real number."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = solver.diagnose(*state, **seeds)
        with mpmath.workdps(40):
            udot, dudot = RecursiveEngine(model, numbers="mpmath").sensitivities(*state, **seeds)
            if any(not mpmath.isfinite(x) for x in (*udot, *dudot.ravel())):
                return []
            if not (np.isfinite(found.udot).all() and np.isfinite(found.dudot).all()):
                return []
            off = np.abs(udot - found.udot).astype(float), np.abs(dudot - found.dudot).astype(float)
    rows = [("udot", found.udot, found.udot_error, off[0])]
    rows += [("derivative", *of) for of in zip(found.dudot, found.dudot_error, off[1], strict=True)]
    rows += [("entry", *(x[..., None] for x in of)) for row in rows for of in zip(*row[1:], strict=True)]
    return [
        Judged(case, what, float(error.max() / size), float(difference.max() / size))
        for what, value, error, difference in rows
        if (size := np.abs(value).max()) > 0.0
    ]


made = partial(made_once.made, functions=FUNCTIONS)


def of_trees(seed: int, folder: Path, target: str = "c") -> Iterator[Judged]:
    """A random tree at a random state, spinning fast, at angles of 1e6 rad, and with all angles zero."""
    rng = np.random.default_rng(seed)
    model = random_tree(rng, int(rng.integers(2, 9)), ALL)
    solver, (q, u, p, inputs, t) = made(model, folder, target=target), random_state(rng, model)
    seeds, turning = random_seeds(rng, model, 3), np.array(model.coordinate_units) == "rad"
    yield from judged("tree", solver, model, (q, u, p, inputs, t), seeds)
    yield from judged("tree, spinning", solver, model, (q, 1e4 * u, p, inputs, t), seeds)
    yield from judged("tree, 1e6 rad", solver, model, (np.where(turning, 1e6 * q, q), u, p, inputs, t), seeds)
    yield from judged("tree, zero angles", solver, model, (np.where(turning, 0.0, q), u, p, inputs, t), seeds)


def of_mechanisms(seed: int, folder: Path, target: str = "c") -> Iterator[Judged]:
    """A random mechanism in its drawn state, and two states near the limit of its reach, where the loops lose rank."""
    rng = np.random.default_rng(seed)
    drawn = random_mechanism(rng, bodies=(3, 6), loops=(1, 2))
    if isinstance(drawn, Discarded):
        return
    model, state = drawn.model, list(drawn[1:6])
    try:
        partition(model)
    except PartitionError:
        return
    seeds = consistent(model, state, random_seeds(rng, model, 3))
    solver = made(model, folder, target=target)
    yield from judged("mechanism", solver, model, state, seeds)
    for q, u in near_the_limit(solver, state, rng):
        yield from judged("mechanism near rank loss", solver, model, [q, u, *state[2:]], seeds)


def consistent(model: Model, state: Any, seeds: dict[str, Any]) -> dict[str, Any]:
    """The seeds, with zeros for parameters that would open redundant conditions."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        RecursiveEngine(model).sensitivities(*state, **seeds)
    opens = any("redundant condition" in str(w.message) for w in caught)
    return seeds | {"dp": 0.0 * seeds["dp"]} if opens else seeds


def near_the_limit(solver: codegen.Solver, state: Any, rng: np.random.Generator) -> Iterator[tuple[Any, Any]]:
    """Two assembled states on the way along a random direction of the independent coordinates, 1e-2 to 1e-13 before it ends.

    Newton's method may leave loops open there by much more than rounding. Two formulations agree on closed loops only, so such
    states are left out; a diagnosis tells the gap.
    """
    q, u, p = state[:3]
    parts = ("qw", "qx", "qy", "qz")
    moved = [
        i for i, n in enumerate(solver.coordinate_names)
        if n in solver.independent_names and n.rpartition(".")[2] not in parts
    ]  # fmt: skip
    along = np.zeros(solver.nq)
    along[moved] = rng.normal(size=len(moved))
    marks = sorted(10.0 ** -rng.uniform(2, 13, 2), reverse=True)
    reached, end, step, last = 0.0, np.inf, 0.05, q
    for _ in range(80 if moved else 0):
        guess = last.copy()
        guess[moved] = (q + (reached + step) * along / np.abs(along).max())[moved]
        try:
            found, _ = solver.assemble(guess, u, p)
            if np.abs(found - last).max() > 1.0:  # another way to assemble it
                raise ValueError
            reached, last = reached + step, found
        except ValueError:
            end = reached + step
        if end == np.inf:
            if reached > 3.0:
                return
            continue
        step = 0.5 * (end - reached)
        while marks and end - reached < marks[0]:
            marks.pop(0)
            found, speeds = solver.assemble(last, u, p)
            if np.abs(solver.closure(found, speeds, p)[0]).max() < CLOSED:
                yield found, speeds
        if not marks:
            return


def chain(n: int, masses: Any, *, planar: bool, length: float = 0.5, seed: int = 0) -> Model:
    """Hinged rods with their masses, on the ground; about y, or about axes that are drawn, with mass centres off the axis."""
    rng, L = np.random.default_rng(seed), length
    lines = ["model: chain", "gravity: [0, 0, -9.81]", "parameters: {k: 1.0}", "bodies:"]
    for i, m in enumerate(map(float, masses)):
        axis = "y" if planar else "xyz"[rng.integers(3)]
        x, y = (0.0, 0.0) if planar else (float(v) for v in 0.02 * L * rng.uniform(-1, 1, 2))
        lines.append(
            f"  b{i}: {{parent: {f'b{i - 1}' if i else 'ground'}, joint: {{type: revolute, axis: {axis}, at: [0, 0, "
            f"{L if i else 0!r}]}}, mass: {m!r}*k, com: [{x!r}, {y!r}, {L / 2!r}], "
            f"inertia: {{xx: {m * L * L / 11!r}, yy: {m * L * L / 12!r}, zz: {m * L * L / 30!r}}}}}"
        )
    return codegen.parse_model("\n".join(lines) + "\n")


MASSES = {
    "growing 1e10 times": lambda n, rng: 10.0 ** np.linspace(0, 10, n),
    "shrinking 1e10 times": lambda n, rng: 10.0 ** np.linspace(0, -10, n),
    "mixed over 1e10": lambda n, rng: 10.0 ** rng.uniform(-5, 5, n),
    "some of 1e-12": lambda n, rng: np.append(np.where(rng.random(n - 1) < 0.4, 1e-12, 1.0), 1.0),
    "equal": lambda n, rng: np.full(n, 1.0 / n),
}
"""Of the links of chains."""


def of_chains(seed: int, folder: Path, target: str = "c") -> Iterator[Judged]:
    """Chains with extreme masses: straight, coiled, folded, and in a random state."""
    rng, masses = np.random.default_rng(seed), list(MASSES)[seed % len(MASSES)]
    n = int(rng.integers(4, 25))
    model = chain(n, MASSES[masses](n, rng), planar=bool(seed % 3), seed=seed)
    solver, u = made(model, folder, target=target), rng.uniform(-1, 1, n)
    seeds = random_seeds(rng, model, 3)
    folded = np.where(np.arange(n) % 2, np.pi, 0.0) + 1e-4 * rng.normal(size=n)
    poses = {
        "random": rng.uniform(-2, 2, n),
        "straight": np.zeros(n),
        "coiled": np.full(n, np.pi / 8),
        "folded": folded,
    }
    for pose, q in poses.items():
        try:
            yield from judged(f"chain, {pose}", solver, model, (q, u, solver.parameters, [], 0.0), seeds)
        except ArithmeticError:  # no inertia left, by the reference's measure
            continue


CAMPAIGNS = {"trees": of_trees, "mechanisms": of_mechanisms, "chains": of_chains}
