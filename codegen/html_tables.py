"""Text and small tables as HTML, for notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice
from numbers import Real
from typing import Any

SHOWN = 20
"""Maximum number of rows of a table."""


LONGEST = 200
"""Maximum number of characters in a cell; longer texts are cut."""


class Markup(str):
    """Text that already is HTML."""

    __slots__ = ()


def html_of(
    lines: Iterable[str], head: Sequence[str] = (), rows: Iterable[Sequence[Any]] = (), shown: int = SHOWN
) -> str:
    """HTML of lines of text and a table of the first rows; texts are escaped, and numbers have six digits."""
    from html import escape  # imported when it is used, since it takes a millisecond

    text = "<br>".join(escape(line.strip()) for line in lines)
    rows = iter(rows)
    body = [f"<tr>{''.join(map(_cell, row))}</tr>" for row in islice(rows, shown)]
    if left := sum(1 for _ in rows):
        body.append(f"<tr><td colspan='{len(head)}' style='text-align:left'>and {left} more</td></tr>")
    title = "".join(f"<th>{escape(word)}</th>" for word in head)
    table = f"<table><thead><tr>{title}</tr></thead><tbody>{''.join(body)}</tbody></table>" if body else ""
    return f"<div><p>{text}</p>{table}</div>"


def _cell(x: Any) -> str:
    from html import escape

    if isinstance(x, Markup):
        return f"<td>{x}</td>"
    if isinstance(x, str):
        text = x if len(x) <= LONGEST else f"{x[:LONGEST]} ..."
        return f"<td style='text-align:left'>{escape(text)}</td>"
    return f"<td>{'' if x is None else escape(f'{x:.6g}' if isinstance(x, Real) else str(x))}</td>"


def shapes_of(arrays: Iterable[tuple[str, Any]]) -> list[tuple[str, str, float]]:
    """Rows with the name, shape and largest magnitude of each array that is not None."""
    return [(name, str(x.shape), abs(x).max(initial=0.0)) for name, x in arrays if x is not None]


def shapes_text(arrays: Iterable[tuple[str, Any]]) -> str:
    """Names and shapes of all arrays that are not None."""
    return ", ".join(f"{name} {x.shape}" for name, x in arrays if x is not None)
