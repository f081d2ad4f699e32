"""The closure matrix of an ear as Q R: modified Gram-Schmidt with a second pass, the stable form of Eqs. 33-38.

The paper's recursion projects one joint's motion after the other out of what is left to close. Here each column is projected twice, which
leaves Q orthogonal to rounding whatever the condition; a column with one entry, and the second of two columns in a plane, need
neither projection nor root. With more conditions than rank, ``E x = b`` is solved in the least-squares sense: on consistent motion
the redundant conditions agree.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import sympy
from sympy import Float

from ..program.block import ANY
from .spatial import Vec

SMALLEST = Float(1e-28)
"""Squared part of a column that must be left after projection: below it the closure matrix has lost rank."""


class RankLossError(ValueError):
    """The closure matrix of an ear has fewer independent columns than dependent speeds in every configuration."""


@dataclass(slots=True)
class Factor:
    """``E = Q R``.

    Attributes
    ----------
    order : list of int
        Columns in the order of elimination.
    q : list of Vec
        Orthonormal columns, in that order.
    R : dict of (int, int) to value
        Above the diagonal, by place in the order.
    inverse : list
        Of the diagonal.
    """

    x: Any
    order: list[int] = field(default_factory=list)
    q: list[Vec] = field(default_factory=list)
    R: dict[tuple[int, int], Any] = field(default_factory=dict)
    inverse: list[Any] = field(default_factory=list)

    def solve(self, b: Vec, name: str, tag: str, lanes: bool = False) -> list[Any]:
        """``x`` of ``E x = b``, in the order of E's columns."""
        let = self.x.let
        n = len(self.order)
        y = [let(f"{name}_y", _sum(product(q, v) for q, v in zip(qj, b, strict=True)), tag, lanes=lanes) for qj in self.q]
        found: list[Any] = [0] * n
        for j in reversed(range(n)):
            rest = y[j]
            for i in range(j + 1, n):
                rest = rest - product(self.R.get((j, i), 0), found[i])
            found[j] = let(name, product(rest, self.inverse[j]), tag, lanes=lanes)
        return self._sorted(found)

    def solve_transposed(self, g: list[Any], name: str, tag: str, lanes: bool = False) -> Vec:
        """The shortest ``w`` of ``E^T w = g``."""
        let = self.x.let
        z: list[Any] = []
        for j, column in enumerate(self.order):
            rest = g[column]
            for i in range(j):
                rest = rest - product(self.R.get((i, j), 0), z[i])
            z.append(let(f"{name}_z", product(rest, self.inverse[j]), tag, lanes=lanes))
        rows = len(self.q[0]) if self.q else 0
        return [
            let(name, _sum(product(q[i], v) for q, v in zip(self.q, z, strict=True)), tag, lanes=lanes) for i in range(rows)
        ]

    def _sorted(self, values: list[Any]) -> list[Any]:
        result: list[Any] = [0] * len(values)
        for j, column in enumerate(self.order):
            result[column] = values[j]
        return result

    def store(self, array: str) -> list[tuple[int, list[int], list[int], list[tuple[int, int]]]]:
        """Keep the factor in a record; returns its structure, for `load`."""
        structure = []
        for j, column in enumerate(self.order):
            unit = [i for i, v in enumerate(self.q[j]) if v == 1]
            support = [] if unit else [i for i, v in enumerate(self.q[j]) if v != 0]
            above = [(i, j) for i in range(j) if self.R.get((i, j), 0) != 0]
            for i in support:
                self.x.store(array, f"q{j}.{i}", self.q[j][i])
            for i, _ in above:
                self.x.store(array, f"R{i}.{j}", self.R[i, j])
            self.x.store(array, f"d{j}", self.inverse[j])
            structure.append((column, unit, support, above))
        return structure


def load_factor(x: Any, array: str, rows: int, structure: Any) -> Factor:
    """A factor that an earlier block has stored."""
    f = Factor(x)
    for j, (column, unit, support, above) in enumerate(structure):
        f.order.append(column)
        f.q.append([1 if i in unit else x.load(array, f"q{j}.{i}") if i in support else 0 for i in range(rows)])
        for i, _ in above:
            f.R[i, j] = x.load(array, f"R{i}.{j}")
        f.inverse.append(x.load(array, f"d{j}"))
    return f


def product(a: Any, b: Any) -> Any:
    """Of values any of which may be the int 0 or 1."""
    return b if isinstance(a, int) and a == 1 else a * b


def _sum(terms: Any) -> Any:
    total: Any = 0
    for t in terms:
        total = total + t
    return total


def factor(x: Any, columns: list[Vec], tag: str) -> Factor:
    """Factor a matrix given by its columns, the ones with fewest entries first."""
    let = x.let
    f = Factor(x)
    support = [[i for i, v in enumerate(c) if v != 0] for c in columns]
    f.order = sorted(range(len(columns)), key=lambda k: len(support[k]))
    rows = len(columns[0]) if columns else 0
    for j, column in enumerate(f.order):
        v = [let("E", e, tag) for e in columns[column]]
        for i, q in enumerate(f.q):
            if sum(e == 1 for e in q) == 1:  # a coordinate direction: the projection is exact
                k = next(k for k in range(rows) if q[k] == 1)
                if v[k] != 0:
                    f.R[i, j] = v[k]
                    v[k] = 0
        left = [k for k in range(rows) if v[k] != 0]
        wide = [i for i, q in enumerate(f.q) if not any(e == 1 for e in q) and any(q[k] != 0 for k in left)]
        spans = [k for i in wide for k in range(rows) if f.q[i][k] != 0]
        if len(wide) == 1 and len(spans) == 2 and set(left) <= set(spans):
            # two columns in a plane: the second direction is the first one turned
            (i,), (a, b) = wide, spans
            q = f.q[i]
            f.R[i, j] = let("R", product(q[a], v[a]) + product(q[b], v[b]), tag)
            r = let("r", product(q[a], v[b]) - product(q[b], v[a]), tag)
            turned: Vec = [0] * rows
            turned[a], turned[b] = -q[b], q[a]
            f.q.append(turned)
        else:
            for _ in range(2):
                for i in wide:
                    q = f.q[i]
                    c = let("R", _sum(product(q[k], v[k]) for k in range(rows)), tag)
                    f.R[i, j] = let("R", f.R.get((i, j), 0) + c, tag)
                    v = [let("E", v[k] - product(c, q[k]), tag) for k in range(rows)]
            left = [k for k in range(rows) if v[k] != 0]
            if not left and not x.structural:
                raise RankLossError("a dependent joint moves nothing that the loop could close with")
            if len(left) == 1:
                r = v[left[0]]
                f.q.append([1 if k in left else 0 for k in range(rows)])
            else:
                length = _sum(v[k] * v[k] for k in range(rows))
                r = ANY if x.structural else let("r", sympy.sqrt(let("rr", length, tag)), tag)
                inverse = let("rinv", 1 / r, tag)
                f.q.append([let("q", product(e, inverse), tag) for e in v])
        if x.structural:
            r = ANY
        f.inverse.append(let("rinv", 1 / r, tag))
        above = _sum(f.R[i, k] * f.R[i, k] for (i, k) in sorted(f.R) if k == j)
        margin = let("margin", r * r - (0 if x.structural else SMALLEST) * above, "rank")
        x.store("rank", str(j), margin)
    return f


__all__ = ["Factor", "RankLossError", "factor", "load_factor", "product"]
