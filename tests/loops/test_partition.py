"""Partitions: the dependent speeds, the ears, and their ranks."""

import time
from dataclasses import replace

import numpy as np
import pytest
from loop_closure import closure, independent_coordinates
from loops.mechanisms import (
    GROUND,
    ORIGIN,
    RandomMechanism,
    X,
    Y,
    Z,
    body,
    bricard,
    chain_ladder,
    four_bar,
    jacobian,
    ladder,
    loop,
    model,
    nested,
    on_free_body,
    pinned,
    rank_of,
    rssr,
    slider_crank,
    stewart,
    three_rods,
    three_rrr,
    turned,
)
from random_models import expression

from codegen.loops import AssemblyError, PartitionError, complete_speeds, describe, partition
from codegen.loops.geometry import Geometry


def names(made, speeds):
    return {made.speed_names[s] for s in speeds}


def shuffled(made, seed=0):
    order = np.random.default_rng(seed).permutation(len(made.loops))
    return replace(made, loops=tuple(made.loops[i] for i in order))


def cross_branch():
    """Two arms of three hinges each with different axes; a ball joint connects their tips."""
    axes = [X, Y, Z, Y, X, (1, 1, 0)]
    bodies = [
        body(f"b{i}", GROUND if i in (0, 3) else i - 1, "revolute", a, at=(0.6, 0.1 * i, 0.2))
        for i, a in enumerate(axes)
    ]
    loops = [loop("tips", "spherical", (2, (0.5, 0, 0)), (5, (0.4, -0.3, 0.1)))]
    return model(bodies, loops, {"b0": 0.1, "b4": -0.2})


def parallel_bars(offset=0.0):
    """A parallelogram with a third bar, which is redundant if its foot is in line with the others."""
    bodies = [*four_bar(1, 2, 1, 2).bodies, body("third", GROUND, "revolute", Y, at=(1, 0, offset))]
    loops = [*four_bar(1, 2, 1, 2).loops, loop("extra", "revolute", (3, (1, 0, 0)), (1, (1, 0, 0)), Y)]
    return model(bodies, loops, {"crank": 0.9, "coupler": -0.8, "rocker": 1.7 + np.pi / 2, "third": 1.0})


MECHANISMS = {
    "four_bar": (four_bar(), [2], 1),
    "slider_crank": (slider_crank(), [2], 1),
    "turned_four_bar": (turned(four_bar(), ((1, 2, 3), 0.7)), [2], 1),
    "four_bar_on_a_free_body": (on_free_body(four_bar()), [2], 7),
    "ladder": (ladder(30), [2] * 30, 1),
    "ladder_of_a_rough_guess": (ladder(30, wrong=0.05), [2] * 30, 1),
    "reversed_ladder": (ladder(30, order=-1), [2] * 30, 1),
    "shuffled_ladder": (shuffled(ladder(30)), [2] * 30, 1),
    "chain_ladder": (chain_ladder(8), [2] * 8, 1),
    "shuffled_chain_ladder": (shuffled(chain_ladder(8)), [2] * 8, 1),
    "hooke_ladder": (chain_ladder(8, "universal"), [4] * 8, 2),
    "pinned": (pinned(12), [3], 9),
    "bricard": (bricard(), [4], 1),
    "nested": (nested(), [2, 2], 1),
    "cross_branch": (cross_branch(), [3], 3),
    "parallel_bars": (parallel_bars(), [2, 1], 1),
    "three_rrr": (three_rrr(), [2, 2], 3),
    "hinted_three_rrr": (three_rrr(("base1", "base2", "base3")), [4], 3),
    "stewart": (stewart(), [3] * 6, 6),
}


@pytest.mark.parametrize("name", MECHANISMS)
def test_ears_ranks_and_freedoms_of_known_mechanisms(name):
    made, ranks, freedoms = MECHANISMS[name]
    found = partition(made)
    assert sorted((ear.rank for ear in found.ears), reverse=True) == ranks
    assert len(found.independent) == freedoms
    reached = name != "pinned"  # the others' initial values lead to closure
    assert (found.warnings == ()) == reached
    assert max(ear.condition for ear in found.ears) < 50


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_partition_is_whole(name):
    made, _, _ = MECHANISMS[name]
    check(made, partition(made))


def check(made, found, tolerance=1e-10):
    """Check all properties of partitions by the dense closure matrix of all loops together."""
    dependent = [s for ear in found.ears for s in ear.dependent]
    assert sorted([*dependent, *found.independent]) == list(range(made.nu))
    assert sorted(i for ear in found.ears for i in ear.loops) == list(range(len(made.loops)))
    assert all(len(ear.dependent) == ear.rank for ear in found.ears)
    assert sum(ear.rows for ear in found.ears) == len(made.closure_names)
    J = jacobian(made, found.q)
    assert rank_of(J) == len(dependent) == np.linalg.matrix_rank(J[:, dependent])
    position, _ = closure(made, found.q, np.zeros(made.nu))
    assert np.abs(position).max() < 1e-12
    u = complete_speeds(made, found, found.q, np.random.default_rng(0).normal(size=made.nu))
    assert np.abs(J @ u).max() < tolerance * max(1, np.abs(u).max())
    # an ear passes dependents of its own and of earlier ears only, and each of its own lies on one of its cycles
    geometry, resolved = Geometry(made), set()
    for ear in found.ears:
        cycles = {s for i in ear.loops for side in geometry.cycle(i) for k in side for s in geometry.speeds[k]}
        assert set(ear.dependent) <= cycles
        resolved |= set(ear.dependent)
        assert not cycles & (set(dependent) - resolved)


@pytest.mark.parametrize("hints", [(), (0,), (0, 1), (0, 1, 2)], ids=len)
def test_random_mechanisms_have_the_freedoms_of_their_jacobian_and_hints_are_honoured_or_refused(hints):
    outcomes = {"honoured": 0, "refused": 0}
    for seed in range(40):
        rng = np.random.default_rng(1000 * len(hints) + seed)
        types = rng.choice(("spherical", "universal", "cylindrical", "planar", "revolute"), int(rng.integers(1, 5)))
        mechanism = RandomMechanism(
            rng, int(rng.integers(6, 14)), [str(t) for t in types], ("revolute", "revolute", "prismatic", "universal")
        )
        made, J = mechanism.model, jacobian(mechanism.model, mechanism.q)
        freedoms = np.linalg.svd(J)[2][rank_of(J) :].T  # motions that keep all loops closed, (nu, freedoms)
        hinted = rng.choice(made.nu, len(hints), replace=False)
        s = np.linalg.svd(freedoms[hinted], compute_uv=False)
        possible = len(hints) <= freedoms.shape[1] and (not len(hints) or s.min() > 1e-9)
        if possible and len(hints) and s.min() < 1e-4:
            continue  # neither here nor there
        guess = mechanism.q + (seed % 2) * 0.01 * rng.normal(size=made.nq)
        initial = {name: expression(float(x)) for name, x in zip(made.coordinate_names, guess, strict=True)}
        made = replace(made, independent=tuple(made.coordinate_names[i] for i in hinted), initial_q=initial)
        if not freedoms.shape[1]:
            with pytest.raises(PartitionError, match=r"no freedom left|independent"):
                partition(made)
        elif possible:
            found = partition(made)
            check(made, found, 1e-8)
            assert set(hinted) <= set(found.independent)
            assert len(found.independent) == freedoms.shape[1]
            outcomes["honoured"] += 1
        else:
            with pytest.raises((PartitionError, AssemblyError)):
                partition(made)
            outcomes["refused"] += 1
    assert outcomes["honoured"] > 5
    assert not hints or outcomes["refused"] > 5


@pytest.mark.parametrize("seeds", [range(10), pytest.param(range(10, 30), marks=pytest.mark.campaign)], ids=str)
@pytest.mark.parametrize("type", RandomMechanism.LOOPS)
def test_every_loop_joint_with_every_tree_joint(type, seeds):
    closed = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        mechanism = RandomMechanism(rng, int(rng.integers(5, 10)), [type])
        made = mechanism.model
        try:
            found = partition(made)
        except PartitionError as error:
            assert "no freedom" in str(error)
            continue
        check(made, found)
        closed += 1
    assert closed >= len(seeds) * 2 / 3


def test_dependents_are_listed_outward_on_the_start_side_then_outward_on_the_end_side():
    found = partition(replace(bricard(), independent=("rod1",)))
    assert [bricard().speed_names[s] for s in found.ears[0].dependent] == ["rod2", "rod3", "rod4", "rod5"]
    made = ladder(3)
    assert [made.speed_names[s] for s in partition(made).ears[0].dependent] == ["rail0", "rung1"]


@pytest.mark.parametrize("n", [8, pytest.param(20, marks=pytest.mark.campaign)])
def test_ladders_need_no_cluster_however_they_are_given_and_wherever_they_are_driven(n):
    for made in (ladder(n), ladder(n, order=-1), shuffled(ladder(n), 1), shuffled(ladder(n), 2)):
        for hint in ((), ("rung0",), (f"rung{n}",), (f"rung{n // 2 + 1}",), (f"rail{n // 3 + 1}",)):
            found = partition(replace(made, independent=hint))
            assert all(len(ear.loops) == 1 for ear in found.ears)
            assert not hint or names(made, found.independent) == set(hint)


def test_an_ear_of_a_long_chain_is_short():
    made = pinned(1000)
    found = partition(made)
    assert min(found.ears[0].dependent) > 985
    assert found.ears[0].condition < 100


def test_redundant_conditions_are_counted():
    (ear,) = partition(turned(four_bar(), ((1, 2, 3), 0.7))).ears
    assert (ear.rows, ear.rank, ear.redundant) == (5, 2, 3)
    (ear,) = partition(bricard()).ears
    assert (ear.rows, ear.rank, ear.redundant) == (5, 4, 1)
    assert [ear.redundant for ear in partition(parallel_bars()).ears] == [3, 4]


def test_hinted_base_joints_of_the_parallel_robot_make_a_cluster_and_other_hints_do_not():
    made = three_rrr(("base1", "base2", "base3"))
    (ear,) = partition(made).ears
    assert ear.loops == (0, 1)
    assert (ear.rows, ear.rank) == (10, 4)
    assert names(made, ear.dependent) == {"elbow1", "elbow2", "elbow3", "platform"}
    assert len(partition(three_rrr(("base1", "elbow1", "platform"))).ears) == 2


def test_the_platform_of_a_stewart_mechanism_is_independent_as_a_whole():
    made = stewart()
    assert names(made, partition(made).independent) == {x for x in made.speed_names if x.startswith("platform")}
    hinted = replace(made, independent=("platform.qw",))
    assert partition(hinted).independent == partition(made).independent


def test_a_loop_of_a_free_body_leaves_the_body_free():
    made = on_free_body(four_bar())
    found = partition(made)
    assert {f"float.{x}" for x in ("wx", "wy", "wz", "vx", "vy", "vz")} < names(made, found.independent)
    check(made, found)


def test_loops_before_the_first_have_no_freedom_of_their_own_and_that_is_fine():
    made = ladder(3)
    geometry = Geometry(made)
    *_, last = partition(made).ears
    own = {s for i in last.loops for side in geometry.cycle(i) for k in side for s in geometry.speeds[k]}
    assert len(own - set(last.dependent)) == 1  # the rung that the loop before has moved already


def test_a_flattened_pose_does_not_mislead_but_is_told():
    found = partition(four_bar(1, 2, 1, 2, (0, 0, np.pi)))
    (ear,) = found.ears
    assert ear.rank == 2
    assert ear.condition > 1e6
    assert any("foot" in x and "singular" in x for x in found.warnings)


def test_a_bar_that_fits_is_redundant_and_one_that_does_not_locks_the_mechanism():
    assert [ear.rank for ear in partition(parallel_bars()).ears] == [2, 1]
    with pytest.raises(PartitionError, match=r"no freedom left.*foot.*extra.*rank 4"):
        partition(parallel_bars(0.3))


def test_no_freedom_left_is_an_error():
    made = four_bar()
    short = model(
        made.bodies[:2],
        [loop("foot", "revolute", (1, (2, 0, 0)), (GROUND, (2.2, 0, 0)), Y)],
        {"crank": 1.0, "coupler": -0.8},
    )
    with pytest.raises(PartitionError, match=r"no freedom left.*foot.*2 speeds.*rank 2"):
        partition(short)


def test_two_hints_for_one_freedom_are_refused_with_coordinates_loop_and_rank():
    with pytest.raises(PartitionError, match=r"loop foot.*rank 2.*coupler can meet 1.*independent") as error:
        partition(four_bar(independent=("crank", "rocker")))
    assert "crank" in str(error.value)
    assert "rocker" in str(error.value)
    assert error.value.loops == ("foot",)
    assert sorted(error.value.names) == ["crank", "rocker"]


def test_a_hint_that_never_moves_is_refused():
    made = replace(chain_ladder(4), independent=("rail2",))  # rails of a parallelogram stay parallel
    with pytest.raises(PartitionError, match="rail2 cannot"):
        partition(made)


def test_an_unknown_hint_names_the_nearest_coordinate():
    with pytest.raises(PartitionError, match=r"'crnk' is not a coordinate.*'crank'"):
        partition(four_bar(independent=("crnk",)))


def test_a_loop_between_rigidly_joined_bodies_is_refused():
    bodies = [body("a", GROUND, "revolute", Y), body("b", 0, "fixed"), body("c", 1, "fixed")]
    for start, end in ((0, 2), (1, 1)):
        made = model(bodies, [loop("idle", "spherical", (start, ORIGIN), (end, ORIGIN))])
        with pytest.raises(PartitionError, match=r"loop idle joins .* cannot move relative to each other \(rank 0\)"):
            partition(made)


def test_ball_joints_of_a_spatial_four_bar_are_split_and_that_is_told():
    made = rssr()
    found = partition(made)
    check(made, found)
    assert (found.ears[0].rank, len(found.independent), len(found.split(made))) == (5, 2, 1)
    (split,) = found.split(made)
    kept = set(range(made.nq)[split.coordinates])
    assert kept <= set(independent_coordinates(made, found))
    name = made.bodies[split.body].name
    (line,) = [x for x in describe(made, found) if "split" in x]
    assert line.startswith(f"  {name} is split: {name}.w")
    assert line.endswith("its quaternion counts as independent")


def test_joints_are_not_split_where_a_hint_asks_for_the_whole_joint():
    made = rssr()
    for name in ("coupler", "rocker"):
        hinted = replace(made, independent=(f"{name}.qx",))  # the file's `independent` takes no single component
        with pytest.raises(PartitionError, match=f"{name}.wx.*cannot all be independent"):
            partition(hinted)


def test_the_crank_of_a_spatial_four_bar_may_be_driven():
    made = replace(rssr(), independent=("crank",))
    found = partition(made)
    check(made, found)
    assert found.independent[0] == 0
    assert found.split(made)


@pytest.mark.parametrize("on_platform", [False, True])
def test_a_free_body_held_by_three_ball_rods(on_platform):
    made = three_rods(on_platform)
    found = partition(made)
    check(made, found)
    assert (sum(ear.rank for ear in found.ears), len(found.independent)) == (9, 6)
    assert max(ear.condition for ear in found.ears) < 50
    dependent = {made.speed_names[s] for s in found.dependent}
    for k in range(3):  # a rod can always spin: not all of its speeds can depend on the loops
        assert len(dependent & {f"rod{k}.w{x}" for x in "xyz"}) < 3


def test_the_position_of_a_free_body_is_dependent_apart_from_its_rotation():
    """Nothing is divided further if that serves: a ball joint takes the three displacements."""
    made = model(
        [body("float", GROUND, "free")], [loop("ball", "spherical", (0, (0.2, 0.1, 0.3)), (GROUND, ORIGIN))],
    )  # fmt: skip
    found = partition(made)
    check(made, found)
    assert names(made, found.dependent) == {"float.vx", "float.vy", "float.vz"}
    assert not found.split(made)
    assert [made.coordinate_names[i] for i in independent_coordinates(made, found)] == [
        "float.qw", "float.qx", "float.qy", "float.qz",
    ]  # fmt: skip


def test_the_same_model_has_the_same_partition():
    for made in (ladder(5, wrong=0.03), three_rrr(("base1", "base2", "base3")), bricard()):
        assert partition(made) == partition(made)


def test_a_tree_has_no_ears():
    found = partition(model([body("a", GROUND, "revolute", Y)], [], {"a": 0.5}))
    assert (found.ears, found.independent, found.q) == ((), (0,), (0.5,))


def test_characteristic_lengths_are_powers_of_two_near_the_links():
    for scale in (1e-3, 1.0, 250.0):
        made = four_bar(scale, 2 * scale, 1.5 * scale, 2.2 * scale)
        found = partition(made)
        (length,) = found.lengths
        assert np.log2(length) == round(np.log2(length))
        assert 0.7 * scale < length < 2.5 * scale
        assert found.ears[0].condition == pytest.approx(partition(four_bar()).ears[0].condition, rel=1)
        assert np.abs(closure(made, found.q, np.zeros(3))[0]).max() < 1e-14


@pytest.mark.parametrize("shortest", [100, pytest.param(200, marks=pytest.mark.campaign)])
def test_a_long_ladder_takes_time_in_proportion(shortest):
    seconds = []
    for n in (shortest, 8 * shortest):
        made = ladder(n)
        start = time.process_time()
        partition(made)
        seconds.append(time.process_time() - start)
    assert seconds[1] < 20 * seconds[0]


def test_a_hint_that_ties_many_loops_together_is_honoured_with_a_warning():
    made = replace(
        chain_ladder(8), independent=("rung8",)
    )  # every loop's cycle leads to the first rung, hardly any to the last
    found = partition(made)
    check(made, found)
    assert names(made, found.independent) == {"rung8"}
    assert any("only together" in x and "independent" in x for x in found.warnings)


def test_description_names_what_depends_on_what():
    lines = describe(four_bar(), partition(four_bar()))
    assert lines[0] == "1 loop: 2 of 3 speeds are dependent, 1 degree of freedom: crank"
    assert lines[1].startswith(
        "  foot: coupler, rocker dependent; rank 2 of 5 conditions, 3 redundant; condition number 1."
    )
    assert lines[2].startswith(
        "  all dependent speeds together: condition number 1.3 (choice by pivoting: 1.2); at most"
    )
    assert lines[3].startswith("3 of 5 conditions are redundant")


def test_description_of_clusters_long_ladders_and_doubts():
    made = three_rrr(("base1", "base2", "base3"))
    first, second, _, _ = describe(made, partition(made))
    assert first.startswith(
        "2 loops (1 cluster): 4 of 7 speeds are dependent, 3 degrees of freedom: base1, base2, base3"
    )
    assert second.startswith("  cluster of wrist2, wrist3: ")
    made = ladder(40)
    lines = describe(made, partition(made))
    assert len(lines) == 4
    assert "loop0 and 39 alike, the last loop39" in lines[1]
    assert lines[2].startswith("  40 loops not compared with pivoting")
    assert "1 times the independent" in lines[2]  # rails and rungs turn with the first rung
    flat = four_bar(1, 2, 1, 2, (0, 0, np.pi))
    assert any(line.startswith("warning: loop foot") for line in describe(flat, partition(flat)))
    tree = model([body("a", GROUND, "revolute", Y)], [])
    assert describe(tree, partition(tree)) == []
