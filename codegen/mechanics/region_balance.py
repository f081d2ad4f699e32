"""The balance through regions: the sources' right sides are eliminated, and what is left goes to the links that carry them.

Section 4.6 of the theory page.
"""

from __future__ import annotations

from typing import Any

from .couplings import SIX, component, from_far, hand_force, others, to_base
from .far_links import far_own_motions
from .kinematics import load_matrix, load_vector
from .loop_dynamics import accumulate_base, place_of_base, places_of_partners, store_sources, system_size
from .spatial import XYZ, Vec


def region_balance_start(x: Any, kind: Any) -> None:
    """Outward block over directions: nothing is summed yet; how far links move, in their own axes."""
    for c in range(kind.total):
        x.store("lregion", f"r{c}", 0)
    for prefix in transmitted_fields(kind):
        for name in ("n", "f"):
            for axis in XYZ:
                x.store("region", f"{prefix}t.{name}.{axis}", 0)
                x.store("lregion", f"{prefix}b.{name}.{axis}", 0)
    far_own_motions(x, kind)


def transmitted_fields(kind: Any) -> list[str]:
    """Where a region sums up forces on the links that it hangs on: ``t`` the force, ``b`` its tangent, after these prefixes."""
    return [""] * kind.carried + [f"far{f}." for f, m in enumerate(kind.far) if m >= 0]


def region_balance_in(x: Any, kind: Any) -> None:
    """Inward block over directions: the sources' right sides are eliminated; what is left goes to the links that carry them.

    Eqs. 45, 53.
    """
    at, where = place_of_base(kind), places_of_partners(kind)
    g: list[Any] = [x.load("lregion", f"r{c}") for c in range(kind.total)]
    g += [0] * (system_size(kind) + 6 * len(others(kind)) - len(g))
    for i in range(6 if kind.carried else 0):
        g[at + i] = g[at + i] + x.load("lregion", component("b.", i))
    for j in reversed(range(kind.sources)):
        x.store("lregion", f"rD{j}", x.let("rD", -g[j] * x.load("region", f"Dinv{j}"), "d Eq. 53", lanes=True))
        for i in range(len(g)):
            if i < j or i >= kind.sources:
                g[i] = x.let("g", g[i] - x.load("region", f"G{j}.{i}") * g[j], "d Eq. 45", lanes=True)
    transmitted: dict[int, Vec] = {m: [0] * 6 for m in others(kind)}
    for f, m in enumerate(kind.far):
        s = kind.sources + 6 * f
        W, o = load_matrix(x, "region", f"far{f}.W"), load_vector(x, "region", f"far{f}.o")
        for i, value in enumerate(to_base(x, o, g[s : s + 6], "d Eq. 45", True)):
            g[at + i] = x.let("g", g[at + i] - value, "d Eq. 45", lanes=True)
        if m < 0:
            continue
        # what ears have handed to it is in its own axes
        transmitted[m], b = (
            [x.load(array, component(f"far{f}.{n}.", i)) for i in SIX]
            for array, n in (("region", "t"), ("lregion", "b"))
        )
        for i, value in enumerate(from_far(x, W, g[s : s + 6], "d Eq. 45", True)):
            g[where[m] + i] = x.let("g", g[where[m] + i] + value + b[i], "d Eq. 45", lanes=True)
    for m in others(kind):
        hand_force(x, kind, m, g[where[m] : where[m] + 6], lanes=True)
        hand_force(x, kind, m, transmitted[m], "tacc.")
    for i in range(6 if kind.carried else 0):
        name = component("", i)
        accumulate_base(x, kind, f"acc.{name}", g[at + i], "lbase", True)
        accumulate_base(x, kind, f"tacc.{name}", x.load("region", f"t.{name}"))


def region_balance_back(x: Any, kind: Any) -> None:
    """Outward block over directions: tangents of the sources' accelerations."""
    store_sources(x, kind, "lregion", [x.load("lregion", f"rD{j}") for j in range(kind.sources)], True)
