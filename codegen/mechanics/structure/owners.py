"""Which link's memory a store accesses, for each instance of a kind.

A block is written once for a kind and names neighbouring memory by its owner (`stores`): its parent, a root, a partner.
These are different links for each instance. Addresses, zero patterns and gradients look these links up here.
"""

from __future__ import annotations

from ...model.model import GROUND
from ...program.store import Store
from ..stores import BASE_LINK, ELEMENT_END, GROUND_LINK, LINK, PARENT, PARTNER, ROOT
from .element_kinds import ElementKind
from .kinds import LinkKind, RegionKind, UnitKind
from .system import System


def owner_links(system: System, kind: UnitKind, store: Store, of_units: bool) -> list[int]:
    """For each instance of a kind, the link whose memory a store accesses.

    Parameters
    ----------
    system : System
    kind : UnitKind
    store : Store
        Its owner is a link, a parent, a root, a base, a partner, the end of a force element, or the ground.
    of_units : bool
        Instances are indices in the order of units, ``kind.units``; otherwise links or force elements, ``kind.members``.

    Returns
    -------
    list of int
        Indices of links in outward order; `model.GROUND` for the ground.
    """
    return [_link(system, kind, store, i, of_units) for i in (kind.units if of_units else kind.members)]


def _link(system: System, kind: UnitKind, store: Store, i: int, of_units: bool) -> int:
    """The link whose memory a store accesses, for one instance."""
    regions, owner, place = system.regions, store.owner, store.place
    if owner is GROUND_LINK:
        return GROUND
    if isinstance(kind, ElementKind):
        assert owner is ELEMENT_END and place is not None
        return system.elements[i].links[place]
    if owner is PARTNER:
        assert of_units and place is not None
        return regions.elimination.partners[i].links[place]
    if isinstance(kind, LinkKind):
        link = regions.order[i].number if of_units else i
        return system.links[link].parent if owner is PARENT else link
    number = regions.order[i].number
    if owner is BASE_LINK:
        region = number if isinstance(kind, RegionKind) else regions.ears[number].region
        return regions.regions[region].base
    assert place is not None and owner in (ROOT, LINK)
    ear = regions.ears[number]
    return (ear.roots if owner is ROOT else ear.links)[place]
