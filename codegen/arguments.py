"""Types of the arguments of commands."""

from __future__ import annotations

import argparse

from .wording import decimal_comma


def number(text: str) -> float:
    """The number that an argument gives.

    Raises
    ------
    argparse.ArgumentTypeError
        If the text is not a number.
    """
    try:
        return float(text)
    except ValueError:
        hint = decimal_comma(text) or "; give a number without a unit, such as 0.6"
        raise argparse.ArgumentTypeError(f"{text!r} is not a number{hint}") from None
