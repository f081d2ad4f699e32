"""The order of elimination, and the couplings that arise in it."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest
from coupled_mechanisms import BY_HAND, by_hand, platform, rails, tips_joined
from random_mechanisms import random_mechanisms

from codegen.loops.partition import partition
from codegen.mechanics.structure.elimination_order import CARRIER
from codegen.mechanics.structure.system import System, analyse
from codegen.model.model import GROUND, Model


def analysed(model: Model) -> System:
    return analyse(model, False, partition(model))


MODELS = [*BY_HAND, "random"]


@cache
def systems(name: str) -> list[System]:
    if name == "random":
        return [analysed(drawn.model) for _, drawn in random_mechanisms(3, bodies=(6, 14), loops=(2, 4))]
    return [analysed(by_hand(name).model)]


@pytest.mark.parametrize("name", MODELS)
def test_units_come_after_what_they_hang_on(name: str) -> None:
    for system in systems(name):
        found = system.regions
        seen_links, seen_regions = {GROUND}, set[int]()
        for unit in found.order:
            if unit.role == "link":
                assert system.links[unit.number].parent in seen_links
            elif unit.role == "region":
                region = found.regions[unit.number]
                assert {region.base, *region.far} <= seen_links
                seen_regions.add(unit.number)
            else:
                ear = found.ears[unit.number]
                assert ear.region in seen_regions
                assert {*ear.roots} <= seen_links
            seen_links.update(unit.links)
        assert len(seen_links) == len(system.links) + 1


@pytest.mark.parametrize("name", MODELS)
def test_a_coupling_keeps_its_place_from_the_first_to_the_last_who_touches_it(name: str) -> None:
    """Inward: a unit takes what ends with it, then adds to others; no two couplings have one place at a time."""
    for system in systems(name):
        elimination = system.regions.elimination
        alive: dict[int, int] = {}
        ended = set[int]()
        for partners in reversed(elimination.partners):
            for c in partners.own:
                ended.add(c)
            for contribution in partners.contributions:
                c, slot = contribution.coupling, elimination.coupling_slot[contribution.coupling]
                assert c not in ended
                assert contribution.first == (c not in alive.values())
                assert alive.get(slot, c) == c
                alive[slot] = c
                assert all(end == CARRIER or 0 <= end < len(partners.links) for end in contribution.ends)
            for c in partners.own:
                if alive.get(elimination.coupling_slot[c]) == c:
                    del alive[elimination.coupling_slot[c]]
        assert not alive
        assert ended == set(range(len(elimination.coupling_slot)))
        assert all(0 <= slot < elimination.slots for slot in elimination.coupling_slot)


@pytest.mark.parametrize(
    ("made", "hinted", "most", "places"),
    [(rails, True, 1, 2), (rails, False, 2, 2), (tips_joined, True, 1, 2), (platform, True, 2, 5)],
)
def test_few_partners_and_places_however_long_the_branches(made: Any, hinted: bool, most: int, places: int) -> None:
    for n in (9, 18):  # the choice for up to eight loops is compared with others, and may take a cluster
        elimination = analysed(made(n).model(hinted)).regions.elimination
        assert max(len(p.links) for p in elimination.partners) == most
        assert elimination.slots == places


def used(system: System, n: int) -> set[int]:
    """Links whose values a unit uses, including its own."""
    found, unit = system.regions, system.regions.order[n]
    if unit.role == "link":
        return {unit.number, system.links[unit.number].parent, *found.elimination.partners[n].links} - {GROUND}
    if unit.role == "region":
        return {found.regions[unit.number].base, *found.elimination.partners[n].links} - {GROUND}
    ear = found.ears[unit.number]
    return {*ear.links, *ear.roots, found.regions[ear.region].base} - {GROUND}


@pytest.mark.parametrize("name", MODELS)
def test_links_that_are_needed_at_a_time_have_slots_of_their_own(name: str) -> None:
    """Outward: a link takes a slot with its unit, and keeps it until the last unit has gone that uses it."""
    for system in systems(name):
        uses = [used(system, n) for n in range(len(system.regions.order))]
        last = {i: n for n, links in enumerate(uses) for i in links}
        alive: dict[int, int] = {}
        for n, unit in enumerate(system.regions.order):
            for i in unit.links if unit.role != "region" else ():
                slot = system.slot_of[i]
                assert 0 < slot < system.slots  # that of the ground is the first
                assert slot not in alive
                alive[slot] = i
            assert all(alive.get(system.slot_of[i]) == i for i in uses[n])
            alive = {slot: i for slot, i in alive.items() if last[i] != n}


@pytest.mark.parametrize("name", MODELS)
def test_one_unit_alone_is_the_first_to_hand_inertia_to_a_link(name: str) -> None:
    """Inward: who comes first writes, all others add."""
    for system in systems(name):
        found, written = system.regions, set[int]()
        for n in reversed(range(len(found.order))):
            unit, kind, partners = found.order[n], system.unit_kind_of[n], found.elimination.partners[n]
            if unit.role == "ear":
                continue
            base = system.links[unit.number].parent if unit.role == "link" else found.regions[unit.number].base
            first = getattr(kind, "first_unit" if unit.role == "link" else "first")
            assert first == (base not in written)
            assert partners.first == [i not in written for i in partners.links]
            written |= {base, *partners.links}
        assert written == found.elimination.first_contributor.keys()
