"""Ears that start from each other's bodies, and the bodies that the dependents of an ear move."""

import pytest

from codegen.loops import partition
from codegen.loops.tangles import ear_members, joined, tangles
from codegen.model import Model, parse_model

ROD = "  {0}: {{parent: {1}, joint: {{type: revolute, axis: y, at: [0, 0, {2}]}}, mass: 1, com: [0, 0, 0.25]}}\n"
PIN = (
    "  {0}: {{joint: {{type: revolute, axis: y}}, from: {{body: {1}, at: [0, 0, 0.5]}}, to: {{body: {2}, at: {3}}}}}\n"
)


def rings(independent: str, count: int = 1) -> Model:
    """Chains of seven rods with both ends held, three of them closed by a rod of their own; each stands on the last one's c4."""
    bodies, loops, q = "", "", []
    base = "ground"
    for n in range(count):
        x = "x" * n
        bodies += ROD.format(f"{x}c1", base, 0)
        bodies += "".join(ROD.format(f"{x}c{i}", f"{x}c{i - 1}", 0.5) for i in range(2, 8))
        bodies += ROD.format(f"{x}d", f"{x}c3", 0.2)
        loops += PIN.format(f"{x}sub", f"{x}d", f"{x}c5", "[0.2, 0, 0]")
        loops += PIN.format(f"{x}tip", f"{x}c7", base, "[0.3, 0, 0.1]")
        q += [f"{x}d: 0.6", *(f"{x}c{i}: {0.55 + 0.02 * i}" for i in range(1, 8))]
        base = f"{x}c4"
    return parse_model(
        f"model: rings\ngravity: [0, 0, -9.81]\nbodies:\n{bodies}loops:\n{loops}"
        f"independent: [{independent}]\ninitial: {{q: {{{', '.join(q)}}}}}\n"
    )


def test_a_long_loop_is_closed_outboard_of_the_short_one_that_it_passes() -> None:
    model = rings("")
    ears = partition(model).ears
    assert [ear.loops for ear in ears] == [(0,), (1,)]
    assert {model.speed_names[s] for s in ears[1].dependent} <= {"c6", "c7"}


def test_where_only_the_carriers_are_left_the_loops_are_one_cluster() -> None:
    """With c1 and c6, c7 independent only c2 and c3 could close the long loop, and they carry the short one."""
    model = rings("c1, c6, c7")
    (ear,) = partition(model).ears
    assert ear.loops == (0, 1)
    assert ear.rank == 4


@pytest.mark.parametrize(
    ("before", "expected"),
    [
        ([set(), {0}, {1}], []),
        ([{1}, {0}, set()], [[0, 1]]),
        ([{2}, {0}, {1}, {0}], [[0, 1, 2]]),
        ([set(), {2}, {1}, {0, 4}, {3}], [[1, 2], [3, 4]]),
        ([{1}, {0}, {1, 3}, {2}], [[0, 1], [2, 3]]),
        ([{1}, {2}, {0, 3}, {4}, {3}], [[0, 1, 2], [3, 4]]),
        ([{0}, {0}], []),
    ],
)
def test_tangles(before: list[set[int]], expected: list[list[int]]) -> None:
    """Those that wait for each other; one tangle that waits for another stays one of its own."""
    assert tangles(before) == expected


def test_many_things_in_one_tangle() -> None:
    n = 3000
    assert tangles([{(i + 1) % n} for i in range(n)]) == [list(range(n))]
    assert tangles([{i - 1} if i else set() for i in range(n)]) == []


def test_a_tangle_stands_where_its_last_one_stood() -> None:
    assert joined("abcdef", [[0, 2], [3, 4]], "".join) == ["b", "ac", "de", "f"]


def test_tangles_in_series_stay_apart() -> None:
    model = rings("c1, c6, c7, xc1, xc6, xc7", 2)
    assert [ear.loops for ear in partition(model).ears] == [(0, 1), (2, 3)]


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
