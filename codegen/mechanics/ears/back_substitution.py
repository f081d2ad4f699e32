"""Back substitution in regions and ears: accelerations of sources, of dependent joints, and of links with children.

Eqs. 53-56, over directions too.
"""

from __future__ import annotations

from ...program.block import Scope
from ...program.scalar import Value, Vector
from ...program.store import Store
from .. import fields
from ..couplings import others, partner_acceleration
from ..elimination import OF_SOURCES, substitute
from ..joints import Column
from ..spatial import add, cross, matvec, rotate, scale, transpose
from ..stores import BASE, DDRIVING, DRIVING, DUDOT, EAR, LBASE, LME, LREGION, ME, MY_LANE, REGION, UDOT
from ..structure.kinds import EarKind, RegionKind
from .closures import dependents, own_sources
from .geometry import EarGeometry
from .region_system import place_of_base, places_of_partners, unknowns


def outer_accelerations(x: Scope, kind: RegionKind, lanes: bool) -> dict[int, Value]:
    """Accelerations of far links, base and partners, by index of the unknown; they are known before those of the sources."""
    base = x.load(LBASE if lanes else BASE, fields.explicit_acceleration) if kind.carried else []
    of_partners = [partner_acceleration(x, kind, m, lanes) for m in range(len(kind.partners.links))]
    found = {place_of_base(kind) + i: value for i, value in enumerate(base)}
    for m in others(kind):
        found |= {places_of_partners(kind)[m] + i: value for i, value in enumerate(of_partners[m])}
    for f, m in enumerate(kind.far):
        W, o = x.load(REGION, fields.far_attitude(f)), x.load(REGION, fields.far_position(f))
        angular, linear = [-v for v in base[:3]], [-v for v in add(base[3:], cross(base[:3], o))]
        if m >= 0:
            angular = add(rotate(W, of_partners[m][:3]), angular)
            linear = add(rotate(W, of_partners[m][3:]), linear)
        for i, value in enumerate((*angular, *linear)):
            found[kind.sources + 6 * f + i] = x.let("rel", value, "Eq. 54", lanes=lanes)
    return found


def region_back_substitute(x: Scope, kind: RegionKind) -> None:
    """Outward block of a region: the accelerations of its sources. Eq. 53."""
    find_sources(x, kind, REGION, False)


def find_sources(x: Scope, kind: RegionKind, store: Store, lanes: bool) -> None:
    """Store the accelerations of sources, the relative accelerations of far links, and the forces of prescribed sources."""
    outer = outer_accelerations(x, kind, lanes)
    a: Vector = [outer.get(i, 0) for i in range(unknowns(kind))]
    for c in kind.locked:
        force = x.load(store, fields.source_driving_rest(c))
        for i in range(kind.sources, len(a)):
            force = force + x.load(REGION, fields.source_driving_gain(c, i)) * a[i]
        x.store(store, fields.source_driving(c), x.let("driving", force, "Eq. 53", lanes=lanes))
    for j in kind.free:
        substitute(x, OF_SOURCES, store, j, Column(j), a, "a", lanes)
    for c in range(kind.total if kind.far else kind.sources):
        x.store(store, fields.source_acceleration(c), a[c])


def source_accelerations(x: Scope, kind: EarKind, lanes: bool) -> Vector:
    """Accelerations of all sources of an ear's region."""
    store, own = LREGION if lanes else REGION, kind.total if kind.rigid else kind.sources
    found = [x.load(store, fields.source_acceleration(c)) for c in range(own)]
    if kind.total > len(found):
        found += x.load(LBASE if lanes else BASE, fields.explicit_acceleration)
    return found


def ear_back_substitute(x: Scope, kind: EarKind) -> None:
    """Outward block: accelerations of the ear's joints. Eqs. 53, 54."""
    find_joints(x, kind, False)


def ear_balance_back(x: Scope, kind: EarKind) -> None:
    """Outward block over directions: tangents of the accelerations of the ear's joints. Eq. 55."""
    find_joints(x, kind, True)


def find_joints(x: Scope, kind: EarKind, lanes: bool) -> None:
    """Accelerations of an ear's joints from accelerations of the sources, and driving forces of prescribed joints."""
    store, driving, udot = (LREGION, DDRIVING, DUDOT) if lanes else (REGION, DRIVING, UDOT)
    name, tag = ("dudot", "d Eq. 53") if lanes else ("udot", "Eq. 53")
    a = source_accelerations(x, kind, lanes)
    for c, (k, j) in own_sources(kind).items():
        if c in kind.locked:
            x.set_entry(driving[k], 0, x.load(store, fields.source_driving(c)))
        else:
            x.set_entry(udot[k], j, a[c])
    for d, (k, j) in enumerate(dependents(kind)):
        held = (MY_LANE[k], fields.dependent_acceleration(j)) if lanes else (EAR, fields.dependent_remainder(d))
        value = x.load(*held)
        for c in range(kind.total):
            value = value + x.load(EAR, fields.dependent_rate(d, c)) * a[c]
        x.set_entry(udot[k], j, x.let(name, value, tag, lanes=lanes))
    if any(link.carries for link in kind.links):
        carried_accelerations(x, kind, a, lanes)


def carried_accelerations(x: Scope, kind: EarKind, a: Vector, lanes: bool) -> None:
    """The explicit part of the accelerations of links with children, along the axes of each link. Eq. 54."""
    ear = EarGeometry(x, kind)
    store, base = (LME, LBASE) if lanes else (ME, BASE)
    rigid = x.load(base, fields.explicit_acceleration) if kind.carried and kind.rigid else None
    for k, member in enumerate(ear.members):
        if not kind.links[k].carries:
            continue
        angular: Vector = [0, 0, 0]
        linear: Vector = [0, 0, 0]
        if rigid is not None:
            angular, linear = rigid[:3], add(rigid[3:], cross(rigid[:3], ear.position(k)))
        for c in range(kind.total):
            angular = add(angular, scale(a[c], x.load(ME[k], fields.per_source(c).angular)))
            linear = add(linear, scale(a[c], x.load(ME[k], fields.per_source(c).linear)))
        angular = [x.let("A", e, "Eq. 54", lanes=lanes) for e in angular]
        linear = [x.let("A", e, "Eq. 54", lanes=lanes) for e in linear]
        back = transpose(member.W)
        own = [x.let("bal", e, "Eq. 54", lanes=lanes) for e in matvec(back, angular)]
        own += [x.let("ba", e, "Eq. 54", lanes=lanes) for e in matvec(back, linear)]
        x.store(store[k], fields.explicit_acceleration, own)
