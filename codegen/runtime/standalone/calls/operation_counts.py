"""Operation counts that print as a table."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ....html_tables import html_of

COLUMNS = ("additions", "multiplications", "divisions", "functions")


class OperationCounts(dict[str, Any]):
    """Operations by function and sweep, as `Solver.operations` returns them; printed as sums per function."""

    def _rows(self) -> list[tuple[str, list[int]]]:
        """Names of functions, and the sums of their operations."""
        parts = {
            (name, part): _sums(of[part] for of in sweeps.values() if part in of)
            for name, sweeps in self.items()
            for part in ("per_call", "per_direction")
        }
        return [
            (f"{name}, per direction" if part != "per_call" else name, s) for (name, part), s in parts.items() if any(s)
        ]

    def __repr__(self) -> str:
        rows = self._rows()
        width = max((len(name) for name, _ in rows), default=0)
        head = f"{'operations':{width}s} {'all':>8} " + " ".join(f"{c:>15}" for c in COLUMNS)
        return "\n".join(
            [head, *(f"{name:{width}s} {sum(s):8d} " + " ".join(f"{n:15d}" for n in s) for name, s in rows)]
        )

    def _repr_html_(self) -> str:
        return html_of([], ("operations", "all", *COLUMNS), ((name, sum(s), *s) for name, s in self._rows()))


def _sums(counts: Iterable[dict[str, int]]) -> list[int]:
    counts = list(counts)
    return [sum(c.get(column, 0) for c in counts) for column in COLUMNS]
