"""Names of symbols: in typeset equations, and as identifiers of Python."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable

import sympy

GREEK = frozenset(
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau phi chi psi omega "
    "Gamma Delta Theta Lambda Xi Pi Sigma Phi Psi Omega".split()
)
"""Words that are set as Greek letters."""

DOTTED = {"q": ("q", ""), "u": ("u", ""), "udot": ("u", "\\dot"), "lambda": ("lambda", "")}
"""First parts of dotted names: the letter, and what is above it."""


def parts_of(name: str) -> tuple[str, str, str]:
    """The base of a name, its subscript and its accent: ``q.crank`` is q with crank, ``length_1`` is length with 1."""
    first, dot, rest = name.partition(".")
    if dot and first in DOTTED:
        base, accent = DOTTED[first]
        return base, rest, accent
    base, _, rest = name.partition("_")
    digits = re.fullmatch(r"([A-Za-z]+)(\d+)", base)
    if digits:
        base, rest = digits[1], ",".join(filter(None, (digits[2], rest)))
    return (base, rest.replace("_", ","), "") if base else (name, "", "")


def latex_name(name: str) -> str:
    """A name in LaTeX."""
    base, below, accent = parts_of(name)
    letter = _word(base)
    if accent:
        letter = f"{accent}{{{letter}}}"
    return f"{letter}_{{{_word(below)}}}" if below else letter


def _word(text: str) -> str:
    if text in GREEK:
        return f"\\{text}"
    escaped = text.replace("_", "\\_")
    return escaped if len(text) == 1 or text.isdigit() else f"\\mathrm{{{escaped}}}"


def identifiers(symbols: Iterable[sympy.Symbol], taken: Iterable[str] = ()) -> dict[sympy.Symbol, str]:
    """Names for symbols that are identifiers of Python, none twice and none of those that are taken."""
    used, found = set(taken), {}
    for symbol in symbols:
        name = re.sub(r"\W", "_", symbol.name)
        while name in used or keyword.iskeyword(name):
            name += "_"
        used.add(name)
        found[symbol] = name
    return found


__all__ = ["GREEK", "identifiers", "latex_name", "parts_of"]
