"""The user's cache for compiled libraries. Other users must not be able to write to this folder, because libraries in
it are executed."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

from ..warning import warn

PRIVATE = 0o700
"""Permissions of all folders created in the cache."""

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH

_warned: set[str] = set()


class CacheError(OSError):
    """Raised if a file or folder of the cache belongs to another user, or if other users can write to it."""


def user_cache() -> Path:
    """The path of the cache, which may not exist yet.

    Raises
    ------
    RuntimeError
        If the user has no home directory.
    """
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "ordernm"
    given = os.environ.get("XDG_CACHE_HOME", "")
    # the XDG standard ignores relative paths, which would give each working directory its own cache
    return (Path(given) if os.path.isabs(given) else Path.home() / ".cache") / "ordernm"


def in_cache(place: Path) -> bool:
    """Whether a path is in the user's cache."""
    try:
        return place.is_relative_to(user_cache())
    except RuntimeError:
        return False


def make_private(place: Path) -> Path:
    """Creates a folder in the cache with permissions 0700, independently of the umask.

    Parameters
    ----------
    place : Path
        A folder within `user_cache`.

    Returns
    -------
    Path
        The same folder.

    Raises
    ------
    CacheError
        If it, or a folder above it in the cache, belongs to another user or is writable by others.
    OSError
    """
    missing = []
    above = place
    while not above.exists():
        missing.append(above)
        above = above.parent
    for folder in reversed(missing):
        folder.mkdir(PRIVATE, exist_ok=True)
    refuse_writable(place)
    return place


def refuse_writable(place: Path) -> None:
    """Raises `CacheError` if a path, or a folder above it in the cache, belongs to another user or is writable by others.

    Parameters
    ----------
    place : Path
        An existing file or folder in `user_cache`.
    """
    if not hasattr(os, "geteuid"):  # on Windows, files have no such owners and modes
        return
    base = user_cache()
    for part in (base, *reversed([p for p in (place, *place.parents) if p.is_relative_to(base) and p != base])):
        own, target = part.lstat(), part.stat()
        if target.st_uid != os.geteuid() or own.st_uid != os.geteuid():
            why = f"belongs to user {(target if target.st_uid != os.geteuid() else own).st_uid}"
        elif target.st_mode & OTHERS_WRITE:
            why = f"can be written to by other users (mode {stat.S_IMODE(target.st_mode):04o})"
        else:
            continue
        raise CacheError(
            f"the cache is not used, because {part} {why}, and libraries in the cache are executed; "
            f"remove {base}, and ordernm creates it again for you alone"
        )


def trusted(place: Path) -> bool:
    """Whether a path may be used; other users must not be able to write to the cache. Warns once per reason."""
    if not in_cache(place):
        return True
    try:
        refuse_writable(place)
    except CacheError as error:
        if str(error) not in _warned:
            _warned.add(str(error))
            warn(str(error))
        return False
    except OSError:  # the path was removed in the meantime
        return False
    return True


__all__ = ["CacheError", "in_cache", "make_private", "refuse_writable", "trusted", "user_cache"]
