"""Reads the bytes of a file up to a size limit."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from .errors import ModelError, Problem, with_article


def file_name(given: Any, wanted: str, for_text: str) -> str:
    """The path of a file as text.

    Parameters
    ----------
    given : object
    wanted : str
        What is allowed, for messages about objects of other types.
    for_text : str
        Message for the text of a file in place of its path.

    Raises
    ------
    TypeError
        If an object of another type is given.
    ModelError
        If the text of a file is given.
    """
    if not isinstance(given, (str, os.PathLike)):
        raise TypeError(f"{with_article(type(given).__name__)} is given; {wanted} is needed")
    name = os.fspath(given)
    if "\n" in name:
        raise ModelError([Problem("<string>", None, None, "", for_text)])
    return name


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
