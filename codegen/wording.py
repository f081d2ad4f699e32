"""Parts of messages that all layers share: counted nouns, and hints for misspelt names."""

from __future__ import annotations

import re
from collections.abc import Iterable

_LONG, _MANY = 100, 1000

DECIMAL_POINT = "; a decimal point is written ., as in 0.6"
"""A hint for numbers that seem to have a decimal comma."""

_DECIMAL_COMMA = re.compile("[0-9],[0-9]")


def decimal_comma(text: str) -> str:
    """A hint if a text has a comma between two digits; otherwise empty."""
    return DECIMAL_POINT if _DECIMAL_COMMA.search(text) else ""


def counted(n: int, one: str, many: str = "") -> str:
    """A number with its noun: ``1 body``, ``2 bodies``."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def with_article(what: str) -> str:
    """The noun with its article: ``an input``, ``a body``."""
    return f"an {what}" if what[0] in "aeiou" else f"a {what}"


def similar(name: object, known: Iterable[str], cutoff: float = 0.6) -> str | None:
    """The known name that is most similar to a misspelt one; None if no known name is similar.

    Names that differ only in upper and lower case come first.

    Parameters
    ----------
    name : object
        The misspelt name. Its text is compared.
    known : iterable of str
    cutoff : float
        Smallest similarity, from 0 to 1.
    """
    from difflib import get_close_matches  # for messages of errors only

    text, listed = str(name), list(known)
    if len(text) > _LONG:
        return None
    if same := next((n for n in listed if n.lower() == text.lower()), None):
        return same
    if len(listed) > _MANY:  # a comparison with all names would take too long
        listed = [n for n in listed if n[:2] == text[:2] and abs(len(n) - len(text)) <= 2][:_MANY]
    lower = {n.lower(): n for n in reversed(listed)}
    found = get_close_matches(text, listed, 1, cutoff)
    return next(iter(found or [lower[n] for n in get_close_matches(text.lower(), lower, 1, cutoff)]), None)


def nearest(name: object, known: Iterable[str], cutoff: float = 0.6) -> str:
    """The hint ``; did you mean 'mass'?`` for a misspelt name; empty if no known name is similar."""
    found = similar(name, known, cutoff)
    return f"; did you mean {found!r}?" if found is not None else ""
