"""Output for terminals: colour, line width, and a status line."""

from __future__ import annotations

import contextlib
import functools
import importlib
import inspect
import itertools
import os
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, ParamSpec, TextIO, TypeVar

from .runtime.standalone.files.watched import can_move, is_terminal, is_watched

PATIENCE = 2.0
"""Seconds after which a terminal shows the status line."""
FRAMES = "|/-\\"
BAR = 24
"""Number of characters of the progress bar."""
STYLES = {"bold": 1, "warning": 33}

P = ParamSpec("P")
R = TypeVar("R")


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
        self._later: list[str] = []
        self._lock = threading.Lock()
        self._timer = threading.Timer(PATIENCE, self._show) if is_watched(stream) else None

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
            write_lines(self._later, self.stream)
            self._later = []

    def after(self, lines: str) -> None:
        """Prints lines as soon as the status line is erased."""
        with self._lock:
            self._later += lines.splitlines()
        if self._over:
            self.close()

    def _show(self) -> None:
        with self._lock, contextlib.suppress(OSError):
            if self._over:
                return
            if not can_move(self.stream):
                self._live = _Cell(self._line)
                return
            from rich.console import Console
            from rich.live import Live

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


class _Cell:
    """A line in the output of a notebook's cell. It shows the text of `line`, updated until `stop` clears it."""

    def __init__(self, line: Callable[[], Any]):
        display = importlib.import_module("IPython.display").display  # comes with every notebook
        self.line, self.over = line, threading.Event()
        self.output = display(self._content(str(line())), raw=True, display_id=True)
        threading.Thread(target=self._follow, daemon=True).start()

    @staticmethod
    def _content(text: str) -> dict[str, str]:
        return {"text/plain": text}

    def _follow(self) -> None:
        while not self.over.wait(0.5):
            self.output.update(self._content(str(self.line())), raw=True)

    def stop(self) -> None:
        self.over.set()
        self.output.update(self._content(""), raw=True)


_shown = threading.Lock()
"""Held while a call from Python shows its progress; calls within it show none."""


@contextlib.contextmanager
def shown() -> Iterator[StatusLine | None]:
    """A status line for a call from Python; None if no person would see it, and within a call that shows one already."""
    if not is_watched(sys.stderr) or not _shown.acquire(blocking=False):
        yield None
        return
    try:
        with StatusLine(sys.stderr) as status:
            yield status
    finally:
        _shown.release()


@contextlib.contextmanager
def working(stage: str) -> Iterator[None]:
    """Shows the work of a call from Python whose steps are not counted; also a decorator."""
    with shown() as status:
        if status is not None:
            status(stage, 0, 0)
        yield


def with_status(what: str = "") -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator of functions with an argument `progress`; if it is omitted, progress is shown where a person sees it.

    Parameters
    ----------
    what : str
        The work, for functions that call ``progress(step, steps)``; empty for ``progress(stage, step, steps)``.
    """

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        place = list(inspect.signature(function).parameters).index("progress")

        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            if len(args) > place or kwargs.get("progress") is not None:
                return function(*args, **kwargs)
            with shown() as status:
                if status is not None:
                    kwargs["progress"] = functools.partial(status, what) if what else status
                return function(*args, **kwargs)

        return call

    return decorated
