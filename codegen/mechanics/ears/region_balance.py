"""The balance through regions: the sources' right sides are eliminated, and the rest is propagated to the links that
carry the region.

Section 4.6 of the theory page.
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.field import SixField
from ...program.scalar import Vector
from .. import fields
from ..couplings import add_partner_force, from_far, others, to_base
from ..elimination import OF_SOURCES, eliminate_force
from ..joints import Column
from ..propagation import accumulate
from ..spatial import SIX
from ..stores import BASE, LBASE, LREGION, REGION
from ..structure.kinds import RegionKind
from .back_substitution import find_sources
from .far_links import far_own_motions
from .region_system import place_of_base, places_of_partners, unknowns


def region_balance_start(x: Scope, kind: RegionKind) -> None:
    """Outward block over directions of a region: set sums to zero, and compute the motions of far links along their
    own axes."""
    for c in range(kind.total):
        x.store(LREGION, fields.source_tangent_force(c), 0)
    clear_transmitted(x, kind)
    far_own_motions(x, kind)


def clear_transmitted(x: Scope, kind: RegionKind) -> None:
    """Outward block over directions of a region: set the forces on its carrying links, and their tangents, to zero."""
    for whole, balance in transmitted_fields(kind):
        for i in SIX:
            x.store(REGION, whole.scalars()[i], 0)
            x.store(LREGION, balance.scalars()[i], 0)


def transmitted_fields(kind: RegionKind) -> list[tuple[SixField, SixField]]:
    """Stores in which a region sums the forces on its carrying links, and their tangents."""
    of_base = [(fields.region_transmitted, fields.region_balance)] if kind.carried else []
    return of_base + [(fields.far_transmitted(f), fields.far_balance(f)) for f, m in enumerate(kind.far) if m >= 0]


def region_balance_in(x: Scope, kind: RegionKind) -> None:
    """Inward block over directions of a region: eliminate the sources' right sides, and propagate the rest to the
    links that carry the region. Eqs. 45, 53.
    """
    transmitted: dict[int, Vector] = {m: [0] * 6 for m in others(kind)}
    g = eliminated_sources(x, kind, transmitted)
    for m in others(kind):
        add_partner_force(x, kind, m, _of_partner(kind, g, m), lanes=True)
        add_partner_force(x, kind, m, transmitted[m], fields.transmitted)
    for i in range(6 if kind.carried else 0):
        part, value = fields.transmitted.scalars()[i], x.load(REGION, fields.region_transmitted.scalars()[i])
        _add_to_base(x, kind, i, g)
        accumulate(x, BASE, part, value, kind.first, "Eq. 44")


def region_solution(x: Scope, kind: RegionKind) -> None:
    """`region_balance_in` for given right sides, where no transmitted force changes along directions."""
    g = eliminated_sources(x, kind)
    for m in others(kind):
        add_partner_force(x, kind, m, _of_partner(kind, g, m), lanes=True)
    for i in range(6 if kind.carried else 0):
        _add_to_base(x, kind, i, g)


def eliminated_sources(x: Scope, kind: RegionKind, transmitted: dict[int, Vector] | None = None) -> Vector:
    """Right sides of all unknowns of a region, after those of the sources have been eliminated.

    If given, `transmitted` receives the forces on far links, by partner.
    """
    at, where = place_of_base(kind), places_of_partners(kind)
    g: Vector = [x.load(LREGION, fields.source_tangent_force(c)) for c in range(kind.total)]
    g += [0] * (unknowns(kind) - len(g))
    for i in range(6 if kind.carried else 0):
        g[at + i] = g[at + i] + x.load(LREGION, fields.region_balance.scalars()[i])
    for j in reversed(kind.free):
        eliminate_force(x, OF_SOURCES, LREGION, j, Column(j), g, 0, [""] * len(g))
    for c in kind.locked:
        x.store(LREGION, fields.source_driving_rest(c), g[c])
    for f, m in enumerate(kind.far):
        s = kind.sources + 6 * f
        W, o = x.load(REGION, fields.far_attitude(f)), x.load(REGION, fields.far_position(f))
        for i, value in enumerate(to_base(x, o, g[s : s + 6], "d Eq. 45", True)):
            g[at + i] = x.let("g", g[at + i] - value, "d Eq. 45", lanes=True)
        if m < 0:
            continue
        # the sum of the ears' forces on a far link is along that link's axes
        if transmitted is not None:
            transmitted[m] = x.load(REGION, fields.far_transmitted(f))
        b = x.load(LREGION, fields.far_balance(f))
        for i, value in enumerate(from_far(x, W, g[s : s + 6], "d Eq. 45", True)):
            g[where[m] + i] = x.let("g", g[where[m] + i] + value + b[i], "d Eq. 45", lanes=True)
    return g


def _of_partner(kind: RegionKind, g: Vector, m: int) -> Vector:
    at = places_of_partners(kind)[m]
    return g[at : at + 6]


def _add_to_base(x: Scope, kind: RegionKind, i: int, g: Vector) -> None:
    part = fields.articulated_force.scalars()[i]
    accumulate(x, LBASE, part, g[place_of_base(kind) + i], kind.first, "Eq. 44", lanes=True)


def region_balance_back(x: Scope, kind: RegionKind) -> None:
    """Outward block over directions: tangents of the sources' accelerations."""
    find_sources(x, kind, LREGION, True)
