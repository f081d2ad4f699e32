"""The bytes of a file that a person names, up to a limit."""

from __future__ import annotations

from pathlib import Path

from .errors import ModelError, Problem


def read_bytes(path: str | Path, limit: int, needed: str, too_large: str) -> bytes:
    """The bytes of a file.

    Parameters
    ----------
    path : str or path
    limit : int
        Bytes; whole megabytes.
    needed, too_large : str
        What to say is needed where it cannot be read, and of one that is larger than the limit.

    Raises
    ------
    ModelError
        If it cannot be read or is too large.
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
