"""The choice of columns: near the cut, of full rank, well conditioned, quaternion joints as a whole where possible."""

import numpy as np
import pytest

from codegen.loops.dependents import choose_dependents, condition, divide, divided_joints, ranks


def alone(n):
    return [(i,) for i in range(n)]


def test_the_first_columns_are_taken_where_they_are_good():
    A = np.random.default_rng(0).normal(size=(1, 3, 200))
    assert max(choose_dependents(A, alone(200), 3)) < 10
    assert choose_dependents(np.eye(3)[None], alone(3), 3) == [0, 1, 2]


def test_the_order_of_preference_is_the_callers():
    A = np.random.default_rng(0).normal(size=(1, 3, 200))
    assert min(choose_dependents(A, alone(200)[::-1], 3)) > 189


def test_columns_that_add_hardly_any_rank_are_passed_over():
    A = np.array([[[1.0, 1.0, 1.0, 0.0], [0.0, 1e-3, 1e-9, 1.0]]])
    assert sorted(choose_dependents(A, alone(4), 2)) == [0, 3]


def test_a_much_better_condition_is_worth_a_longer_way():
    rng = np.random.default_rng(1)
    near = rng.normal(size=(4, 1)) + 1e-4 * rng.normal(size=(4, 12))  # nearly parallel columns
    A = np.concatenate([near, rng.normal(size=(4, 12))], axis=1)[None]
    assert condition(A[..., :12]) > 1e3
    chosen = choose_dependents(A, alone(24), 4)
    assert condition(A[..., chosen]) < 100


def test_every_random_matrix_gets_as_many_independent_columns_as_its_rank():
    for seed in range(200):
        rng = np.random.default_rng(seed)
        rows, columns = int(rng.integers(1, 8)), int(rng.integers(1, 30))
        rank = int(rng.integers(0, min(rows, columns) + 1))
        A = rng.normal(size=(2, rows, rank)) @ rng.normal(size=(2, rank, columns))
        chosen = choose_dependents(A, alone(columns), rank)
        assert len(set(chosen)) == rank
        assert np.all(ranks(A[..., chosen]) == rank)


def test_a_column_must_be_good_at_every_configuration():
    A = np.array([[[1.0, 0, 1], [0, 1, 1]], [[1.0, 1, 0], [0, 0, 1]]])  # columns 0 and 1 are parallel at the second
    assert sorted(choose_dependents(A, alone(3), 2)) == [0, 2]


@pytest.mark.parametrize(
    ("joints", "rank", "expected"),
    [
        ([(0, 1, 2), (3,), (4,), (5,)], 3, {3, 4, 5}),  # single freedoms first, even further from the cut
        ([(0, 1, 2), (3,), (4,)], 3, {0, 1, 2}),
        ([(0, 1, 2), (3,), (4,)], 5, {0, 1, 2, 3, 4}),
        ([(0, 1, 2), (3, 4, 5)], 3, {0, 1, 2}),  # the nearer of two
        ([(0, 1, 2), (3, 4, 5)], 6, {0, 1, 2, 3, 4, 5}),
        ([(0, 1, 2), (3, 4, 5)], 5, None),
        ([(0, 1, 2), (3,)], 2, None),
    ],
)
def test_quaternion_joints_are_taken_whole_or_not_at_all(joints, rank, expected):
    rng = np.random.default_rng(4)
    columns = sum(len(x) for x in joints)
    A = rng.normal(size=(1, 6, rank)) @ rng.normal(size=(1, rank, columns))
    chosen = choose_dependents(A, joints, rank)
    assert (None if chosen is None else set(chosen)) == expected


def test_a_joint_whose_own_columns_depend_on_each_other_is_not_taken():
    lever = np.array([[0.0, -3, 2], [3, 0, -1], [-2, 1, 0]])  # a ball holds a point on a rod: turning the rod is free
    A = np.concatenate([lever, np.eye(3)], axis=1)[None]
    assert set(choose_dependents(A, [(0, 1, 2), (3,), (4,), (5,)], 3)) == {3, 4, 5}
    assert choose_dependents(A[..., :4], [(0, 1, 2), (3,)], 3) is None


def test_joints_are_divided_as_little_as_serves():
    assert list(divided_joints([(0,), (1, 2, 3)])) == [[(0,), (1,), (2,), (3,)]]
    free_and_ball = list(divided_joints([(0, 1, 2, 3, 4, 5), (6, 7, 8)]))
    assert free_and_ball[0] == [(0, 1, 2), (3, 4, 5), (6, 7, 8)]
    assert free_and_ball[1] == [(0,), (1,), (2,), (3, 4, 5), (6, 7, 8)]
    assert [len(x) for x in free_and_ball] == [3, 5, 5, 5, 9]


@pytest.mark.parametrize(("rank", "whole"), [(3, 3), (4, 3), (5, 3), (6, 6), (2, 0), (1, 0)])
def test_all_but_one_joint_stay_whole_where_that_is_well_conditioned(rank, whole):
    rng = np.random.default_rng(3)
    A = np.linalg.qr(rng.normal(size=(rank, rank)))[0] @ np.eye(rank, 9)  # each column is of full use, or of none
    A = A + 0.1 * rng.normal(size=A.shape)
    chosen = divide(A[None], [(0, 1, 2), (3, 4, 5), (6, 7, 8)], rank)
    assert len(set(chosen)) == rank
    assert condition(A[None][..., chosen]) < 50
    assert sum(3 for k in (0, 3, 6) if {k, k + 1, k + 2} <= set(chosen)) >= whole


def test_ranks_are_counted_and_conditions_measured():
    A = np.array([np.diag([1.0, 1e-3, 0]), np.diag([1.0, 1e-12, 1e-12]), np.zeros((3, 3))])
    assert ranks(A).tolist() == [2, 1, 0]
    assert condition(A[:1, :2, :2]) == pytest.approx(1e3 * np.sqrt(2 * (1 + 1e-6)) / 2)
    assert condition(A[:1]) == np.inf
    assert condition(np.zeros((1, 3, 0))) == 1
