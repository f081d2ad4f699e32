"""Loops are solved in one region or in several, whichever takes fewer operations; the results are the same."""

from __future__ import annotations

from pathlib import Path

import pytest
from coupled_mechanisms import assembled, by_hand
from emit.test_random_mechanisms import check, draw

import codegen
from codegen.loops.partition import partition
from codegen.mechanics.structure import region_work, regions
from codegen.mechanics.structure.region_work import Bundle, Freedoms, is_one_region, sources_of_links
from codegen.mechanics.structure.system import analyse
from codegen.model import Model, load_model, parse_model
from codegen.pipeline import write_solver

EXAMPLES = Path(__file__).parents[2] / "examples"

DELTA = """
model: delta
gravity: [0, 0, -9.81]
parameters: {l: 0.35, r: 0.8, m: 0.24}
bodies:
  plate: {parent: ground, joint: {type: free, at: [0, 0, -0.75]}, mass: 0.61, inertia: {xx: 0.006, yy: 0.006, zz: 0.011}}
  repeat k in 0..2:
    arm(k):
      parent: ground
      joint: {type: revolute, axis: y, at: [0.21*cos(2*pi*k/3), 0.21*sin(2*pi*k/3), 0], rpy: [0, 0, 2*pi*k/3]}
      mass: 1.2
      com: [l/2, 0, 0]
      inertia: {xx: 0.002, yy: 0.0122, zz: 0.0122}
    repeat s in 0..1:
      rod(k)(s):
        parent: arm(k)
        joint: {type: spherical, at: [l, 0.05 - 0.1*s, 0]}
        mass: m
        com: [0, 0, -r/2]
        inertia: {xx: 0.0129, yy: 0.0129, zz: 0.0002}
loops:
  repeat k in 0..2:
    repeat s in 0..1:
      ball(k)(s):
        joint: {type: spherical}
        from: {body: rod(k)(s), at: [0, 0, -r]}
        to: {body: plate, at: [0.05*cos(2*pi*k/3) - (0.05 - 0.1*s)*sin(2*pi*k/3),
                               0.05*sin(2*pi*k/3) + (0.05 - 0.1*s)*cos(2*pi*k/3), 0]}
"""
"""A Delta robot: three arms, two rods each, which turn about themselves: nine independent speeds, six loops closed together."""


def regions_of(model: Model) -> list[int]:
    """The number of ears of each region."""
    chosen = partition(model)
    return [len(region.ears) for region in analyse(model, False, chosen).regions.regions]


def operations(model: Model) -> int:
    """Operations of udot per call."""
    manifest = write_solver(model, functions=("accelerations",)).manifest
    counts = [manifest["operations"][s]["per_call"] for s in manifest["functions"]["accelerations"]["sweeps"]]
    return sum(of[what] for of in counts for what in ("additions", "multiplications"))


def operations_as(one: bool, model: Model, monkeypatch: pytest.MonkeyPatch) -> int:
    """Operations with the loops as one region, or as separate regions."""
    with monkeypatch.context() as patched:
        patched.setattr(regions, "is_one_region", lambda *_: one)
        return operations(model)


def test_a_delta_robot_is_one_region_with_nine_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Apart, the motion of two arms and of the ground against the third are sources: 24 in all."""
    mechanism = assembled(parse_model(DELTA))
    (region,) = analyse(mechanism.model, False, partition(mechanism.model)).regions.regions
    assert (len(region.freedoms), region.far) == (9, [])
    codegen.generate(mechanism.model, tmp_path / "delta", "numpy", compile=False)
    check(mechanism, codegen.load(tmp_path / "delta", "numpy"), 1)
    together, apart = (operations_as(one, mechanism.model, monkeypatch) for one in (True, False))
    assert together < 0.45 * apart


def test_the_choice_is_the_shorter_one_or_nearly(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is chosen takes at most a fifth more operations than the other: couplings are kept where little is to be gained."""
    for name in ("platform_on_short_legs", "platform_on_ground"):
        model = by_hand(name).model
        assert operations(model) <= 1.2 * min(operations_as(one, model, monkeypatch) for one in (True, False)), name


@pytest.mark.parametrize("name", ["closed_chain", "stewart"])
def test_few_links_on_a_long_way_stay_a_region_of_their_own(name: str) -> None:
    assert set(regions_of(load_model(EXAMPLES / f"{name}.yaml"))) == {1}


def test_sources_are_counted_along_the_way() -> None:
    """A link of an ear moves with the speeds of what its bundle starts from; a link before that only with those inboard of it."""
    model = load_model(EXAMPLES / "closed_chain.yaml")
    system = analyse(model, False, partition(model))
    n = len(system.links)
    dependent = {(n - 1, 0), (n - 2, 0)}
    ends = [(n - 1, -1)]
    bundle = Bundle((0,), list(range(n)), 1.0, [n - 2, n - 1])
    found = sources_of_links(Freedoms(system.links, dependent, ends), [bundle])
    assert found == {i: min(i + 1, n - 2) for i in range(n)}


def test_ears_that_move_links_of_earlier_ones_are_counted_too() -> None:
    """Of three loops that share links, one moves what lies on the ways of another."""
    drawn = draw(13, bodies=(9, 14), loops=(2, 4))
    assert drawn is not None
    (ears,) = regions_of(drawn.model)
    assert ears == 8


def test_thousands_of_loops_are_no_deep_recursion() -> None:
    """Each bundle starts from the one before; what they cost is added up in time that grows with their number."""
    model = load_model(EXAMPLES / "closed_chain.yaml")
    links = analyse(model, False, partition(model)).links
    bundles = [Bundle((), [], 1.0, [], [n - 1] if n else []) for n in range(5000)]
    bundles[0] = Bundle((), list(range(10)), 1.0)
    freedoms = Freedoms(links, {(9, 0)}, [])
    assert not is_one_region(freedoms, bundles, freedoms.independent(range(9)))
    assert region_work.work_together(freedoms, bundles, freedoms.independent(range(9))) > 0
