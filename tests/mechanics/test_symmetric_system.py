"""Elimination and back substitution: identities for joints of trees and for sources of regions, against NumPy."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
import pytest
from numeric_scope import Numbers

from codegen.mechanics.elimination import (
    OF_FREEDOMS,
    OF_SOURCES,
    SMALL,
    PivotFields,
    SymmetricSystem,
    ZeroPivotError,
    eliminate_force,
    substitute,
)
from codegen.mechanics.joints import Column
from codegen.mechanics.stores import LREGION, MY_LANE, PIVOT
from codegen.program.block import ANY, Expansion, StructuralExpansion

Array = np.ndarray[Any, Any]

COLUMNS = {
    "revolute": [Column(2)],
    "prismatic": [Column(3)],
    "screw": [Column(1, {4: 0.37})],
    "cylindrical": [Column(0), Column(3)],
    "planar": [Column(2), Column(3), Column(4)],
    "spherical": [Column(i) for i in range(3)],
    "free": [Column(i) for i in range(6)],
    "oblique": [Column(0, {1: 0.6, 5: -1.2}), Column(4, {3: 0.25})],
}
"""Joints by how they move their link; some that no joint has."""


def dense(columns: list[Column], n: int) -> Array:
    """The columns as a matrix."""
    return np.array([[float(s[i]) for i in range(n)] for s in columns]).T


def drawn(n: int, seed: int) -> tuple[Array, Array]:
    """A positive definite matrix and a vector."""
    rng = np.random.default_rng((n, seed))
    B = rng.normal(size=(n, n))
    return B @ B.T + 0.1 * np.eye(n), rng.normal(size=n)


class Eliminated:
    """A system after elimination, in numbers, and its dense matrices."""

    def __init__(self, columns: list[Column], n: int, kept: PivotFields, seed: int = 0, left: range | None = None):
        self.x, self.kept, self.columns, self.left = Numbers(), kept, columns, left
        self.Q, self.p = drawn(n, seed)
        self.tau = np.random.default_rng(seed).normal(size=len(columns))
        self.S = dense(columns, n)
        self.M = self.S.T @ self.Q @ self.S
        self.system = SymmetricSystem(self.x, None, self.Q.tolist(), self.p.tolist(), kept, [""] * n)  # type: ignore[arg-type]
        for j in reversed(range(len(columns))):
            whole = float(columns[j].squares_along([1.0, 1.0]))
            self.system.eliminate(j, columns[j], self.tau[j], whole, left if j == 0 else None)

    def remaining(self, p: Array, tau: Array) -> Array:
        """The remaining force on the other unknowns, by dense matrices."""
        return p + self.Q @ self.S @ np.linalg.solve(self.M, tau - self.S.T @ p)


TREES = [(name, n) for name in COLUMNS for n in (6, 12, 18)]


@pytest.mark.parametrize(("joint", "n"), TREES)
def test_what_is_left_is_the_schur_complement(joint, n):
    of = Eliminated(COLUMNS[joint], n, OF_FREEDOMS)
    left, force = np.array(of.system.Q, float), np.array(of.system.p, float)
    QS = of.Q @ of.S
    assert np.abs(left - (of.Q - QS @ np.linalg.solve(of.M, QS.T))).max() < 1e-11
    assert np.abs(force - of.remaining(of.p, of.tau)).max() < 1e-11
    assert (left == left.T).all()
    assert np.linalg.eigvalsh(left)[0] > -1e-12


@pytest.mark.parametrize(("joint", "n"), TREES)
def test_nothing_is_left_along_the_freedoms_but_their_forces(joint, n):
    of = Eliminated(COLUMNS[joint], n, OF_FREEDOMS)
    assert np.abs(np.array(of.system.Q, float) @ of.S).max() < 1e-12
    assert of.S.T @ np.array(of.system.p, float) == pytest.approx(of.tau, abs=1e-12)
    for s in of.columns:
        if not s.others:  # exactly: they are not computed
            assert not any(of.system.Q[s.lead])


@pytest.mark.parametrize(("joint", "n"), TREES)
def test_back_substitution_gives_the_accelerations(joint, n):
    """With the others' accelerations the force along every freedom is what was given."""
    of = Eliminated(COLUMNS[joint], n, OF_FREEDOMS)
    before = np.random.default_rng(9).normal(size=n)
    a = before.tolist()
    udot = [substitute(of.x, of.kept, of.kept.store, j, s, a, "udot", False) for j, s in enumerate(of.columns)]
    assert udot == pytest.approx(np.linalg.solve(of.M, of.tau - of.S.T @ (of.Q @ before + of.p)), abs=1e-10)
    assert a == pytest.approx(before + of.S @ udot)
    assert of.S.T @ (of.Q @ a + of.p) == pytest.approx(of.tau, abs=1e-9)
    # to the others it is as if they had what is left, and no freedom beside them
    assert of.Q @ a + of.p == pytest.approx(np.array(of.system.Q, float) @ before + of.system.p, abs=1e-9)


@pytest.mark.parametrize(("joint", "n"), TREES)
def test_another_right_side_is_eliminated_by_the_same_pivots(joint, n):
    of = Eliminated(COLUMNS[joint], n, OF_FREEDOMS)
    rng = np.random.default_rng(3)
    p, tau, before = rng.normal(size=n), rng.normal(size=len(of.columns)), rng.normal(size=n)
    P = p.tolist()
    for j in reversed(range(len(of.columns))):
        eliminate_force(of.x, of.kept, MY_LANE, j, of.columns[j], P, tau[j], [""] * n)
    assert np.abs(P - of.remaining(p, tau)).max() < 1e-11
    a = before.tolist()
    found = [substitute(of.x, of.kept, MY_LANE, j, s, a, "udot", True) for j, s in enumerate(of.columns)]
    assert found == pytest.approx(np.linalg.solve(of.M, tau - of.S.T @ (of.Q @ before + p)), abs=1e-10)


@pytest.mark.parametrize("joint", COLUMNS)
def test_on_the_ground_partners_get_the_same_and_the_link_nothing(joint):
    whole, grounded = (Eliminated(COLUMNS[joint], 12, OF_FREEDOMS, left=left) for left in (None, range(6, 12)))
    assert grounded.system.block(6, 6) == whole.system.block(6, 6)
    assert grounded.system.p[6:] == whole.system.p[6:]
    a = [0.0] * 6 + np.random.default_rng(4).normal(size=6).tolist()
    b = list(a)
    for j, s in enumerate(COLUMNS[joint]):
        assert substitute(whole.x, whole.kept, whole.kept.store, j, s, a, "udot", False) == substitute(
            grounded.x, grounded.kept, grounded.kept.store, j, s, b, "udot", False
        )


@pytest.mark.parametrize(("sources", "outer"), [(1, 0), (1, 6), (2, 6), (3, 12), (5, 18)])
def test_sources_of_a_region(sources, outer):
    """Unknowns that are eliminated themselves: the whole system is solved."""
    n = sources + outer
    columns = [Column(c) for c in range(sources)]
    of = Eliminated(columns, n, OF_SOURCES, seed=2)
    rng = np.random.default_rng(6)
    P = rng.normal(size=n)
    moving = P.tolist()
    for j in reversed(range(sources)):
        eliminate_force(of.x, of.kept, LREGION, j, columns[j], moving, 0, [""] * n)
    known = rng.normal(size=outer)
    for right, p, tau in ((of.kept.store, of.p, of.tau), (LREGION, P, np.zeros(sources))):
        a: list[Any] = [0] * sources + known.tolist()
        for j in range(sources):
            substitute(of.x, of.kept, right, j, columns[j], a, "a", False)
        among, across = of.Q[:sources, :sources], of.Q[:sources, sources:]
        assert a[:sources] == pytest.approx(np.linalg.solve(among, tau - p[:sources] - across @ known), abs=1e-9)
    assert moving[sources:] == pytest.approx(of.remaining(P, np.zeros(sources))[sources:], abs=1e-10)


@pytest.mark.parametrize("joint", ["planar", "oblique", "spherical"])
def test_the_order_of_freedoms_is_free(joint):
    of = Eliminated(COLUMNS[joint], 12, OF_FREEDOMS)
    for order in permutations(range(len(of.columns))):
        columns = [of.columns[j] for j in order]
        other = SymmetricSystem(Numbers(), None, of.Q.tolist(), of.p.tolist(), OF_FREEDOMS, [""] * 12)  # type: ignore[arg-type]
        for j in reversed(range(len(columns))):
            other.eliminate(j, columns[j], of.tau[order[j]], 1.0)
        assert np.abs(np.subtract(other.Q, of.system.Q).astype(float)).max() < 1e-11
        assert np.abs(np.subtract(other.p, of.system.p).astype(float)).max() < 1e-11


def test_the_margin_is_what_of_a_pivot_is_above_a_share_of_the_whole():
    x = Numbers()
    Q = np.diag([3.0, 2.0]).tolist()
    system = SymmetricSystem(x, None, Q, [0.0, 0.0], OF_SOURCES, ["", ""])  # type: ignore[arg-type]
    system.eliminate(1, Column(1), 0, 5e14)
    system.eliminate(0, Column(0), 0, 4e15)
    assert dict(x.stored(PIVOT)) == pytest.approx({"1": 2 - 5e14 * SMALL, "0": 3 - 4e15 * SMALL})
    assert dict(x.stored(PIVOT))["1"] > 0 > dict(x.stored(PIVOT))["0"]


def test_a_pivot_that_is_zero_in_every_state_is_an_error():
    Q: list[list[Any]] = [[0, 0], [0, 1.0]]
    with pytest.raises(ZeroPivotError):
        SymmetricSystem(Numbers(), None, Q, [0.0, 0.0], OF_SOURCES, ["", ""]).eliminate(0, Column(0), 0, 1.0)  # type: ignore[arg-type]
    pattern = StructuralExpansion("pattern", lambda store, name: True)
    # children's patterns may come later
    SymmetricSystem(pattern, None, [[0, 0], [0, ANY]], [ANY, ANY], OF_SOURCES, ["", ""]).eliminate(0, Column(0), 0, ANY)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(8))
def test_the_pattern_covers_the_numbers(seed):
    """Of sparse systems: every entry that can be there in numbers is marked, and eliminated unknowns leave zeros."""
    rng, n = np.random.default_rng(seed), 12
    mask = np.triu(rng.random((n, n)) < 0.3)
    mask = mask | mask.T | np.eye(n, dtype=bool)
    Q = np.where(mask, drawn(n, seed)[0] + n * np.eye(n), 0)
    columns = [Column(int(i)) for i in rng.permutation(6)[:3]]
    x = StructuralExpansion("pattern", lambda store, name: True)
    marks = SymmetricSystem(x, None, [[ANY if v else 0 for v in row] for row in Q], [ANY] * n, OF_FREEDOMS, [""] * n)  # type: ignore[arg-type]
    found = SymmetricSystem(
        Numbers(),
        None,
        [[float(v) if v else 0 for v in row] for row in Q],
        [1.0] * n,
        OF_FREEDOMS,
        [""] * n,  # type: ignore[arg-type]
    )
    for j in reversed(range(3)):
        for system, tau in ((marks, ANY), (found, 1.0)):
            system.eliminate(j, columns[j], tau, 1)
    for marked, numbers in zip(marks.Q, found.Q, strict=True):
        assert all(m != 0 for m, v in zip(marked, numbers, strict=True) if v != 0)
    for s in columns:
        assert not any(marks.Q[s.lead])


def test_symmetric_entries_are_written_once():
    """Eliminating one of n unknowns costs n (n - 1) / 2 entries, n - 1 forces and as many gains, a quotient and a right side."""
    n = 6
    x = Expansion("elimination", "elimination", lambda store, name: True)
    Q = [[x.component(OF_SOURCES.store, f"Q{min(i, k)}.{max(i, k)}") for k in range(n)] for i in range(n)]
    p = [x.component(OF_SOURCES.store, f"g{i}") for i in range(n)]
    SymmetricSystem(x, None, Q, p, OF_FREEDOMS, [*map(str, range(n))]).eliminate(0, Column(2), 0, Q[2][2])  # type: ignore[arg-type]
    names = [str(s.target) for s in x.block.statements]
    assert sum(name.startswith("A") for name in names) == n * (n - 1) // 2
    assert sum(name.startswith("p") for name in names) == n - 1
    assert sum(name.startswith("G") for name in names) == n - 1
    assert len(names) == n * (n - 1) // 2 + 2 * (n - 1) + 3  # 1/D, r/D and the margin
