"""The closure matrix of an ear as Q R: modified Gram-Schmidt with a second pass, the stable form of Eqs. 33-38.

The paper's recursion projects the motions of joints, one after the other, out of the remaining conditions. Here each
column is projected twice, which leaves Q orthogonal to rounding for any condition number. A column with one entry, and
the second of two columns in a plane, need neither projection nor square root. If E has more rows than its rank, ``E x
= b`` is solved in the least-squares sense: in a consistent motion the redundant conditions agree.
"""

from __future__ import annotations

from dataclasses import field

from ...program.block import ANY, Scope
from ...program.limits import limits
from ...program.scalar import Value, Vector
from ...records import dataclass
from .. import fields
from ..spatial import cross, inner, product
from ..stores import EAR, RANK
from ..structure.factor_form import FactorForm, Step

SMALLEST = 1e-28
"""Rank is lost if projection leaves less than this fraction of a column's squared norm."""


class RankLossError(ValueError):
    """Raised if the closure matrix of an ear has fewer independent columns than dependent speeds in every
    configuration."""


@dataclass(slots=True)
class Factor:
    """The factors of a closure matrix, ``E = Q R``.

    Attributes
    ----------
    order : list of int
        Columns in the order of elimination.
    q : list of Vector
        Orthonormal columns, in that order.
    R : dict of (int, int) to value
        Entries above the diagonal, by place in the order.
    inverse : list
        Reciprocals of the diagonal of R.
    """

    x: Scope
    order: list[int] = field(default_factory=list)
    q: list[Vector] = field(default_factory=list)
    R: dict[tuple[int, int], Value] = field(default_factory=dict)
    inverse: Vector = field(default_factory=list)

    def solve(self, b: Vector, name: str, tag: str, lanes: bool = False) -> Vector:
        """The solution ``x`` of ``E x = b``, in the order of E's columns."""
        let = self.x.let
        n = len(self.order)
        y = [let(f"{name}_y", inner(qj, b), tag, lanes=lanes) for qj in self.q]
        found: Vector = [0] * n
        for j in reversed(range(n)):
            rest = y[j]
            for i in range(j + 1, n):
                rest = rest - product(self.R.get((j, i), 0), found[i])
            found[j] = let(name, product(rest, self.inverse[j]), tag, lanes=lanes)
        return self._sorted(found)

    def solve_transposed(self, g: Vector, name: str, tag: str, lanes: bool = False) -> Vector:
        """The shortest ``w`` that satisfies ``E^T w = g``."""
        return self.combined(self.weights(g, name, tag, lanes), name, tag, lanes)

    def weights(self, g: Vector, name: str, tag: str, lanes: bool = False) -> Vector:
        """The weights v of the columns of Q for which ``w = Q v`` is the shortest solution of ``E^T w = g``."""
        z: Vector = []
        for j, column in enumerate(self.order):
            rest = g[column]
            for i in range(j):
                rest = rest - product(self.R.get((i, j), 0), z[i])
            z.append(self.x.let(f"{name}_z", product(rest, self.inverse[j]), tag, lanes=lanes))
        return z

    def combined(self, weights: Vector, name: str, tag: str, lanes: bool = False) -> Vector:
        """The sum of the columns of Q with given weights."""
        rows = len(self.q[0]) if self.q else 0
        return [self.x.let(name, inner([q[i] for q in self.q], weights), tag, lanes=lanes) for i in range(rows)]

    def _sorted(self, values: Vector) -> Vector:
        result: Vector = [0] * len(values)
        for j, column in enumerate(self.order):
            result[column] = values[j]
        return result

    def store(self, rows: list[int], count: int) -> FactorForm:
        """Store the factor in the ear's record; returns its form, for `load_factor`.

        `rows` are the numbers of E's rows among all `count` conditions. These numbers and those of columns are part of
        the names of fields. On zero patterns all fields are stored, because the statements may find more zeros than the
        patterns; the order of elimination then differs.
        """
        if self.x.structural:
            for j in range(len(self.order)):
                for i in range(count):
                    self.x.store(EAR, fields.orthogonal_entry(j, i), ANY)
                for i in range(len(self.order)):
                    self.x.store(EAR, fields.triangular_entry(i, j), ANY)
        steps: list[Step] = []
        for j, column in enumerate(self.order):
            unit = [i for i, v in enumerate(self.q[j]) if isinstance(v, int) and v == 1]
            support = [] if unit else [i for i, v in enumerate(self.q[j]) if v != 0]
            above = [i for i in range(j) if self.R.get((i, j), 0) != 0]
            for i in support:
                self.x.store(EAR, fields.orthogonal_entry(column, rows[i]), self.q[j][i])
            for i in above:
                self.x.store(EAR, fields.triangular_entry(self.order[i], column), self.R[i, j])
            self.x.store(EAR, fields.inverse_diagonal(column), self.inverse[j])
            steps.append(Step(column, unit, support, above))
        return FactorForm(rows, steps)


def load_factor(x: Scope, form: FactorForm) -> Factor:
    """A factor that an earlier block has stored."""
    f = Factor(x)
    for j, step in enumerate(form.steps):
        f.order.append(step.column)
        entries = ((i, fields.orthogonal_entry(step.column, row)) for i, row in enumerate(form.rows))
        f.q.append([1 if i in step.unit else x.load(EAR, entry) if i in step.support else 0 for i, entry in entries])
        for i in step.above:
            f.R[i, j] = x.load(EAR, fields.triangular_entry(f.order[i], step.column))
        f.inverse.append(x.load(EAR, fields.inverse_diagonal(step.column)))
    return f


def _complement(x: Scope, q: list[Vector], tag: str) -> Vector:
    """The unit vector normal to the columns of `q`: n orthonormal vectors in n + 1 dimensions, n at most 3."""
    let = x.let
    if len(q) == 1:
        return [-q[0][1], q[0][0]]
    if len(q) == 2:
        return [let("q", e, tag) for e in cross(*q)]
    a, b, c = q
    minor = {(i, j): let("minor", a[i] * b[j] - a[j] * b[i], tag) for i in range(4) for j in range(i + 1, 4)}
    return [
        let("q", minor[1, 2] * c[3] - minor[1, 3] * c[2] + minor[2, 3] * c[1], tag),
        let("q", minor[0, 3] * c[2] - minor[0, 2] * c[3] - minor[2, 3] * c[0], tag),
        let("q", minor[0, 1] * c[3] - minor[0, 3] * c[1] + minor[1, 3] * c[0], tag),
        let("q", minor[0, 2] * c[1] - minor[0, 1] * c[2] - minor[1, 2] * c[0], tag),
    ]


def factor(x: Scope, columns: list[Vector], tag: str, size: float = 1.0) -> Factor:
    """Factor a matrix given by columns; those with few entries come first. The length of a column is of order `size`,
    except near a loss of rank."""
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
        spans = sorted({k for i in wide for k in range(rows) if f.q[i][k] != 0})
        if wide and len(wide) == len(spans) - 1 <= 3 and set(left) <= set(spans):
            # only one direction remains, which is normal to the other columns
            last = _complement(x, [[f.q[i][k] for k in spans] for i in wide], tag)
            f.q.append([last[spans.index(k)] if k in spans else 0 for k in range(rows)])
            for i in wide:
                f.R[i, j] = let("R", inner([f.q[i][k] for k in spans], [v[k] for k in spans]), tag)
            r = let("r", inner([f.q[-1][k] for k in spans], [v[k] for k in spans]), tag)
            square = r * r
        else:
            for again in (False, True):
                for i in wide:
                    q = f.q[i]
                    c = let("R", inner(q, v), tag)
                    if not again:  # the coefficients of the second pass are rounding errors, in R too
                        f.R[i, j] = c
                    v = [let("E", v[k] - product(c, q[k]), tag) for k in range(rows)]
            left = [k for k in range(rows) if v[k] != 0]
            if not left and not x.structural:
                raise RankLossError("a dependent joint does not move the faces of its loop relative to each other")
            if len(left) == 1:
                r = v[left[0]]
                square = r * r
                f.q.append([1 if k in left else 0 for k in range(rows)])
            else:
                square = let("rr", inner(v, v), tag)
                r = let("r", x.sqrt(square), tag)
                inverse = let("rinv", 1 / r, tag)
                f.q.append([let("q", product(e, inverse), tag) for e in v])
        if x.structural:
            r = ANY
        f.inverse.append(let("rinv", 1 / r, tag))
        above = sum(f.R[i, k] * f.R[i, k] for (i, k) in sorted(f.R) if k == j)
        # this check also reports a nearly zero column: its joint moves no face in this state
        margin = let(
            "margin", square - x.number(limits().rounding(SMALLEST, 2)) * (x.number(size * size) + above), "rank"
        )
        x.set_entry(RANK, j, margin)
    return f
