"""Estimates of the number of terms in equations of motion, before they are computed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import sympy

from ..model.members import joint_coordinates
from ..model.model import GROUND, Model
from .errors import TooManyProductsError
from .polynomials import Polynomial
from .system import SymbolicEngine

SURE = 3
"""Largest number of bodies on a path from the ground for which equations are computed without an estimate."""

PRODUCTS = 60_000
"""Largest number of products of terms for an estimate."""


FIRST, GROWTH = 8, 5 / 3
"""`FIRST`: largest number of bodies on a path for which the terms of equations with intermediate variables are counted.
`GROWTH`: on longer paths, their number grows with this power of the number of bodies."""


def expected_terms(model: Model, parameters: Mapping[str, Any], intermediates: bool = False) -> float:
    """Estimated number of terms of mass matrix and right side, without loops and force elements.

    The first few bodies of the longest path from the ground are computed. Each further body multiplies the number of
    terms by a factor, which decreases from body to body half as quickly as among the first bodies. Zero for models that
    are small.
    """
    path = longest_path(model)
    if len(path) <= (FIRST if intermediates else SURE):
        return 0.0
    if intermediates:
        engine = SymbolicEngine(_beginning(model, path[:FIRST]), parameters, None, True)
        entries = [*engine.mass.flat, *engine.right_side.flat, *engine.symbolic.algebra.definitions.values()]
        return sum(len(x.terms) for x in entries) * (len(path) / FIRST) ** GROWTH * len(model.bodies) / len(path)
    counts: list[int] = []
    for length in range(1, len(path) + 1):
        engine = SymbolicEngine(_beginning(model, path[:length]), parameters, PRODUCTS)
        try:
            counts.append(sum(len(x.terms) for of in (engine.mass, engine.right_side) for x in of.flat))
        except TooManyProductsError:
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


def most_terms(model: Model, parameters: Mapping[str, Any]) -> float:
    """A bound of the number of terms with multipliers, from the equations with intermediate variables.

    A product has at most as many terms as its factors multiplied, and a polynomial at most as many as there are monomials of
    its degrees.
    """
    engine = SymbolicEngine(model, parameters, None, True)
    entries = [*engine.mass.flat, *engine.right_side.flat]
    if model.loops:
        entries += [x for of in (engine.constraints.jacobian, engine.constraints.remainder) for x in of.flat]
    algebra, known = engine.symbolic.algebra, dict[int, tuple[float, Degrees]]()

    def of(p: Polynomial) -> tuple[float, Degrees]:
        total, degrees = 0.0, Degrees()
        for monomial in p.terms:
            count, own = 1.0, Degrees()
            for a, e in monomial:
                inner, powers = known.get(a) or (1.0, {_variable(algebra.atoms[a].expression): 1})
                count *= inner ** max(e, 1)
                for variable, degree in powers.items():
                    own[variable] = own.get(variable, 0) + degree * abs(e)
            total += count
            degrees = {v: max(own.get(v, 0), degrees.get(v, 0)) for v in own | degrees}
        monomials = (
            2.0 * d + 1 if v.is_Function else d + 1.0 for v, d in degrees.items()
        )  # sines occur to the first power at most
        return min(total, math.prod(monomials)), degrees

    for a, value in algebra.definitions.items():
        if a not in algebra.factored:
            known[a] = of(value)
    return sum(of(x)[0] for x in entries)


Degrees = dict[sympy.Basic, int]
"""The degree of a polynomial in each variable."""


def _variable(atom: sympy.Expr) -> sympy.Expr:
    """The variable of an atom; sine and cosine of one angle have the same variable."""
    return sympy.cos(atom.args[0]) if isinstance(atom, sympy.sin) else atom


def longest_path(model: Model) -> list[int]:
    """The bodies on the longest path from the ground."""
    paths: dict[int, list[int]] = {GROUND: []}
    for k in model.outward:
        paths[k] = [*paths[model.bodies[k].parent], k]
    return max(paths.values(), key=len)


def _beginning(model: Model, path: list[int]) -> Model:
    """The model with only the bodies of a path, without loops, force elements and outputs."""
    bodies = tuple(replace(model.bodies[k], parent=n - 1 if n else GROUND) for n, k in enumerate(path))
    names = {q for b in bodies for q in joint_coordinates(b.name, b.joint.type)[0]}
    return replace(
        model, bodies=bodies, loops=(), forces=(), loads=(), outputs=(), points=(), independent=(), initial_q={}, initial_u={},
        motion={name: e for name, e in model.motion.items() if name in names},
    )  # fmt: skip


__all__ = ["expected_terms", "longest_path", "most_terms"]
