"""A file that is there as a whole or not at all, whatever happens while it is written."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

MARK = "ordernm wrote this file and may replace it"
"""Stands in files that commands write, so that they are known from files of other people."""


def suffix_among(path: str | os.PathLike[str], known: Collection[str], error: type[ValueError], said: str) -> str:
    """The suffix of a file, in small letters; an error that ends in what is said where it is none of those known."""
    found = Path(path).suffix.lower()
    if found not in known:
        seen = f"ends in {found}" if found else "has no suffix"
        raise error(f"{os.fspath(path)} {seen}; {said}")
    return found


def write_whole(path: Path, write: Callable[[Any], object]) -> None:
    """Let `write` fill a binary file beside its place, then put it there.

    A link to a file stays one. What fails leaves what was there before. What is no regular file, such as a pipe, is written to
    where it is.
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
        if isinstance(error, OSError) and error.filename == str(beside):  # which nobody has heard of
            error.filename, error.filename2 = str(path), None
        raise
