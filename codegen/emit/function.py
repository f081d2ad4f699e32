"""Functions and lists of the generated code."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Function:
    """A generated function: comment, signature, ready lines."""

    comment: str
    signature: str
    lines: list[str] = field(default_factory=list)


def in_lines(items: list[str], columns: int) -> list[str]:
    """Items, so many a line."""
    return [", ".join(items[i : i + columns]) + "," for i in range(0, len(items), columns)]
