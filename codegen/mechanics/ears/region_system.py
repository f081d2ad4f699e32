"""The system of a region: its sources, the base that carries it, and partners; elimination of the sources. Eqs. 39-47."""

from __future__ import annotations

from ...program.block import Scope
from ...program.field import AnyField
from ...program.scalar import Matrix, Vector
from .. import fields
from ..couplings import add_couplings, add_inertia, add_partner_force, add_partner_inertia, from_far, others, to_base
from ..elimination import OF_SOURCES, SymmetricSystem
from ..joints import Column
from ..propagation import accumulate_force, clear
from ..spatial import SIX
from ..stores import BASE, REGION
from ..structure.elimination_order import CARRIER
from ..structure.kinds import RegionKind
from .far_links import far_motions


def place_of_base(kind: RegionKind) -> int:
    """First of the base's six components among the unknowns of a region."""
    return int(kind.total if kind.rigid else kind.sources)


def system_size(kind: RegionKind) -> int:
    """Number of unknowns of a region: one for each source, and six for a base that carries it rigidly."""
    return int(kind.total + (6 if kind.carried and kind.rigid else 0))


def unknowns(kind: RegionKind) -> int:
    """Number of all unknowns: the region's own, and six for each partner."""
    return system_size(kind) + 6 * len(others(kind))


def places_of_partners(kind: RegionKind) -> list[int]:
    """For each partner, the index of its first component among all unknowns. If the base is a partner, its components
    occur only once."""
    found, at = [], system_size(kind)
    for m in range(len(kind.partners.links)):
        found.append(place_of_base(kind) if m == kind.partners.base else at)
        at += 0 if m == kind.partners.base else 6
    return found


def sum_fields(kind: RegionKind) -> list[AnyField]:
    """The fields in which a region sums the contributions of its ears."""
    sources = range(kind.total)
    found: list[AnyField] = [fields.source_inertia(c, d) for c in sources for d in range(c, kind.total)]
    found += [fields.source_force(c) for c in sources]
    if kind.carried and kind.rigid:
        carried = fields.region_inertia
        found += [carried.J, carried.M, carried.H, fields.region_force, *(fields.source_to_base(c) for c in sources)]
    partners, rows = range(len(kind.partners.links)), range(system_size(kind))
    return found + [fields.source_to_partner(m, c, k) for m in partners for c in rows for k in SIX]


def region_start(x: Scope, kind: RegionKind) -> None:
    """Outward block of a region: set sums to zero, and compute the motions of its far links."""
    for field in sum_fields(kind):
        clear(x, REGION, field)
    far_motions(x, kind)


def region_system(x: Scope, kind: RegionKind) -> SymmetricSystem:
    """Inertia and force of a region over its sources, a base that is a link, and partners."""
    at, where = place_of_base(kind), places_of_partners(kind)
    size = unknowns(kind)
    Q: Matrix = [[0] * size for _ in range(size)]
    g: Vector = [0] * size
    for c in range(kind.total):
        g[c] = x.load(REGION, fields.source_force(c))
        for d in range(c, kind.total):
            Q[c][d] = Q[d][c] = x.load(REGION, fields.source_inertia(c, d))
    if kind.carried and kind.rigid:
        J, M = x.load(REGION, fields.region_inertia.J), x.load(REGION, fields.region_inertia.M)
        H = x.load(REGION, fields.region_inertia.H)
        for i in range(3):
            for j in range(3):
                Q[at + i][at + j], Q[at + 3 + i][at + 3 + j] = J[i][j], M[i][j]
                Q[at + i][at + 3 + j] = Q[at + 3 + j][at + i] = H[i][j]
            force = fields.region_force.scalars()
            g[at + i], g[at + 3 + i] = x.load(REGION, force[i]), x.load(REGION, force[3 + i])
        for c in range(kind.total):
            for i in range(6):
                Q[c][at + i] = Q[at + i][c] = x.load(REGION, fields.source_to_base(c).scalars()[i])
    for m, first in enumerate(where):
        P = [[x.load(REGION, fields.source_to_partner(m, c, k)) for k in SIX] for c in range(system_size(kind))]
        for c, row in enumerate(P):
            for k, value in enumerate(row):
                if m != kind.partners.base:
                    Q[c][first + k] = Q[first + k][c] = value
                elif not at <= c < at + 6:
                    Q[c][at + k] = Q[at + k][c] = x.let("Q", Q[c][at + k] + value, "Eq. 40")
                elif c - at <= k:  # the base is also a partner: both rows and columns of its block change
                    both = value + P[at + k][c - at]
                    Q[c][at + k] = Q[at + k][c] = x.let("Q", Q[c][at + k] + both, "Eq. 40")
    return SymmetricSystem(x, kind, Q, g, OF_SOURCES, [""] * size)


def region_triangularize(x: Scope, kind: RegionKind) -> None:
    """Inward block of a region: eliminate its sources, the last one first, and propagate the rest to the link that carries it.

    Eqs. 44-47.
    """
    system = region_system(x, kind)
    for j in reversed(kind.free):
        # the pivot is compared with the source's own inertia before the elimination of other sources
        system.eliminate(j, Column(j), 0, x.load(REGION, fields.source_inertia(j, j)))
    Q, g = system.Q, system.p
    at = place_of_base(kind)
    keep_driving(x, kind, Q, g)
    if kind.far:
        absolute_motions(x, kind, Q, g)
    where = places_of_partners(kind)
    for m in others(kind):
        add_partner_inertia(x, kind, m, system.block(where[m], where[m]))
        add_partner_force(x, kind, m, g[where[m] : where[m] + 6])

    def remaining_block(m: int, n: int) -> Matrix:
        rows, columns = (at if end == CARRIER else where[end] for end in (m, n))
        return system.block(rows, columns)

    add_couplings(x, kind, remaining_block)
    if not kind.carried:
        return
    accumulate_force(x, BASE, fields.articulated_force, g[at : at + 6], kind.first, "Eq. 45")
    add_inertia(x, BASE, system.block(at, at), kind.first)


def keep_driving(x: Scope, kind: RegionKind, Q: Matrix, g: Vector) -> None:
    """Store the terms of the forces along prescribed sources: entries of g, and the entries of Q for accelerations that
    back substitution knows before those of the sources."""
    for c in kind.locked:
        x.store(REGION, fields.source_driving_rest(c), g[c])
        for i in range(kind.sources, len(g)):
            x.store(REGION, fields.source_driving_gain(c, i), Q[c][i])


def absolute_motions(x: Scope, kind: RegionKind, Q: Matrix, g: Vector) -> None:
    """Replace relative motions of far links by accelerations of these links and of the base: ``s = A_far - X A_base``. Eq. 39.

    Changes Q and g in place; the columns of a far link are then along the axes of that link.
    """
    tag = "Eq. 39"
    base, where = place_of_base(kind), places_of_partners(kind)
    for f, m in enumerate(kind.far):
        s = kind.sources + 6 * f
        W, o = x.load(REGION, fields.far_attitude(f)), x.load(REGION, fields.far_position(f))

        def add_to(target: Vector, v: Vector, m: int = m, W: Matrix = W, o: Vector = o) -> None:
            """Add the contribution of six components along s to the base and the far link."""
            for i, value in enumerate(to_base(x, o, v, tag)):
                target[base + i] = x.let("Q", target[base + i] - value, tag)
            if m >= 0:
                for i, value in enumerate(from_far(x, W, v, tag)):
                    target[where[m] + i] = x.let("Q", target[where[m] + i] + value, tag)

        add_to(g, g[s : s + 6])
        for row in Q[kind.sources :]:
            add_to(row, row[s : s + 6])
        changed = [base + i for i in SIX] + ([where[m] + i for i in SIX] if m >= 0 else [])
        for c in changed:
            column = [row[c] for row in Q]
            add_to(column, column[s : s + 6])
            for r in changed:
                Q[r][c] = column[r]
        for r, row in enumerate(Q):
            if r not in changed:
                for c in changed:
                    Q[c][r] = row[c]
