"""Plain data written as the text of a model file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

from .words import WIDTH

_PLAIN: Final = re.compile(r"[A-Za-z0-9_.(+\-][A-Za-z0-9_.()+\-*/ <>=]*")
_PI: Final = re.compile(r"(?<![\d.])3\.141592653589793(?!\d)")


def model_text(head: Sequence[str], sections: Mapping[str, Any]) -> str:
    """The text of a model.

    Parameters
    ----------
    head : sequence of str
        Lines of the comment at the top.
    sections : mapping
        Sections in their order, with texts and numbers as values.
    """
    lines = [f"# {line}".rstrip() for line in head]
    for key, value in sections.items():
        if isinstance(value, Mapping):
            lines += ["", f"{key}:"]
            for name, entry in value.items():
                one = f"  {name}: {_flow(entry)}"
                lines += [one] if len(one) <= WIDTH or not isinstance(entry, Mapping) else _block(name, entry)
        elif value not in (None, []):
            lines.append(f"{key}: {_flow(value)}")
    return "\n".join(lines) + "\n"


def _block(name: str, entry: Mapping[str, Any]) -> list[str]:
    """The lines of an entry, one for each key."""
    return [f"  {name}:", *(f"    {key}: {_flow(value)}" for key, value in entry.items())]


def _flow(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_flow, value))}]"
    text = _PI.sub("pi", str(value))
    return text if _PLAIN.fullmatch(text) else f'"{text}"'
