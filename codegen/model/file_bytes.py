"""Reads the bytes of a file up to a size limit."""

from __future__ import annotations

from pathlib import Path

from .errors import ModelError, Problem


def read_bytes(path: str | Path, limit: int, needed: str, too_large: str) -> bytes:
    """Read the bytes of a file.

    Parameters
    ----------
    path : str or path
    limit : int
        Largest size in bytes; a whole number of megabytes.
    needed, too_large : str
        Ends of the messages about files that cannot be read, and about files above the limit.

    Raises
    ------
    ModelError
        If the file cannot be read or is too large.
    """
    file = str(path)
    try:
        with open(path, "rb") as stream:
            data = stream.read(limit + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ModelError([Problem(file, 1, 1, "", f"cannot be read: {reason}; {needed}")]) from None
    if len(data) > limit:
        raise ModelError([Problem(file, 1, 1, "", f"is larger than {limit >> 20} MB; {too_large}")])
    return data
