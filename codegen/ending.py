"""The end of a command: exit codes, and signals, which are deferred while the command writes its results."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Iterator
from types import FrameType

OK, MODEL_WRONG, USAGE, COMPILING_FAILED, NUMBERS_FAILED = 0, 1, 2, 3, 4
SIGNALLED = 128
"""The exit code of a command that a signal ended is this number plus the number of the signal."""

REPEATED = 1.0
"""Seconds within which a further signal is ignored, because ``timeout`` signals a process and then its group."""


class Failure(Exception):
    """An error message of a command; the command's name precedes it.

    Attributes
    ----------
    code : int
        The exit code.
    """

    code = USAGE


class Terminated(KeyboardInterrupt):
    """Raised when a signal requests the end of the process.

    Attributes
    ----------
    number : int
    """

    def __init__(self, number: int):
        super().__init__(number)
        self.number = number


class Ending:
    """Handles signals that request the end of a command.

    Attributes
    ----------
    received : list of int
        Numbers of the received signals.
    deferred : bool
        Whether signals are only recorded.
    """

    def __init__(self) -> None:
        self.received: list[int] = []
        self.deferred = False
        self._last = -REPEATED

    def handle(self, number: int, frame: FrameType | None) -> None:
        """The signal handler: raises `Terminated`, unless signals are deferred or the signal repeats the previous one."""
        now = time.monotonic()
        repeated, self._last = now - self._last < REPEATED, now
        self.received.append(number)
        if not self.deferred and not repeated:
            raise Terminated(number)

    @contextlib.contextmanager
    def handling(self) -> Iterator[Ending]:
        """Handles the signals that request an end, except signals that are ignored or handled already."""
        usual = {
            signal.SIGTERM: signal.SIG_DFL,
            signal.SIGHUP: signal.SIG_DFL,
            signal.SIGINT: signal.default_int_handler,
        }
        before = {}
        with contextlib.suppress(ValueError):  # outside the main thread, the application has its own handlers
            for number, handler in usual.items():
                if signal.getsignal(number) == handler:  # nohup lets a process ignore this signal, which stays ignored
                    before[number] = signal.signal(number, self.handle)
        try:
            yield self
        finally:
            for number, kept in before.items():
                signal.signal(number, kept)


__all__ = ["Ending", "Failure", "Terminated"]
