"""What a terminal needs and a pipe does not: colour, lines of its width, and one line that says what is being done."""

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
"""Seconds after which a terminal says what takes so long."""
FRAMES = "|/-\\"
BAR = 24
"""Characters of a bar that shows how much is done."""
STYLES = {"bold": 1, "warning": 33}


def is_terminal(stream: TextIO | Any) -> bool:
    """Whether a person may be looking at what is written there."""
    try:
        return bool(stream.isatty())
    except (AttributeError, ValueError):  # somebody's own stream, or a closed one
        return False


def can_move(stream: TextIO | Any) -> bool:
    """Whether a line there can be taken back."""
    return (
        is_terminal(stream) and os.environ.get("TERM", "dumb") not in ("dumb", "unknown") and not os.environ.get("CI")
    )


def can_colour(stream: TextIO | Any) -> bool:
    """Whether colours are shown there, and are not forbidden by ``NO_COLOR``."""
    return can_move(stream) and not os.environ.get("NO_COLOR")


def width(stream: TextIO | Any) -> int | None:
    """Columns of a terminal; None for a file or pipe, whose lines are as long as they are."""
    if not is_terminal(stream):
        return None
    return max(20, shutil.get_terminal_size().columns)


def wrapped(line: str, columns: int | None) -> list[str]:
    """A line broken between words into lines of at most `columns`; later ones are indented further."""
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
    """Print lines, broken between words where a terminal ends, the first of them in the styles given (see `STYLES`)."""
    columns, colour = width(stream), can_colour(stream)
    for line, style in itertools.zip_longest(lines, styles, fillvalue=""):
        for part in wrapped(line, columns):
            print(f"\x1b[{STYLES[style]}m{part}\x1b[0m" if style and colour else part, file=stream)


class StatusLine:
    """One line of a terminal that says what is being done, after `PATIENCE` seconds; it is removed at the end.

    Call it as `codegen.generate` calls ``progress``. Where nobody looks it only remembers, for `where`.

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
        """Say what is being done, and which part of it is done, from 0 to 1: a bar shows it."""
        self(stage, 0, 0)
        self._share = min(1.0, max(0.0, share))

    @property
    def where(self) -> str:
        """``expanding, 3 of 21``."""
        return self.stage + (f", {self.step} of {self.steps}" if self.steps > 1 else "")

    def __enter__(self) -> StatusLine:
        if self._timer is not None:
            self._timer.daemon = True
            self._timer.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Take the line away."""
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
