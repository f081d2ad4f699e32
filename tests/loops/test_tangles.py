"""Which ears start from each other's bodies, and which bodies an ear's dependents move."""

import pytest

from codegen.loops import partition
from codegen.loops.tangles import ear_members, tangle
from codegen.model import parse_model

ROD = "  {0}: {{parent: {1}, joint: {{type: revolute, axis: y, at: [0, 0, {2}]}}, mass: 1, com: [0, 0, 0.25]}}\n"
PIN = (
    "  {0}: {{joint: {{type: revolute, axis: y}}, from: {{body: {1}, at: [0, 0, 0.5]}}, to: {{body: {2}, at: {3}}}}}\n"
)


def ring(independent: str) -> str:
    """A chain of seven rods between two pins on the ground, three of them closed by a rod of their own."""
    rods = [ROD.format("c1", "ground", 0), *(ROD.format(f"c{i}", f"c{i - 1}", 0.5) for i in range(2, 8))]
    loops = [PIN.format("sub", "d", "c5", "[0.2, 0, 0]"), PIN.format("tip", "c7", "ground", "[0.3, 0, 0.1]")]
    q = ", ".join(f"c{i}: {0.55 + 0.02 * i}" for i in range(1, 8))
    return (
        f"model: ring\ngravity: [0, 0, -9.81]\nbodies:\n{''.join(rods)}{ROD.format('d', 'c3', 0.2)}"
        f"loops:\n{''.join(loops)}independent: [{independent}]\ninitial: {{q: {{d: 0.6, {q}}}}}\n"
    )


def test_a_long_loop_is_closed_outboard_of_the_short_one_that_it_passes() -> None:
    model = parse_model(ring(""))
    ears = partition(model).ears
    assert [ear.loops for ear in ears] == [(0,), (1,)]
    assert {model.speed_names[s] for s in ears[1].dependent} <= {"c6", "c7"}


def test_where_only_the_carriers_are_left_the_loops_are_one_cluster() -> None:
    """With c1 and c6, c7 independent only c2 and c3 could close the long loop, and they carry the short one."""
    model = parse_model(ring("c1, c6, c7"))
    (ear,) = partition(model).ears
    assert ear.loops == (0, 1)
    assert ear.rank == 4


@pytest.mark.parametrize(
    ("before", "expected"),
    [
        ([set(), {0}, {1}], set()),
        ([{1}, {0}, set()], {0, 1}),
        ([{2}, {0}, {1}, {0}], {0, 1, 2}),
        ([set(), {2}, {1}, {0, 4}, {3}], {1, 2}),
        ([set(), {0, 2}, {0}], set()),
    ],
)
def test_tangle(before: list[set[int]], expected: set[int]) -> None:
    """Nothing waits for itself through others but the tangle; what only waits for one is not part of it."""
    assert tangle(before) == expected


def test_bodies_between_two_that_an_ear_moves_belong_to_it() -> None:
    """A chain 0-1-2-3 of nodes: 0 and 3 are on the first ear's cycle, 1 and 2 came with the second; 0 has the dependent."""
    parent = {0: -1, 1: 0, 2: 1, 3: 2}
    members = ear_members(parent, {0: 0, 1: 1, 2: 1, 3: 0}, [0, 1, 2, 3], [[3], [2]], {0}.__contains__)
    assert members.moved == [{0, 1, 2, 3}, set()]
    assert members.before == [set(), {0}]


def test_bodies_inboard_of_the_dependents_are_free() -> None:
    parent = {0: -1, 1: 0, 2: 1, 3: 1}
    members = ear_members(parent, {0: 0, 1: 0, 2: 0, 3: 1}, [0, 1, 2, 3], [[2], [3]], {2, 3}.__contains__)
    assert members.moved == [{2}, {3}]
    assert members.before == [set(), set()]
