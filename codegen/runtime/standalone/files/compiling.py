"""Reports on a terminal or in a notebook that a call waits for a compiler, and adds up the waiting times."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator

from .watched import is_watched

PATIENCE = 1.0
"""Waiting time before the first report, s."""


class _Waited(threading.local):
    seconds = 0.0


_waited = _Waited()


def seconds_waited() -> float:
    """Seconds that calls of this thread have waited for a compiler so far."""
    return _waited.seconds


def _say(what: str) -> None:
    print(f"compiling {what}; the library is kept for later calls", file=sys.stderr, flush=True)


_say_to: Callable[[str], None] | None = _say


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Suppresses the report of waiting; used by commands that show their own progress."""
    global _say_to
    before, _say_to = _say_to, None
    try:
        yield
    finally:
        _say_to = before


@contextlib.contextmanager
def waiting(what: str) -> Iterator[None]:
    """A context in which `what` is compiled."""
    timer = threading.Timer(PATIENCE, _say_to, [what]) if _say_to is not None and is_watched(sys.stderr) else None
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
