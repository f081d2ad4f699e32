"""The whole choice of dependents: its condition number against pivoting, its reach, and the messages about it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loop_closure import assemble
from loops.mechanisms import (
    GROUND,
    RandomMechanism,
    X,
    Z,
    body,
    four_bar,
    jacobian,
    ladder,
    loop,
    model,
    on_free_body,
    pinned,
)
from loops.test_partition import check, cross_branch

from codegen import load_model
from codegen.loops import AssemblyError, complete_speeds, describe, partition
from codegen.loops.components import components
from codegen.loops.dependents import conditions, pivoted_columns
from codegen.loops.geometry import Geometry, padded
from codegen.loops.nearby_states import NearbyStates, rigid_parts
from codegen.loops.ordering import Sweep, arrange, loop_order
from codegen.loops.partition import SEED


@pytest.fixture(scope="module")
def four_loops():
    return load_model(Path(__file__).parent / "four_loops.yaml")


@pytest.fixture(scope="module")
def chosen(four_loops):
    return partition(four_loops)


def surroundings(made, q, seed=0):
    g = Geometry(made)
    (loops,) = components(g)
    return NearbyStates(rigid_parts(g, padded(q), [loops]), loops, padded(q), np.random.default_rng(seed))


def test_pivoted_columns_are_those_of_lapack():
    from scipy.linalg import qr

    rng = np.random.default_rng(0)
    A = rng.normal(size=(5, 6, 14))
    for a, found in zip(A, pivoted_columns(A, 6), strict=True):
        assert list(qr(a, pivoting=True)[2][:6]) == list(found)
    low = rng.normal(size=(5, 6, 3)) @ rng.normal(size=(5, 3, 14))
    for a, found in zip(low, pivoted_columns(low, 3), strict=True):
        assert list(qr(a, pivoting=True)[2][:3]) == list(found)


def test_loops_that_share_joints_are_one_component():
    assert components(Geometry(ladder(6))) == [[0, 1, 2, 3, 4, 5]]
    g = Geometry(replace(on_free_body(four_bar())))
    assert components(g) == [[0]]
    found = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        kinds = rng.choice(RandomMechanism.LOOPS, int(rng.integers(2, 6)))
        g = Geometry(RandomMechanism(rng, int(rng.integers(6, 25)), kinds, (*RandomMechanism.TREE, "fixed")).model)
        joints = [{k for side in g.cycle(i) for k in side if g.speeds[k]} for i in range(len(g.starts))]
        sets: list[set[int]] = []
        for i, mine in enumerate(joints):
            near = [s for s in sets if any(joints[j] & mine for j in s)]
            sets = [s for s in sets if s not in near] + [{i}.union(*near)]
        assert components(g) == sorted(sorted(s) for s in sets)
        found += len(sets) > 1
    assert found > 20


def test_walks_stay_assembled_and_spread(four_loops, chosen):
    near = surroundings(four_loops, chosen.q)
    assert len(near.q) > 10
    for q, E in zip(near.q, near.E, strict=True):
        assert (
            np.abs(jacobian(four_loops, q[:-1]) @ np.eye(four_loops.nu)[:, near.speeds] * near.scale - E).max() < 1e-9
        )
    assert np.median(near.residual) < 1e-9
    assert np.median(np.max(np.abs(near.q - near.q[0]), axis=1)) > 0.5


def test_the_choice_of_four_loops_is_as_good_as_pivoting(four_loops, chosen):
    """One by one at the initial configuration it is a thousand times worse."""
    check(four_loops, chosen)
    near = surroundings(four_loops, chosen.q, 7)  # other states than those the choice was made with
    best = conditions(np.take_along_axis(near.E, pivoted_columns(near.E, 13)[:, None], axis=2))
    column = {int(s): c for c, s in enumerate(near.speeds)}

    def ratios(dependent):
        return conditions(near.E[..., [column[s] for s in dependent]]) / best

    found = ratios(chosen.dependent)
    assert found[0] < 10
    assert np.median(found) < 5
    assert chosen.compared[0].reach > 0.6
    assert max(ear.condition for ear in chosen.ears) < 10 * best[0]
    g = Geometry(four_loops)
    drafts = arrange(Sweep(g, padded(chosen.q), set(), np.random.default_rng(SEED)), loop_order(g, set()))
    before = ratios([s for d in drafts for s in d.dependent])
    assert before[0] > 1000
    assert np.median(before) > 20


def test_what_is_said_of_a_choice_is_what_it_is(four_loops, chosen):
    (compared,) = chosen.compared
    E = jacobian(four_loops, chosen.q)
    size = np.where(Geometry(four_loops).turning, 1.0, Geometry(four_loops).own_lengths.max())
    s = np.linalg.svd((E * size)[:, list(chosen.dependent)], compute_uv=False)
    size = np.sqrt(max(np.sum(s**2), len(s))) / len(s)
    assert compared.condition == pytest.approx(np.sqrt(np.sum(s**-2.0)) * size, rel=1e-6)
    (line,) = [x for x in describe(four_loops, chosen) if "together" in x]
    assert f"condition number {compared.condition:.2g} (choice by pivoting: {compared.pivoted:.2g}); at most" in line
    assert f"the loops close after {compared.reach:.0%} of random displacements" in line


def closing(made, found, spread=0.4, count=40):
    """How many random independent coordinates around the initial ones permit closed loops."""
    rng = np.random.default_rng(3)
    closed = 0
    for _ in range(count):
        q = np.array(found.q)
        q[list(found.independent)] += rng.uniform(-spread, spread, len(found.independent))
        try:
            assemble(made, found, q)
        except AssemblyError:
            continue
        closed += 1
    return closed


def test_of_choices_that_are_conditioned_alike_the_one_that_reaches_further_is_taken():
    made = cross_branch()
    found = partition(made)
    near_the_cut = partition(replace(made, independent=("b0", "b3", "b4")))
    assert found.compared[0].reach > 0.9
    assert near_the_cut.compared[0].reach < 0.7
    assert closing(made, found) >= 36
    assert closing(made, near_the_cut) < 28


def test_hints_that_make_a_poor_choice_are_told_with_better_ones():
    """Of a nearly planar chain only the hinge across the plane can close it well across."""
    axes = [Z, Z, (0.0, 0.002, 1.0), X, Z]
    bodies = [body(f"b{i}", i - 1, "revolute", a, at=(1, 0, 0) if i else (0, 0, 0)) for i, a in enumerate(axes)]
    q = {f"b{i}": 0.4 + 0.2 * i for i in range(5)} | {"b3": 0.0}
    made = model(bodies, [loop("tip", "spherical", (4, (1, 0, 0)), (GROUND, (2.0, 2.2, 0.0)))], q)
    free, poor = partition(made), partition(replace(made, independent=("b3",)))
    assert not [x for x in free.warnings if "pivoting" in x]
    (told,) = [x for x in poor.warnings if "pivoting" in x]
    hint = told.split("`independent: [")[1].split("]")[0].split(", ")
    better = partition(replace(made, independent=tuple(hint)))
    assert better.independent != poor.independent
    assert max(e.condition for e in better.ears) * 3 < max(e.condition for e in poor.ears)
    assert not [x for x in better.warnings if "pivoting" in x]


def test_what_is_not_compared_says_how_much_motions_grow():
    for made, growth in ((ladder(40), 1.0), (pinned(100), None)):
        found = partition(made)
        assert (found.compared, found.uncompared) == ((), len(made.loops))
        rng = np.random.default_rng(0)
        u = rng.normal(size=(made.nu, 30))
        for k in range(30):
            u[:, k] = complete_speeds(made, found, found.q, u[:, k])
        rms = np.sqrt(np.mean(u[list(found.dependent)] ** 2, axis=1)).max()
        assert 0.3 < found.growth / rms < 3  # of twelve random motions
        assert growth is None or found.growth == pytest.approx(growth, rel=0.5)


def test_clusters_that_no_hint_asked_for_are_not_blamed_on_hints():
    bodies = [body("plate", GROUND, "free")]
    loops = []
    for i in range(6):
        a = np.pi / 3 * i
        at = np.array((np.cos(a), np.sin(a), 0.0))
        bodies.append(body(f"rod{i}", GROUND, "spherical", at=tuple(at)))
        loops.append(loop(f"ball{i}", "spherical", (i + 1, (0, 0, 1)), (0, tuple(0.5 * at))))
    made = model(bodies, loops, {"plate.pz": 0.9, "plate.qw": 1.0})
    told = [x for x in partition(made).warnings if "only together" in x]
    assert not [x for x in told if "or none" in x]
