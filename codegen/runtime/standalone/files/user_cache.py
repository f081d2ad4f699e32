"""The user's cache: folders that nobody else can write to, since what is found there is loaded and run."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

from ..warning import warn

PRIVATE = 0o700
"""Permissions of every folder that is made in the cache."""

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH

_warned: set[str] = set()


class CacheError(OSError):
    """A file or folder of the cache belongs to another user, or others can write to it."""


def user_cache() -> Path:
    """The folder of the cache, which need not exist.

    Raises
    ------
    RuntimeError
        The user has no home.
    """
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "ordernm"
    given = os.environ.get("XDG_CACHE_HOME", "")
    # a relative path would mean another cache in every working directory; the standard has it ignored
    return (Path(given) if os.path.isabs(given) else Path.home() / ".cache") / "ordernm"


def in_cache(place: Path) -> bool:
    """Whether a path lies in the user's cache."""
    try:
        return place.is_relative_to(user_cache())
    except RuntimeError:
        return False


def make_private(place: Path) -> Path:
    """Make a folder of the cache, with permissions 0700 whatever the umask is.

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
        It, or a folder above it in the cache, belongs to another user or can be written to by others.
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
    """Raise `CacheError` if another user owns, or can write to, a path of the cache or a folder above it in the cache.

    Parameters
    ----------
    place : Path
        A file or folder within `user_cache` that exists.
    """
    if not hasattr(os, "geteuid"):  # Windows has neither owners nor modes of this kind
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
            f"the cache is not used, since {part} {why} and what is in the cache is run; "
            f"remove {base}, which is then made anew for you alone"
        )


def trusted(place: Path) -> bool:
    """Whether a path may be used: one of the cache only if nobody else can write to it. Warns, once for each reason."""
    if not in_cache(place):
        return True
    try:
        refuse_writable(place)
    except CacheError as error:
        if str(error) not in _warned:
            _warned.add(str(error))
            warn(str(error))
        return False
    except OSError:  # gone meanwhile
        return False
    return True


__all__ = ["CacheError", "in_cache", "make_private", "refuse_writable", "trusted", "user_cache"]
