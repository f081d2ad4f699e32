"""Cells of tables, tables, and sections of pages, in Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Table:
    """A table as rows of text."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def markdown(self) -> list[str]:
        """The section's Markdown text."""
        return [
            *[f"### {self.title}"][: bool(self.title)],
            markdown(self.head, self.rows),
            *[self.note][: bool(self.note)],
        ]


@dataclass(frozen=True)
class Section:
    """A section of a page: paragraphs, names of figures, tables."""

    title: str
    text: Sequence[str]
    figures: Sequence[str] = ()
    tables: Sequence[Table] = ()


def error(x: float | None) -> str:
    """An error as text with two digits; empty for None."""
    return "" if x is None else f"{x:.1e}"


def number(x: float | None, digits: int = 3) -> str:
    """A number with few digits; a dash for None."""
    if x is None:
        return "-"
    return f"{x:.{digits}g}" if math.isfinite(x) else str(x)


def seconds(x: float) -> str:
    """A time, such as ``231 ns``, ``4.56 us``, ``1.2 ms``, ``3 s``."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if x >= size:
            return f"{x / size:.3g} {unit}"
    return f"{x / 1e-9:.3g} ns"


def markdown(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table in Markdown."""
    lines = (head, ["---"] * len(head), *rows)
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)
