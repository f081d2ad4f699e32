"""Whether a person watches a stream: a terminal, or the cell of a notebook."""

from __future__ import annotations

import os
import sys
from typing import Any, TextIO

SILENT = ("0", "off", "no")
"""Values of ``ORDERNM_PROGRESS`` that turn progress off."""


def is_terminal(stream: TextIO | Any) -> bool:
    """Whether the stream is a terminal."""
    try:
        return bool(stream.isatty())
    except (AttributeError, ValueError):  # the stream has been replaced or closed
        return False


def can_move(stream: TextIO | Any) -> bool:
    """Whether a line can be erased on the stream."""
    return (
        is_terminal(stream) and os.environ.get("TERM", "dumb") not in ("dumb", "unknown") and not os.environ.get("CI")
    )


def in_notebook() -> bool:
    """Whether the program runs in a notebook."""
    return "ipykernel" in sys.modules


def is_watched(stream: TextIO | Any) -> bool:
    """Whether a person sees progress: on a terminal whose lines can be erased, or in a notebook, unless it is turned
    off."""
    if os.environ.get("ORDERNM_PROGRESS", "").lower() in SILENT:
        return False
    return can_move(stream) or in_notebook()
