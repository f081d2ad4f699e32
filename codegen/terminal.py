"""Output for terminals: colour, line width, and a status line."""

from __future__ import annotations

import contextlib
import itertools
import os
import shutil
import textwrap
import threading
import time
from collections.abc import Iterable
from typing import Any, TextIO

PATIENCE = 2.0
"""Seconds after which a terminal shows the status line."""
FRAMES = "|/-\\"
BAR = 24
"""Number of characters of the progress bar."""
STYLES = {"bold": 1, "warning": 33}


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


def can_colour(stream: TextIO | Any) -> bool:
    """Whether the stream shows colours, unless ``NO_COLOR`` forbids them."""
    return can_move(stream) and not os.environ.get("NO_COLOR")


def width(stream: TextIO | Any) -> int | None:
    """Columns of a terminal; None for files and pipes, whose lines are not wrapped."""
    if not is_terminal(stream):
        return None
    return max(20, shutil.get_terminal_size().columns)


def wrapped(line: str, columns: int | None) -> list[str]:
    """Wraps a line between words at `columns`; continuation lines have a larger indent."""
    if columns is None or len(line) <= columns:
        return [line]
    indent = " " * min(len(line) - len(line.lstrip()) + 4, columns // 2)
    return textwrap.wrap(
        line,
        columns,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
        replace_whitespace=False,
    )


def write_lines(lines: Iterable[str], stream: TextIO | Any, styles: Iterable[str] = ()) -> None:
    """Prints lines, which are wrapped on terminals; the first lines have the given styles (see `STYLES`)."""
    columns, colour = width(stream), can_colour(stream)
    for line, style in itertools.zip_longest(lines, styles, fillvalue=""):
        for part in wrapped(line, columns):
            print(f"\x1b[{STYLES[style]}m{part}\x1b[0m" if style and colour else part, file=stream)


class StatusLine:
    """A line on a terminal that shows the current work after `PATIENCE` seconds, and is erased at the end.

    Call it like ``progress`` of `codegen.generate`. Without a terminal it only stores the state, for `where`.

    Parameters
    ----------
    stream : file
    """

    def __init__(self, stream: TextIO | Any):
        self.stream = stream
        self.stage, self.step, self.steps = "", 0, 0
        self._share: float | None = None
        self._begun = time.monotonic()
        self._live: Any = None
        self._over = False
        self._lock = threading.Lock()
        self._timer = threading.Timer(PATIENCE, self._show) if can_move(stream) else None

    def __call__(self, stage: str, step: int, steps: int) -> None:
        self.stage, self.step, self.steps, self._share = stage, step, steps, None

    def share(self, stage: str, share: float) -> None:
        """Shows the current work with a progress bar; `share` is from 0 to 1."""
        self(stage, 0, 0)
        self._share = min(1.0, max(0.0, share))

    @property
    def where(self) -> str:
        """The current stage as text, such as ``expanding, 3 of 21``."""
        return self.stage + (f", {self.step} of {self.steps}" if self.steps > 1 else "")

    def __enter__(self) -> StatusLine:
        if self._timer is not None:
            self._timer.daemon = True
            self._timer.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Erases the status line."""
        if self._timer is not None:
            self._timer.cancel()
        with self._lock:
            self._over = True
            if self._live is not None:
                self._live.stop()

    def _show(self) -> None:
        from rich.console import Console
        from rich.live import Live

        with self._lock, contextlib.suppress(OSError):
            if self._over:
                return
            console = Console(
                file=self.stream, force_terminal=True, no_color=not can_colour(self.stream), highlight=False
            )
            self._live = Live(
                console=console, get_renderable=self._line, refresh_per_second=5, transient=True,
                redirect_stdout=False, redirect_stderr=False,
            )  # fmt: skip
            self._live.start(refresh=True)

    def _line(self) -> Any:
        from rich.text import Text

        seconds = time.monotonic() - self._begun
        share = self._share
        bar = "" if share is None else f" [{'#' * int(BAR * share):-<{BAR}}] {int(100 * share)}%"
        text = f"{FRAMES[int(5 * seconds) % len(FRAMES)]} {self.where}{bar} ({seconds:.0f} s)"
        return Text(text, no_wrap=True, overflow="crop")
