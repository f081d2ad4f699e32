"""Couplings in blocks: 6x6 blocks of two links, and contributions to partners. Section 4 of the theory page.

Rows and columns of a coupling are components of moment (or angular acceleration), then force (linear acceleration).
Each component is along the axes of its own link and about the origin of this link. Partners are the links to which a
unit is coupled (`elimination_order.Partners`).
"""

from __future__ import annotations

from collections.abc import Callable

from ..program.block import Scope
from ..program.field import PLACES, SixField
from ..program.scalar import Matrix, Vector
from ..program.store import Store
from . import fields
from .propagation import accumulate, clear
from .spatial import add, cross, transpose, turned
from .stores import BASE, LBASE, LPARTNERS, LUP, PAIR, PARTNERS, UP
from .structure.elimination_order import CARRIER
from .structure.kinds import LinkKind, RegionKind

Coupled = LinkKind | RegionKind


def partner_store(kind: Coupled, m: int, lanes: bool = False) -> Store:
    """The record of partner m of a unit, or with `lanes` its slot. The partner that carries the unit is the parent of a
    link, or the base of a region."""
    if m in (kind.partners.base, CARRIER):
        record, slot = (UP, LUP) if kind.role == "link" else (BASE, LBASE)
        return slot if lanes else record
    return (LPARTNERS if lanes else PARTNERS)[m]


def others(kind: Coupled) -> list[int]:
    """All partners except the link that carries the unit."""
    return [m for m in range(len(kind.partners.links)) if m != kind.partners.base]


def add_couplings(x: Scope, kind: Coupled, block: Callable[[int, int], Matrix]) -> None:
    """Adds the unit's contributions to the couplings of its partners; `block` returns the 6x6 block of two partners."""
    for n, pair in enumerate(kind.partners.contributions):
        accumulate(x, PAIR[n], fields.coupling, block(*pair.ends), pair.first, "Eq. 44")


def add_partner_inertia(x: Scope, kind: Coupled, m: int, Q: Matrix) -> None:
    """Add a symmetric 6x6 inertia to a partner's articulated inertia."""
    add_inertia(x, partner_store(kind, m), Q, kind.partners.first[m])


def add_inertia(x: Scope, store: Store, Q: Matrix, first: bool) -> None:
    """Adds a symmetric 6x6 inertia to the articulated inertia of a link. With `first`, it is assigned instead."""
    inertia = fields.articulated
    for J, M, (i, j) in zip(inertia.J.scalars(), inertia.M.scalars(), PLACES, strict=True):
        accumulate(x, store, J, Q[i][j], first, "Eq. 44")
        accumulate(x, store, M, Q[3 + i][3 + j], first, "Eq. 44")
    accumulate(x, store, inertia.H, [row[3:] for row in Q[:3]], first, "Eq. 44")
    clear_scales(x, store, first)


def clear_scales(x: Scope, store: Store, first: bool) -> None:
    """With `first`, sets to zero the magnitudes with which pivots are compared; only links add to them later."""
    if first:
        clear(x, store, fields.moment_scale)
        clear(x, store, fields.mass_scale)


def add_partner_force(
    x: Scope, kind: Coupled, m: int, values: Vector, field: SixField = fields.articulated_force, lanes: bool = False
) -> None:
    """Add a moment and a force to a partner's articulated force, or to another `field`."""
    accumulate(x, partner_store(kind, m, lanes), field, values, kind.partners.first[m], "Eq. 45", lanes)


def partner_acceleration(x: Scope, kind: Coupled, m: int, lanes: bool) -> Vector:
    """The part of a partner's acceleration that is explicit in udot, along the partner's axes."""
    return list(x.load(partner_store(kind, m, lanes), fields.explicit_acceleration))


# -- motion of a far link relative to the base ------------------------------------------------------------------------


def from_far(x: Scope, W: Matrix, v: Vector, tag: str, lanes: bool = False) -> Vector:
    """Six components along the base's axes, converted to the far link's axes."""
    return [x.let("far", e, tag, lanes=lanes) for e in turned(transpose(W), v)]


def to_base(x: Scope, o: Vector, v: Vector, tag: str, lanes: bool = False) -> Vector:
    """Converts a moment about the point o and a force to a moment about the base's origin and the same force."""
    moved = add(v[:3], cross(o, v[3:]))
    return [x.let("at_base", e, tag, lanes=lanes) for e in moved] + list(v[3:])
