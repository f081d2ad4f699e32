"""Functions and lists of the generated code."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field

COMMENT = 115
"""How long lines of comments are."""


@dataclass(slots=True)
class Function:
    """A generated function: comment, signature, ready lines; further lines of the comment."""

    comment: str
    signature: str
    lines: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def head(self) -> list[str]:
        """Lines of the whole comment."""
        return [line for text in (self.comment, *self.notes) for line in textwrap.wrap(text, COMMENT) or [""]]


def in_lines(items: list[str], columns: int) -> list[str]:
    """Items, so many a line."""
    return [", ".join(items[i : i + columns]) + "," for i in range(0, len(items), columns)]
