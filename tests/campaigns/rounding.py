"""Rounding errors: results in double precision against the same statements in 40 digits, on random models and long chains.

    python tests/campaigns/rounding.py --draws 60 --chains 10 100 1000

Errors are relative: the largest difference over the largest entry, of udot, and direction by direction of derivatives; figures
are multiples of 2^-53 = 1.1e-16. What vanishes but for the rounding of the model's own constants (`VANISHING`) has no digits and
is left out, and counted. Both start from the same doubles, states and constants of the program. Random models and states
are those of the tests, mechanisms of any condition among them; the NumPy module computes. Of chains every rod has length and
mass 1/n; the first is horizontal, and the others lie straight or coiled, every joint at 22.5 degrees; speeds are random.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from random_elements import with_random_elements  # noqa: E402
from random_mechanisms import random_mechanisms  # noqa: E402
from random_models import EVERY, random_state, random_tree  # noqa: E402

import codegen  # noqa: E402
from codegen.loops.errors import PartitionError  # noqa: E402
from codegen.model.errors import ModelError  # noqa: E402

UNIT = 2.0**-53
DIGITS = 40
VANISHING = 1e-12
"""Largest entries below, in parts of udot, or of the square of the speeds for udot itself."""
FUNCTIONS = ("sensitivities", "gradients")

CHAIN = """
model: chain
gravity: [0, 0, -9.81]
constants: {{n: {n}}}
parameters:
  length: {{value: {size!r}, unit: m}}
  mass: {{value: {size!r}, unit: kg}}
bodies:
  repeat k in 1..n:
    link(k):
      parent: link(k-1)
      joint: {{type: revolute, axis: y, at: [0, 0, -length]}}
      shape: {{type: cylinder, axis: z, length: length, radius: length/10, mass: mass, center: [0, 0, -length/2]}}
      first: {{parent: ground, joint: {{at: [0, 0, 0]}}}}
"""
"""Uniform rods in a plane, hinged at their ends."""


def errors(
    solver: Any, exact: Any, state: tuple[Any, ...], rng: np.random.Generator, k: int = 3
) -> dict[str, list[float]]:
    """Relative errors, in multiples of `UNIT`, of udot and of derivatives along k random directions of each argument."""
    found: dict[str, list[float]] = {}
    sizes = {"dq": solver.nq, "du": solver.nu, "dp": solver.np}
    for name, n in sizes.items():
        seeds = {name: rng.uniform(-1, 1, (k, n))}
        values = solver.sensitivities(*state, **seeds)
        expected = exact.sensitivities(*state, **seeds)
        speeds, of_udot = (max(map(abs, x), default=0) for x in (state[1], expected[0]))
        found["udot"] = [relative(values[0], expected[0], float(speeds) ** 2)]
        found[name.replace("d", "udot by ")] = [
            relative(a, b, float(of_udot)) for a, b in zip(values[1], expected[1], strict=True)
        ]
    weights = rng.uniform(-1, 1, (k, solver.nu))
    g, g_exact = (s.gradients(*state, weights=weights) for s in (solver, exact))
    for name in ("q", "u", "p"):
        pairs = zip(getattr(g, name), getattr(g_exact, name), strict=True)
        found[f"gradient by {name}"] = [relative(a, b, float(of_udot)) for a, b in pairs]
    return found


def relative(x: Any, exact: Any, beside: float) -> float:
    """Largest difference over largest entry, in multiples of `UNIT`; zero where both are zero, NaN where it vanishes."""
    largest, difference = (max(map(abs, y), default=0) for y in (exact, x - exact))
    if difference > 0 and largest <= VANISHING * beside:
        return float("nan")
    return float(difference / largest) / UNIT if largest > 0 else float("inf") if difference > 0 else 0.0


def trees(draws: int) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    """Random trees with forces, and states."""
    for seed in range(draws):
        rng = np.random.default_rng([seed, 1])
        model = with_random_elements(rng, random_tree(rng, int(rng.integers(2, 13)), EVERY, True, True))
        if model.nu:
            yield model, tuple(random_state(rng, model))


def mechanisms(draws: int) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    """Random mechanisms with closed loops."""
    for _, m in random_mechanisms(draws, 7000):
        yield m.model, tuple(m[1:6])


def chain(n: int, angle: float) -> tuple[Any, tuple[Any, ...]]:
    """A planar chain of n rods of total length and mass 1; the first is horizontal, each other at an angle to the rod before."""
    q = np.full(n, angle)
    q[0] = np.pi / 2
    u = np.random.default_rng(n).uniform(-1, 1, n)
    return codegen.parse_model(CHAIN.format(n=n, size=1.0 / n)), (q, u)


def measured(model: Any, state: tuple[Any, ...], rng: np.random.Generator) -> dict[str, list[float]] | None:
    """Errors of a model's solver at a state; None if the model has no solver, or the state is singular."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            codegen.generate(model, Path(folder) / "package", target="numpy", functions=FUNCTIONS, compile=False)
            solver = codegen.load(Path(folder) / "package")
            if model.loops:
                state = (*solver.assemble(*state[:3]), *state[2:])
            return errors(solver, solver.in_precision(DIGITS), state, rng)
        except (ModelError, PartitionError, codegen.runtime.SingularJointError, codegen.runtime.AssemblyError):
            return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--draws", type=int, default=60, help="of trees, and of mechanisms")
    parser.add_argument("--of", nargs="*", default=["trees", "loops"], choices=("trees", "loops"))
    parser.add_argument("--chains", type=int, nargs="*", default=[10, 100, 1000])
    parser.add_argument("--json", type=Path, help="where to write all errors")
    arguments = parser.parse_args()
    kept: dict[str, dict[str, list[float]]] = {}
    for name, drawn in (("trees", trees(arguments.draws)), ("loops", mechanisms(arguments.draws))):
        if name not in arguments.of:
            continue
        of_all, models = kept.setdefault(name, {}), 0
        for n, (model, state) in enumerate(drawn):
            found = measured(model, state, np.random.default_rng(n))
            models += found is not None
            for what, values in (found or {}).items():
                of_all.setdefault(what, []).extend(values)
        print(f"\n{name}: {models} models", flush=True)
        for what, values in of_all.items():
            median, most, worst = np.nanquantile(values, [0.5, 0.95, 1.0])
            vanish = int(np.isnan(values).sum())
            print(
                f"| {what} | {median:.2g} | {most:.2g} | {worst:.2g} |{f' {vanish} vanish' * (vanish > 0)}", flush=True
            )
    for n in arguments.chains:
        for name, angle in (("straight", 0.0), ("coiled", np.pi / 8)):
            found = measured(*chain(n, angle), np.random.default_rng(n))
            assert found is not None
            if not any(key.startswith("straight") for key in kept):
                print(f"\n| chain | n | {' | '.join(found)} |")
            kept[f"{name} {n}"] = found
            print(f"| {name} | {n} | " + " | ".join(f"{max(v):.2g}" for v in found.values()) + " |", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(kept), encoding="utf-8")


if __name__ == "__main__":
    main()
