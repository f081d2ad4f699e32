"""How a command ends: its exit code, and signals that end it at once, except while it writes what it has computed."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Iterator
from types import FrameType

OK, MODEL_WRONG, USAGE, COMPILING_FAILED, NUMBERS_FAILED = 0, 1, 2, 3, 4
SIGNALLED = 128
"""To which the number of a signal is added."""

REPEATED = 1.0
"""Seconds within which a further signal says nothing new: ``timeout`` signals a process and then its group."""


class Failure(Exception):
    """A command that ends with a message, which the command's name precedes.

    Attributes
    ----------
    code : int
        The exit code.
    """

    code = USAGE


class Terminated(KeyboardInterrupt):
    """A signal asks the process to end.

    Attributes
    ----------
    number : int
    """

    def __init__(self, number: int):
        super().__init__(number)
        self.number = number


class Ending:
    """What handles signals to end while a command runs.

    Attributes
    ----------
    received : list of int
        Numbers of the signals that came.
    deferred : bool
        Signals are noted only.
    """

    def __init__(self) -> None:
        self.received: list[int] = []
        self.deferred = False
        self._last = -REPEATED

    def handle(self, number: int, frame: FrameType | None) -> None:
        """The handler: raises `Terminated` unless signals are deferred, or another one has just come."""
        now = time.monotonic()
        repeated, self._last = now - self._last < REPEATED, now
        self.received.append(number)
        if not self.deferred and not repeated:
            raise Terminated(number)

    @contextlib.contextmanager
    def handling(self) -> Iterator[Ending]:
        """Handle the signals that ask to end, but for those that somebody ignores or handles already."""
        usual = {
            signal.SIGTERM: signal.SIG_DFL,
            signal.SIGHUP: signal.SIG_DFL,
            signal.SIGINT: signal.default_int_handler,
        }
        before = {}
        with contextlib.suppress(ValueError):  # not in the main thread: whoever runs it there has handlers of their own
            for number, handler in usual.items():
                if signal.getsignal(number) == handler:  # nohup ignores one: that stays
                    before[number] = signal.signal(number, self.handle)
        try:
            yield self
        finally:
            for number, kept in before.items():
                signal.signal(number, kept)


__all__ = ["Ending", "Failure", "Terminated"]
