"""Writes a file completely or not at all, even after an error."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

MARK = "ordernm wrote this file and may replace it"
"""The mark of files written by commands, which distinguishes them from a user's own files."""


def suffix_among(path: str | os.PathLike[str], known: Collection[str], error: type[ValueError], said: str) -> str:
    """The suffix of a file in lower case; if it is not in `known`, `error` is raised with the text `said`."""
    found = Path(path).suffix.lower()
    if found not in known:
        seen = f"ends in {found}" if found else "has no suffix"
        raise error(f"{os.fspath(path)} {seen}; {said}")
    return found


def write_whole(path: Path, write: Callable[[Any], object]) -> None:
    """Lets `write` fill a temporary binary file, then moves it to `path`.

    A symbolic link is kept. After an error, the previous content is still there. Pipes and the like are written directly.
    """
    path = path.resolve()
    if path.exists() and not path.is_file():
        with open(path, "wb") as file:
            write(file)
        return
    beside = path.with_name(f".{path.name[:100]}-{os.urandom(4).hex()}.part")
    try:
        with open(beside, "xb") as file:
            write(file)
        os.replace(beside, path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            beside.unlink()
        if isinstance(error, OSError) and error.filename == str(beside):  # the error must name the user's path
            error.filename, error.filename2 = str(path), None
        raise
