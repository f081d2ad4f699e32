"""Files written by commands: only files with ordernm's mark are replaced without ``--force``."""

from __future__ import annotations

import argparse
import mmap
from pathlib import Path

from .folders import FolderError, unwritable
from .runtime.standalone.files.whole_file import MARK

MARKS = (
    MARK.encode(), b"ordernm wrote this file, and replaces it when told to write it again", b'"format": "ordernm trajectory"',
)  # fmt: skip
"""Texts by which files of ordernm are recognised: the current mark, the former mark, and the mark of trajectories."""


def add_force(parser: argparse.ArgumentParser) -> None:
    """Adds the option ``--force``."""
    parser.add_argument("--force", action="store_true", help="also replace files that ordernm did not write")


def refuse_foreign_file(path: Path, force: bool = False, option: str = "--force") -> None:
    """Raises `FolderError` if a file cannot be written, or is not from ordernm.

    Parameters
    ----------
    path : Path
        The file to write. Empty files and special files (``/dev/null``, a pipe) may be written to.
    force : bool
        Whether to accept any content.
    option : str
        The option that replaces foreign files, for the message.
    """
    why_not = unwritable(path)
    if why_not is not None:
        raise FolderError(why_not)
    if not force and not is_own(path):
        raise FolderError(f"{path} exists, and ordernm did not write it; give another name, or {option} to replace it")


def is_own(path: Path) -> bool:
    """Whether a file may be replaced without loss: it is absent, empty, not a regular file, or has ordernm's mark."""
    if not path.is_file() or path.stat().st_size == 0:
        return True
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return any(content.find(mark) >= 0 for mark in MARKS)


__all__ = ["add_force", "is_own", "refuse_foreign_file"]
