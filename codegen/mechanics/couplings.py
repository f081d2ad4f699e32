"""Couplings in blocks: 6x6 blocks of two links, and what is handed to partners. Section 4 of the theory page.

Rows and columns of a coupling are components of moment (or angular acceleration), then force (linear acceleration), each in
the axes of its own link about its own origin. Partners are links that a unit is coupled to (`elimination.Partners`).
"""

from __future__ import annotations

from typing import Any

from .ears import rotate
from .elimination import BASE
from .spatial import NINE, PAIRS, XYZ, Mat, Vec, add, cross, is_zero, transpose

SIX = range(6)


def component(prefix: str, i: int) -> str:
    """Name of the i-th of six components: ``n.x`` ... ``f.z``."""
    return f"{prefix}{'nf'[i // 3]}.{XYZ[i % 3]}"


def load_coupling(x: Any, array: str) -> Mat:
    return [[x.load(array, f"{i}{k}") for k in SIX] for i in SIX]


def partner_array(kind: Any, m: int, prefix: str = "") -> str:
    """The array of a partner; of the one that the unit hangs on, as everything else there calls it."""
    if m in (kind.partners.base, BASE):
        return prefix + ("up" if kind.role == "link" else "base")
    return f"{prefix}partner#{m}"


def others(kind: Any) -> list[int]:
    """Partners without the link that the unit hangs on."""
    return [m for m in range(len(kind.partners.links)) if m != kind.partners.base]


def hand_on(x: Any, kind: Any, block: Any) -> None:
    """Add to the couplings of the links that remain; `block` gives the 6x6 block of two of them, rows first."""
    for n, pair in enumerate(kind.partners.handed_on):
        value = block(*pair.ends)
        for i in SIX:
            for k in SIX:
                _accumulate(x, f"pair#{n}", f"{i}{k}", value[i][k], pair.first, False, "Eq. 44")


def hand_inertia(x: Any, kind: Any, m: int, Q: Mat) -> None:
    """Add a symmetric 6x6 inertia to what a partner carries."""
    array, first = partner_array(kind, m), kind.partners.first[m]
    for p in PAIRS:
        i, j = XYZ.index(p[0]), XYZ.index(p[1])
        _accumulate(x, array, f"acc.J.{p}", Q[i][j], first, False, "Eq. 44")
        _accumulate(x, array, f"acc.M.{p}", Q[3 + i][3 + j], first, False, "Eq. 44")
    for p in NINE:
        _accumulate(x, array, f"acc.H.{p}", Q[XYZ.index(p[0])][3 + XYZ.index(p[1])], first, False, "Eq. 44")


def hand_force(x: Any, kind: Any, m: int, values: Vec, prefix: str = "acc.", lanes: bool = False) -> None:
    """Add moment and force to what a partner carries."""
    array, first = partner_array(kind, m, "l" if lanes else ""), kind.partners.first[m]
    for i, value in enumerate(values):
        _accumulate(x, array, component(prefix, i), value, first, lanes, "Eq. 45")


def _accumulate(x: Any, array: str, field: str, value: Any, first: bool, lanes: bool, tag: str) -> None:
    if not first:
        if is_zero(value):
            return
        value = x.let("acc", x.load(array, field) + value, tag, lanes=lanes)
    x.store(array, field, value)


def partner_acceleration(x: Any, kind: Any, m: int, lanes: bool) -> Vec:
    """The explicit part of a partner's acceleration, in its own axes."""
    array = partner_array(kind, m, "l" if lanes else "")
    return [x.load(array, f"{('bal', 'ba')[i // 3]}.{XYZ[i % 3]}") for i in SIX]


# -- motion of a far link against the base ----------------------------------------------------------------------------


def from_far(x: Any, W: Mat, v: Vec, tag: str, lanes: bool = False) -> Vec:
    """Six components in the base's axes turned into the far link's."""
    back = transpose(W)
    return [x.let("far", e, tag, lanes=lanes) for part in (v[:3], v[3:]) for e in rotate(back, part)]


def to_base(x: Any, o: Vec, v: Vec, tag: str, lanes: bool = False) -> Vec:
    """Moment and force at a point o, about the base's origin."""
    moved = add(v[:3], cross(o, v[3:]))
    return [x.let("at_base", e, tag, lanes=lanes) for e in moved] + list(v[3:])
