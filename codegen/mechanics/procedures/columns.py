"""Matrices of trees, all columns at once: derivatives with respect to the state and joint forces, and mass matrices.

With force elements or loops each column depends on all links, so such models compute columns one after the other.
"""

from __future__ import annotations

from ...program.procedure import WIDTHS, AllColumns, Array, Primitives, Run, Weighted
from ..structure.system import System, speeds_with_forces
from ..sweeps import SWEEP
from .shared import Shared
from .words import JOINT_FORCES

MOST_COLUMNS = 64
"""Maximum number of columns that are computed at once, so that their memory stays in fast caches."""

MOST_LINKS = 256
"""Largest number of links for which all columns are computed at once; beyond it, columns would take most of the
memory."""

LEAST_COLUMNS = 12
"""Memory is reserved for at least this many columns, since other functions over directions use the same memory."""

Entries = tuple[tuple[Array, int], ...]


def applies(system: System) -> bool:
    """Whether the columns of a system's matrices can be computed at once."""
    model = system.model
    return model.nu > 0 and not model.loops and not system.elements and len(system.links) <= MOST_LINKS


def room(system: System) -> int:
    """Number of columns for which memory is reserved: one per coordinate and speed, rounded up to a multiple of four,
    within the limits above."""
    model = system.model
    return max(LEAST_COLUMNS, min(-(-(model.nq + model.nu) // 4) * 4, MOST_COLUMNS))


def by_link(system: System, *of: tuple[Array, str]) -> tuple[Entries, tuple[int, ...]]:
    """The entries of arrays, sorted by link, and the index at which the entries of each link begin.

    `of` lists arrays, each with "q" if it has an entry for each coordinate, or "u" for each speed.
    """
    entries: list[tuple[Array, int]] = []
    starts = [0]
    for link in system.links:
        for array, what in of:
            first, count = (link.q, link.joint.coordinates) if what == "q" else (link.u, link.joint.freedoms)
            entries += [(array, first + i) for i in range(count)]
        starts.append(len(entries))
    return tuple(entries), tuple(starts)


def _columns(
    w: Shared,
    seeds: dict[Array, tuple[str, Array | None]],
    sweeps: tuple[str, ...],
    of: Array,
    weighted: tuple[Weighted, ...] = (),
    symmetric: bool = True,
) -> AllColumns:
    """The step that computes columns of matrices. `seeds` maps each seed to "q" or "u" (see `by_link`) and to the matrix
    that receives its columns, or None."""
    units, starts = by_link(w.system, *((array, what) for array, (what, _) in seeds.items()))
    return AllColumns(
        units,
        starts,
        tuple(max(link.parent, -1) for link in w.system.links),
        tuple(Run(name, True) for name in sweeps),
        of,
        room(w.system),
        tuple((into, i) for a, i in units if (into := seeds[a][1]) is not None),
        weighted,
        symmetric,
        SWEEP[sweeps[-1]].groups,
        tuple(then for name in sweeps if (then := SWEEP[name].then)),
    )


def by_state(w: Shared) -> AllColumns:
    """Derivatives of udot with respect to coordinates and speeds, with joint forces held constant."""
    dq, du, dudot, J_q, J_u = w.of("dq", "du", "dudot", "J_q", "J_u")
    turns = ("column_turns",) if any(link.joint.quaternion is not None for link in w.system.links) else ()
    sweeps = (
        "column_clear", *turns, "column_seed", "column_in", "column_rest", "column_begin", "column_back", "column_turn",
        "column_add",
    )  # fmt: skip
    return _columns(w, {dq: ("q", J_q), du: ("u", J_u)}, sweeps, dudot, symmetric=False)


UNIT_FORCES = ("column_clear", "column_unit", "column_in", "column_rest", "column_back")
"""Sweeps that compute columns of the inverse mass matrix."""


def by_forces(w: Shared, weighted: tuple[Weighted, ...]) -> AllColumns:
    """The step that computes the contribution of joint forces to the derivatives of udot: the inverse mass matrix times
    the derivatives of the forces."""
    return _columns(w, {w.one("b").tangent("b"): ("u", None)}, UNIT_FORCES, w.one("dudot"), weighted)


def inverse_mass(w: Shared) -> AllColumns:
    """The inverse of the mass matrix, computed from the factors of the triangularization."""
    return _columns(w, {w.one("b").tangent("b"): ("u", w.one("inverse_M"))}, UNIT_FORCES, w.one("dudot"))


def mass(w: Shared) -> AllColumns:
    """Steps that compute the mass matrix from composite inertias."""
    sweeps = ("column_clear", "composite_seed", "composite_in")
    return _columns(w, {w.one("b").tangent("b"): ("u", w.one("M"))}, sweeps, w.one("dforce"))


def force_primitives(w: Shared) -> Primitives | None:
    """The step that computes derivatives of joint forces with respect to coordinates, speeds and inputs.

    Arguments share a direction if no force reads two of them. Returns None if there are still too few directions.
    """
    model, system = w.system.model, w.system
    places = {f"q.{n}": ("q", i) for i, n in enumerate(model.coordinate_names)}
    places |= {f"u.{n}": ("u", i) for i, n in enumerate(model.speed_names)}
    if "inputs" not in w.p:
        places |= {n: ("inputs", i) for i, n in enumerate(model.inputs)}
    arguments: dict[int, set[tuple[str, int]]] = {}
    for forces in system.force_of.values():
        for force in forces:
            for i, value in speeds_with_forces(model, force):
                of = {places[n] for n in value.names if n in places}
                if of and i >= 0:
                    arguments.setdefault(i, set()).update(of)
    users: dict[tuple[str, int], list[int]] = {}
    for i, of in arguments.items():
        for a in of:
            users.setdefault(a, []).append(i)
    taken: dict[int, set[int]] = {i: set() for i in arguments}
    weighted: list[Weighted] = []
    for a in sorted(users):
        busy = set[int]().union(*(taken[i] for i in users[a]))
        direction = next((d for d in range(max(WIDTHS)) if d not in busy), None)
        if direction is None:
            return None
        name, entry = a
        for i in users[a]:
            taken[i].add(direction)
            weighted.append(Weighted(i, w.one(f"J_{name}"), entry, w.one(f"d{name}"), direction))
    weighted.sort(key=lambda x: (x.entry, x.seed.name, x.column))
    return Primitives(JOINT_FORCES.tangents(), w.one("dtau"), tuple(weighted))
