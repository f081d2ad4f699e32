"""Files that tests keep for later runs, and the data on which the text of a solver depends besides its model."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import threading
from importlib.metadata import version
from pathlib import Path

ROOM = 1_000_000_000
"""Bytes of the files that are kept."""

CHECKOUT = Path(__file__).parents[1]
LIBRARIES = ("jinja2", "mpmath", "numpy")
"""What the generator computes and prints with."""


class Generator:
    """The files of the generator at the beginning of a run, before they are imported."""

    def __init__(self) -> None:
        folders = (CHECKOUT / "codegen", CHECKOUT / "templates")
        found = sorted(
            f for folder in folders for f in folder.rglob("*") if "__pycache__" not in f.parts and f.is_file()
        )
        self._files = [str(f) for f in (Path(__file__).with_name("once_a_run.py"), *found)]
        self._begun = self._times()
        content = hashlib.sha256(repr((sys.version, *map(version, LIBRARIES))).encode())
        for file in self._files:
            content.update(f"\0{os.path.relpath(file, CHECKOUT)}\0".encode())
            content.update(Path(file).read_bytes())
        self.key = content.hexdigest()

    def unchanged(self) -> bool:
        """Whether no file has changed since; otherwise nobody knows which text was imported, and nothing may be kept."""
        try:
            return self._times() == self._begun
        except FileNotFoundError:
            return False

    def _times(self) -> list[tuple[int, int]]:
        """Time of change and size of each file."""
        return [(s.st_mtime_ns, s.st_size) for s in map(os.stat, self._files)]


def make_room(kept: Path, room: int = ROOM) -> None:
    """Delete the least recently used files until the others fit into the limit."""
    files = []
    for file in kept.iterdir():
        with contextlib.suppress(FileNotFoundError):  # another process has just completed it
            status = file.stat()
            files.append((status.st_mtime, status.st_size, file))
    for _, size, file in sorted(files, reverse=True):
        room -= size
        if room < 0:
            file.unlink(missing_ok=True)


def used(file: Path) -> bool:
    """Whether a file is kept; its modification time becomes the time of its last use."""
    try:
        os.utime(file)
    except FileNotFoundError:
        return False
    return True


def put(file: Path, content: bytes) -> None:
    """Write a file so that other processes never see it incomplete."""
    part = file.with_name(f"{file.name}.{os.getpid()}.{threading.get_ident()}")
    part.write_bytes(content)
    part.replace(file)
