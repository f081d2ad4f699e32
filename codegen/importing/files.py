"""Where the files are that a robot's file names: ``package://``, ``model://``, ``file://``, or a path beside it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote


class Files:
    """Finds files that a robot's file names.

    Parameters
    ----------
    file : path or None
        The robot's file; None for a text.
    package_paths : sequence of path
        Folders of packages, or packages; searched first, then those of ``ROS_PACKAGE_PATH``, then the folders above the file.
    """

    def __init__(self, file: Path | None, package_paths: Sequence[str | os.PathLike[str]] = ()) -> None:
        self.folder = file.resolve().parent if file is not None else None
        from_ros = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
        self.paths = [Path(p) for p in (*package_paths, *filter(None, from_ros))]

    def find(self, name: str) -> Path | None:
        """The file, or folder, of that name; None if there is none."""
        scheme, _, rest = name.partition("://")
        if not rest:
            return _existing(self.folder / name) if self.folder is not None and name else None
        rest = unquote(rest)
        if scheme == "file":
            return _existing(Path(rest))
        if scheme not in ("package", "model"):
            return None
        package, _, inside = rest.partition("/")
        for root in self.package_roots():
            for folder in (root / package, root) if root.name == package else (root / package,):
                found = _existing(folder / inside)
                if found is not None:
                    return found
        return None

    def package_roots(self) -> list[Path]:
        """Folders in which packages may stand."""
        above = [] if self.folder is None else [self.folder, *self.folder.parents]
        return [*self.paths, *above]

    def missing(self, name: str) -> str | None:
        """``not found: ...`` for a file that is not there."""
        if not name:
            return "without a file's name"
        if self.find(name) is not None:
            return None
        scheme, _, rest = name.partition("://")
        if scheme in ("package", "model") and rest:
            package = rest.partition("/")[0]
            if self.find(f"{scheme}://{package}/") is None:
                return f"package {package!r} not found (--package-path)"
        return "file not found"


def _existing(path: Path) -> Path | None:
    try:
        return path if path.exists() else None
    except (OSError, ValueError):  # a name that no file has
        return None
