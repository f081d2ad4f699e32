"""How many terms equations of motion will have, before they are computed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

from ..model.members import joint_coordinates
from ..model.model import GROUND, Model
from .errors import TooLargeError
from .system import SymbolicEngine

SURE = 3
"""Bodies on a path from the ground up to which equations are computed without an estimate."""

PRODUCTS = 60_000
"""Products of terms that an estimate may take."""


def expected_terms(model: Model, parameters: Mapping[str, Any]) -> float:
    """About how many terms mass matrix and right side have, without loops and force elements.

    The first few bodies of the longest path from the ground are computed. Each further body multiplies the number of terms, by
    a factor that decreases from body to body as it did before, but half as quickly. Zero for models that are small.
    """
    path = longest_path(model)
    if len(path) <= SURE:
        return 0.0
    counts: list[int] = []
    for length in range(1, len(path) + 1):
        engine = SymbolicEngine(_beginning(model, path[:length]), parameters, PRODUCTS)
        try:
            counts.append(sum(len(x.terms) for of in (engine.mass, engine.right_side) for x in of.flat))
        except TooLargeError:
            break
    if len(counts) == len(path):
        return float(counts[-1] * len(model.bodies) / len(path))
    factors = [b / a for a, b in pairwise(counts) if a]
    if not factors:
        return math.inf
    decrease = math.sqrt(min(1.0, factors[-1] / factors[-2])) if len(factors) > 1 else 0.7
    terms, factor = float(counts[-1]), factors[-1]
    for _ in range(len(path) - len(counts)):
        factor = max(factor * decrease, 1.0)
        terms *= factor
    return terms * len(model.bodies) / len(path)


def longest_path(model: Model) -> list[int]:
    """Bodies from the ground to the one with most bodies between."""
    paths: dict[int, list[int]] = {GROUND: []}
    for k in model.outward:
        paths[k] = [*paths[model.bodies[k].parent], k]
    return max(paths.values(), key=len)


def _beginning(model: Model, path: list[int]) -> Model:
    """The model with bodies of a path alone, without loops, force elements and outputs."""
    bodies = tuple(replace(model.bodies[k], parent=n - 1 if n else GROUND) for n, k in enumerate(path))
    names = {q for b in bodies for q in joint_coordinates(b.name, b.joint.type)[0]}
    return replace(
        model, bodies=bodies, loops=(), forces=(), loads=(), outputs=(), points=(), independent=(), initial_q={}, initial_u={},
        motion={name: e for name, e in model.motion.items() if name in names},
    )  # fmt: skip


__all__ = ["expected_terms", "longest_path"]
