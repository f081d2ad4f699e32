"""Locations of the files that a robot's file names, and the rules for reading these files.

Names are ``package://``, ``model://`` or ``file://`` addresses, or paths beside the file. A file is read only from the folder of
the robot's file, from folders inside it, or from the folders of ``--package-path``.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from .xml_reading import no_regular_file

WIDEN: Final = "--package-path"


class Files:
    """Finds files by the names in a robot's file.

    Parameters
    ----------
    file : path or None
        The robot's file; None for a text.
    package_paths : sequence of path
        Folders of packages, or packages. They are searched first, then ``ROS_PACKAGE_PATH``, then the folders above the file.
    """

    def __init__(self, file: Path | None, package_paths: Sequence[str | os.PathLike[str]] = ()) -> None:
        self.folder = file.resolve().parent if file is not None else None
        from_ros = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
        self.paths = [Path(p) for p in (*package_paths, *filter(None, from_ros))]
        own = [] if self.folder is None else [str(self.folder)]
        self.allowed = [*own, *(os.path.realpath(p) for p in package_paths)]

    def find(self, name: str, folder: Path | None = None) -> Path | None:
        """The file or folder with a name; None if it does not exist.

        Parameters
        ----------
        name : str
        folder : path, optional
            Start of relative paths; by default the folder of the robot's file.
        """
        scheme, _, rest = name.partition("://")
        start = self.folder if folder is None else folder
        if not rest:
            return _existing(start / name) if start is not None and name else None
        rest = unquote(rest)
        if scheme == "file":
            return _existing(Path(rest))
        if scheme not in ("package", "model"):
            return None
        package, _, inside = rest.partition("/")
        for root in self.package_roots():
            for place in (root / package, root) if root.name == package else (root / package,):
                found = _existing(place / inside)
                if found is not None:
                    return found
        return None

    def package_roots(self) -> list[Path]:
        """Folders that may contain packages."""
        above = [] if self.folder is None else [self.folder, *self.folder.parents]
        return [*self.paths, *above]

    def missing(self, name: str, folder: Path | None = None) -> str | None:
        """The reason why no file with a name was found; None if there is one."""
        if not name:
            return "without a file name"
        if self.find(name, folder) is not None:
            return None
        scheme, _, rest = name.partition("://")
        if scheme in ("package", "model") and rest:
            package = rest.partition("/")[0]
            if self.find(f"{scheme}://{package}/") is None:
                return f"package {package!r} not found (--package-path)"
        return "file not found"

    def forbidden(self, path: str | os.PathLike[str]) -> str | None:
        """The reason why an existing file may not be read; None if it may be read."""
        resolved = os.path.realpath(path)
        if not any(_is_within(resolved, folder) for folder in self.allowed):
            folder = resolved if os.path.isdir(resolved) else os.path.dirname(resolved)
            shown = min(folder, os.path.relpath(folder), key=len)
            return f"outside the folder of the robot's file; {WIDEN} {shown} permits reading files there"
        kind = no_regular_file(resolved)
        return None if kind is None else f"not read: {kind}; a regular file is needed"


def _is_within(path: str, folder: str) -> bool:
    try:
        return os.path.commonpath((path, folder)) == folder
    except ValueError:
        return False


def _existing(path: Path) -> Path | None:
    try:
        return path if path.exists() else None
    except (OSError, ValueError):  # the text cannot be a file name
        return None
