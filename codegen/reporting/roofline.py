"""Roofline: operations per second against what a core can do (Williams, Waterman and Patterson, 2009)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..runtime import Solver


def operations(solver: Solver, function: str, directions: int = 0) -> int:
    """Additions, multiplications, divisions and functions of one call, each counted as one."""
    return sum(
        sum(sweep["per_call"].values()) + directions * sum(sweep["per_direction"].values())
        for sweep in solver.operations[function].values()
    )


def point(solver: Solver, name: str, function: str, directions: int, seconds: float) -> dict[str, Any]:
    """Of a call that takes so many seconds: operations per second, and operations per byte of arguments and results."""
    n, k = operations(solver, function, directions), directions
    moved = 8 * ((solver.nq + 2 * solver.nu + solver.ninputs) * (1 + k) + solver.np * k + 1)
    return {"name": name, "operations": n, "per_second": n / seconds, "per_byte": n / moved}


def points(solver: Solver, times: dict[str, Any]) -> list[dict[str, Any]]:
    """`point` for udot and sensitivities.

    Parameters
    ----------
    times : dict
        ``functions`` of `times.times`.
    """
    return [
        point(solver, name, function, k, times[name]["compiled"]["least"])
        for name, function, k in (
            ("udot", "accelerations", 0),
            ("udot + 1 direction", "sensitivities", 1),
            ("udot + 8 directions", "sensitivities", 8),
        )
    ]
