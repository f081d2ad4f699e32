"""Says on a terminal, or in a notebook, what a call waits for while it is compiled, and counts how long."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator

PATIENCE = 1.0
"""Seconds after which it is said."""


class _Waited(threading.local):
    seconds = 0.0


_waited = _Waited()


def seconds_waited() -> float:
    """Seconds that calls of this thread have waited for a compiler, since it began."""
    return _waited.seconds


def _say(what: str) -> None:
    print(f"compiling {what}: once, the library is kept", file=sys.stderr, flush=True)


def _is_watched() -> bool:
    """Whether a person may be looking: at a terminal, or at a cell of a notebook."""
    try:
        return "ipykernel" in sys.modules or bool(sys.stderr.isatty())
    except (AttributeError, ValueError):  # somebody's own stream, none, or a closed one
        return False


_say_to: Callable[[str], None] | None = _say


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Around what says itself what it does, such as a command with a status line."""
    global _say_to
    before, _say_to = _say_to, None
    try:
        yield
    finally:
        _say_to = before


@contextlib.contextmanager
def waiting(what: str) -> Iterator[None]:
    """Around the compiling of `what`."""
    timer = threading.Timer(PATIENCE, _say_to, [what]) if _say_to is not None and _is_watched() else None
    began = time.perf_counter()
    if timer is not None:
        timer.daemon = True
        timer.start()
    try:
        yield
    finally:
        if timer is not None:
            timer.cancel()
        _waited.seconds += time.perf_counter() - began
