"""Operation counts of generated functions, and rooflines: operations per second compared with the peak performance of a core.

Rooflines are those of Williams, Waterman and Patterson (2009).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..runtime import Solver

KINDS = ("additions", "multiplications", "divisions", "functions")
Sweeps = Mapping[str, Mapping[str, Mapping[str, int]]]
"""Operation counts by sweep, ``per_call`` or ``per_direction``, and kind."""


def of_manifest(manifest: Mapping[str, Any], function: str) -> Sweeps:
    """The sweeps of a generated function, with the names that `Solver.operations` uses."""
    return {sweep: manifest["operations"].get(sweep, {}) for sweep in manifest["functions"][function]["sweeps"]}


def total(sweeps: Sweeps, part: str = "per_call", among: Iterable[str] | None = None) -> dict[str, int]:
    """Total additions, multiplications, divisions and functions of all or selected sweeps."""
    chosen = [sweeps.get(name, {}).get(part, {}) for name in (sweeps if among is None else among)]
    return {kind: sum(int(counts.get(kind, 0)) for counts in chosen) for kind in KINDS}


def plain(operations: Mapping[str, int]) -> int:
    """Total number of additions and multiplications."""
    return operations.get("additions", 0) + operations.get("multiplications", 0)


def operations(solver: Solver, function: str, directions: int = 0) -> int:
    """Total additions, multiplications, divisions and functions of one call."""
    once, each = (total(solver.operations[function], part) for part in ("per_call", "per_direction"))
    return sum(once.values()) + directions * sum(each.values())


def point(solver: Solver, name: str, function: str, directions: int, seconds: float) -> dict[str, Any]:
    """A point of a roofline: operations per second, and operations per byte of arguments and results, of a timed
    call."""
    n, k = operations(solver, function, directions), directions
    moved = 8 * ((solver.nq + 2 * solver.nu + solver.ninputs) * (1 + k) + solver.np * k + 1)
    return {"name": name, "operations": n, "per_second": n / seconds, "per_byte": n / moved}
