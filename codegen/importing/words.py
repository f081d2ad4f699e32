"""Texts of numbers, vectors and comments in a model file."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from typing import Final

from .placement import Three, pi_text

WIDTH: Final = 118
"""Number of characters in a line of a comment."""


def number(value: float) -> str:
    """The shortest text of a number that is read without rounding; integers have no point."""
    if value == 0:
        return "0"
    if abs(value) < 1e15 and value == int(value):
        return str(int(value))
    text = repr(float(value))
    if "e" in text:
        digits, exponent = text.split("e")
        text = f"{digits}e{int(exponent)}"
    return text


def angle(value: float) -> str:
    """Text of an angle; an exact fraction of pi is written as one."""
    return pi_text(value) or number(value)


def vector(values: Iterable[float]) -> str:
    """Text of a vector, such as ``[0, 0, 0.5]``."""
    return f"[{', '.join(map(number, values))}]"


def axis_text(axis: Three) -> str:
    """Text of an axis: ``x``, ``-z``, or a vector."""
    along = [i for i in range(3) if axis[i] != 0]
    if len(along) == 1:
        return ("-" if axis[along[0]] < 0 else "") + "xyz"[along[0]]
    return vector(axis)


def one_line(text: str, longest: int = 80) -> str:
    """Text from a robot's file, shortened to one line for a comment."""
    text = text if text.isprintable() else repr(text)[1:-1]
    return text if len(text) <= longest else text[: longest - 3] + "..."


def wrapped(text: str, width: int = WIDTH) -> list[str]:
    """Lines of a comment; lines after the first are indented."""
    return textwrap.wrap(text, width, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False) or [""]
