"""The orthogonal factor of closure matrices: its identities, on numbers against NumPy and on patterns of zeros."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numeric_scope import Numbers

from codegen.mechanics.ears.orthogonal import SMALLEST, Factor, RankLossError, factor, load_factor
from codegen.mechanics.stores import RANK
from codegen.program.block import ANY, StructuralExpansion

Array = np.ndarray[Any, Any]
SIZES = [(1, 1), (2, 2), (3, 3), (3, 2), (4, 4), (5, 3), (6, 6), (9, 6), (12, 9)]
EPSILON = np.finfo(float).eps


def columns(E: Array) -> list[list[Any]]:
    """Columns with the int 0 for structural zeros, as in closure matrices."""
    return [[float(v) if v else 0 for v in column] for column in E.T]


def random_matrix(rows: int, count: int, seed: int, density: float = 1.0) -> Array:
    """A matrix of full rank with structural zeros."""
    rng = np.random.default_rng((rows, count, seed))
    while True:
        E = rng.normal(size=(rows, count)) * (rng.random((rows, count)) < density)
        if np.linalg.cond(E) < 1e6:
            return E


def factored(E: Array) -> Factor:
    return factor(Numbers(), columns(E), "test")


def parts(f: Factor) -> tuple[Array, Array]:
    """Q and R of the factorisation."""
    n = len(f.order)
    R = np.diag([1 / float(d) for d in f.inverse])
    for (i, j), value in f.R.items():
        R[i, j] = value
    return np.array(f.q, float).T.reshape(-1, n), R


def matrices() -> list[Any]:
    return [
        pytest.param(random_matrix(m, n, seed, density), id=f"{m}x{n}-{density}-{seed}")
        for m, n in SIZES for density in (1.0, 0.5) for seed in range(3) if density == 1.0 or m > 2
    ]  # fmt: skip


@pytest.mark.parametrize("E", matrices())
def test_q_is_orthogonal_and_q_r_is_the_matrix(E):
    f = factored(E)
    Q, R = parts(f)
    n = E.shape[1]
    assert sorted(f.order) == list(range(n))
    assert np.abs(Q.T @ Q - np.eye(n)).max() < 20 * EPSILON
    assert np.abs(Q @ R - E[:, f.order]).max() < 20 * EPSILON * np.abs(E).max()
    assert not np.tril(R, -1).any()
    # numpy's is the same but for signs of rows
    assert np.abs(R) == pytest.approx(np.abs(np.linalg.qr(E[:, f.order], mode="r")), rel=1e-8, abs=1e-10)


@pytest.mark.parametrize("E", matrices())
def test_solve_is_the_least_squares_solution(E):
    f, rng = factored(E), np.random.default_rng(1)
    for b in (E @ rng.normal(size=E.shape[1]), rng.normal(size=E.shape[0])):
        found = np.array(f.solve(list(b), "x", "test"), float)
        residual = E.T @ (E @ found - b)
        assert np.abs(residual).max() < 1e-13 * np.linalg.norm(E) * np.linalg.norm(b) * np.linalg.cond(E)
        assert found == pytest.approx(np.linalg.lstsq(E, b, rcond=None)[0], rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("E", matrices())
def test_solve_transposed_is_the_shortest_solution(E):
    f, g = factored(E), np.random.default_rng(2).normal(size=E.shape[1])
    w = np.array(f.solve_transposed(list(g), "w", "test"), float)
    assert E.T @ w == pytest.approx(g, rel=1e-9, abs=1e-9)
    assert w == pytest.approx(np.linalg.pinv(E.T) @ g, rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("E", matrices()[:12])
def test_the_two_solutions_are_transposes(E):
    """``w . b = g . x`` with ``E x = b`` and ``E^T w = g``."""
    f, rng = factored(E), np.random.default_rng(3)
    b, g = E @ rng.normal(size=E.shape[1]), rng.normal(size=E.shape[1])
    x, w = f.solve(list(b), "x", "test"), f.solve_transposed(list(g), "w", "test")
    assert np.dot(w, b) == pytest.approx(np.dot(g, x), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("exponent", [4, 8, 12])
def test_q_stays_orthogonal_however_badly_the_matrix_is_conditioned(exponent):
    """The second pass: columns that nearly coincide leave Q orthogonal to rounding."""
    rng = np.random.default_rng(exponent)
    E = rng.normal(size=(9, 3)) @ np.ones((3, 5)) + 10.0**-exponent * rng.normal(size=(9, 5))
    assert np.linalg.cond(E) > 10.0 ** (exponent - 1)
    Q, R = parts(f := factored(E))
    assert np.abs(Q.T @ Q - np.eye(5)).max() < 20 * EPSILON
    assert np.abs(Q @ R - E[:, f.order]).max() < 50 * EPSILON * np.abs(E).max()


@pytest.mark.parametrize("n", [2, 3, 4])
def test_the_last_of_n_directions_follows_from_the_others(n):
    """Two, three or four columns on as many rows: the last column of Q is a complement, its sign free."""
    E = np.zeros((7, n))
    E[2 : 2 + n] = random_matrix(n, n, 7)
    Q, R = parts(f := factored(E))
    assert np.abs(Q.T @ Q - np.eye(n)).max() < 20 * EPSILON
    assert np.abs(Q @ R - E[:, f.order]).max() < 20 * EPSILON * np.abs(E).max()
    assert not Q[:2].any() and not Q[2 + n :].any()


def test_a_column_with_one_entry_is_a_direction_and_comes_first():
    E = random_matrix(4, 3, 11)
    E[:, 2] = [0, 0, 2.5, 0]
    f = factored(E)
    assert f.order[0] == 2 and f.q[0] == [0, 0, 1, 0]
    assert all(q[2] == 0 for q in f.q[1:])


def margins(E: Array) -> list[float]:
    x = Numbers()
    factor(x, columns(E), "test")
    return [float(value) for _, value in x.stored(RANK)]


def test_lost_rank_shows_in_the_margin():
    """The margin is positive as long as a share of the column above sqrt(SMALLEST) is left."""
    E = random_matrix(6, 4, 13)
    assert len(margins(E)) == 4 and min(margins(E)) > 0
    E[:, 3] = E[:, 0] + E[:, 1]
    assert min(margins(E)) < SMALLEST * 100 * np.abs(E).max() ** 2
    off = np.linalg.svd(E)[0][:, -1]  # normal to all columns
    E[:, 3] += 1e3 * SMALLEST**0.5 * off
    assert min(margins(E)) > 0


def test_a_column_that_can_move_nothing_more_is_an_error():
    with pytest.raises(RankLossError):
        factored(np.array([[2.0, 3.0], [0, 0]]))


@pytest.mark.parametrize("E", matrices()[:30])
def test_what_is_stored_is_what_is_loaded(E):
    x = Numbers()
    f = factor(x, columns(E), "test")
    rows = list(range(1, 2 * E.shape[0], 2))
    form = f.store(rows, 2 * E.shape[0])
    again = load_factor(x, form)
    assert (again.order, again.q, again.inverse) == (f.order, f.q, f.inverse)
    assert {k: v for k, v in f.R.items() if v} == again.R


@pytest.mark.parametrize("E", matrices())
def test_the_pattern_covers_the_numbers(E):
    """Factored on zero patterns every entry is marked that can be there in numbers."""
    x = StructuralExpansion("pattern", lambda store, name: True)
    pattern = factor(x, [[ANY if v else 0 for v in column] for column in columns(E)], "test")
    f = factored(E)
    assert pattern.order == f.order
    for marked, numbers in zip(pattern.q, f.q, strict=True):
        assert all(m != 0 for m, v in zip(marked, numbers, strict=True) if v != 0)
    assert {k for k, v in f.R.items() if v != 0} <= {k for k, v in pattern.R.items() if v != 0}
