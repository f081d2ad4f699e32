"""Names of symbols: in typeset equations, and as identifiers of Python."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable

import sympy

GREEK_LETTERS = dict(
    zip(
        "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau phi chi psi omega "
        "Gamma Delta Theta Lambda Xi Pi Sigma Phi Psi Omega".split(),
        "αβγδεζηθικλμνξπρστφχψωΓΔΘΛΞΠΣΦΨΩ",
        strict=True,
    )
)
"""Words that are typeset as Greek letters."""

ARGUMENTS = {"q": "q", "u": "u", "lambda": "lambda", "tau": "tau", "b": "b", "p": ""}
"""First parts of dotted names, each with its typeset letter; names of parameters have no such part."""


def parts_of(name: str) -> tuple[str, str, bool, bool]:
    """The base and the subscript of a name; whether it is a time derivative; whether it is a derivative along a direction.

    ``q.crank`` is q with crank, ``length_1`` is length with 1, ``dudot.crank`` is u with crank, and both are true.
    """
    first, dot, rest = name.partition(".")
    is_seed = bool(dot) and first.startswith("d") and first[1:].removesuffix("dot") in ARGUMENTS
    argument = first[1:] if is_seed else first
    is_rate = argument.endswith("dot")
    argument = argument.removesuffix("dot")
    if dot and ARGUMENTS.get(argument):
        return ARGUMENTS[argument], rest, is_rate, is_seed
    base, _, below = (rest if is_seed else name).partition("_")
    digits = re.fullmatch(r"([A-Za-z]+)(\d+)", base)
    if digits:
        base, below = digits[1], ",".join(filter(None, (digits[2], below)))
    return (base, below.replace("_", ","), False, is_seed) if base else (name, "", False, is_seed)


def latex_name(name: str) -> str:
    """The typeset form of a name, in LaTeX."""
    base, below, is_rate, is_seed = parts_of(name)
    letter = latex_word(base)
    if is_rate:
        letter = f"\\dot{{{letter}}}"
    return ("\\delta " if is_seed else "") + (f"{letter}_{{{latex_word(below)}}}" if below else letter)


def latex_word(text: str) -> str:
    """A word for typesetting: letters slanted, words upright, Greek words as letters."""
    if text in GREEK_LETTERS:
        return f"\\{text}"
    escaped = text.replace("_", "\\_")
    return escaped if len(text) == 1 or text.isdigit() else f"\\mathrm{{{escaped}}}"


def unused_prefix(letter: str, names: Iterable[str]) -> str:
    """A prefix made by repeating the letter, so that no name consists of the prefix and a number."""
    prefix, known = letter, list(names)
    while any(name.startswith(prefix) and name[len(prefix) :].isdigit() for name in known):
        prefix += letter
    return prefix


def identifiers(symbols: Iterable[sympy.Symbol], taken: Iterable[str] = ()) -> dict[sympy.Symbol, str]:
    """Identifiers of Python for symbols: all different, and none already taken."""
    used, found = set(taken), {}
    for symbol in symbols:
        name = re.sub(r"\W", "_", symbol.name)
        while name in used or keyword.iskeyword(name):
            name += "_"
        used.add(name)
        found[symbol] = name
    return found


__all__ = ["GREEK_LETTERS", "identifiers", "latex_name", "latex_word", "parts_of", "unused_prefix"]
