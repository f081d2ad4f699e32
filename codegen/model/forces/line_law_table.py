"""The table of laws along a line in the documentation.

``python -m codegen.model.forces.line_law_table docs/model_format.md`` updates it in the page.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from .line_law import Coefficient
from .line_laws import LINE_LAWS

BEGIN: Final = (
    "<!-- laws along a line: written by python -m codegen.model.forces.line_law_table docs/model_format.md -->\n"
)
END: Final = "<!-- end of the laws along a line -->\n"


def table() -> str:
    """The table in Markdown: the lines between `BEGIN` and `END`."""
    lines = ["| type | what it is | keys | force, N | energy, J |", "| --- | --- | --- | --- | --- |"]
    for law in LINE_LAWS.values():
        keys = "; ".join(_words(key, c) for key, c in law.coefficients.items())
        energy = f"`{law.energy}`" if law.energy else "none"
        lines.append(f"| `{law.type}` | {law.meaning} | {keys} | `{law.force}` | {energy} |")
    return "\n".join([*lines, ""])


def with_table(page: str) -> str:
    """The text of a page with its table updated.

    Raises
    ------
    ValueError
        If the page has no place for the table.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"the page has no lines\n{BEGIN}{END}to enclose the table; add them")
    return before + begin + table() + end + after


def _words(key: str, c: Coefficient) -> str:
    left_out = "" if c.default is None else f" (left out: {c.default})"
    return f"`{key}`, {c.unit}: {c.meaning}{left_out}"


if __name__ == "__main__":
    for name in sys.argv[1:]:
        Path(name).write_text(with_table(Path(name).read_text(encoding="utf-8")), encoding="utf-8")
