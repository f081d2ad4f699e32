"""Functions and lists in generated code."""

from __future__ import annotations

import textwrap
from dataclasses import field

from ..records import dataclass

COMMENT = 115
"""Longest line of a comment."""


SIGNATURE = 115
"""Longest line of a declaration or call."""


@dataclass(slots=True)
class Function:
    """A generated function: title, signature, lines, comment, and the conditions under which it is compiled and declared."""

    comment: str
    signature: str
    lines: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    guard: str = ""
    declared: bool = False
    """Whether the function is declared even where it is not compiled."""
    before: list[str] = field(default_factory=list)
    """Lines before the function that are compiled even if the function's condition does not hold."""
    after: list[str] = field(default_factory=list)
    """Lines after the function that are compiled even if the function's condition does not hold."""

    @property
    def begin(self) -> list[str]:
        """Lines before the function, including its condition for compilation."""
        return [*self.before, *([f"#if {self.guard}"] if self.guard else [])]

    @property
    def end(self) -> list[str]:
        """Lines after the function, including the end of its condition for compilation."""
        declaration = ["#else", f"{self.signature};"] if self.declared else []
        return [*([*declaration, "#endif"] if self.guard else []), *self.after]

    @property
    def head(self) -> list[str]:
        """Lines of the whole comment above the function."""
        texts = (self.comment, *self.notes)
        return [x for t in texts for x in ([t.rstrip()] if len(t) <= COMMENT else textwrap.wrap(t, COMMENT))]


def called_with(head: str, items: list[str], end: str = ")") -> str:
    """A function call or declaration: a head and its arguments, wrapped."""
    lines = [head]
    for i, item in enumerate(items):
        item += end if i == len(items) - 1 else ","
        if len(lines[-1]) + len(item) > SIGNATURE and lines[-1] != head:
            lines.append(f"    {item}")
        else:
            lines[-1] += item if lines[-1] == head else f" {item}"
    return "\n".join(lines)


def in_lines(items: list[str], columns: int) -> list[str]:
    """The items of a list as lines, with a fixed number of items in each line."""
    return [", ".join(items[i : i + columns]) + "," for i in range(0, len(items), columns)]
