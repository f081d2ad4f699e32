"""The solver of ``ordernm simulate``: generated into a cache and used again."""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import os
import shutil
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from .terminal import StatusLine

if TYPE_CHECKING:
    from .model import Model
    from .runtime import Solver

KEPT = 20
"""Number of generated packages kept in the cache."""

SOURCES = (".py", ".jinja", ".c", ".h")
"""Suffixes of the generator's files that determine its output."""

NEEDED = ("numpy", "sympy", "scipy", "jinja2", "PyYAML", "pydantic")
"""Python packages whose versions affect generated files."""


def read(file: str, status: StatusLine) -> Model | Path:
    """The model in a file, or the solver in a generated folder."""
    from .model import load_model

    if Path(file).is_dir():
        return Path(file)
    status("reading", 0, 0)
    model = load_model(file)
    for remark in model.warnings:
        warnings.warn(str(remark), RuntimeWarning, stacklevel=1)
    return model


@contextlib.contextmanager
def solver_of(
    model: Model | Path, status: StatusLine, partitions: int = 1, frames: bool = False, reactions: bool = False
) -> Iterator[Solver]:
    """Yields the solver of a generated package, or of a model; the latter is generated into the cache, or reused from it.

    Without a cache that is safe from other users, a temporary folder is used.
    """
    from .runtime import load

    if isinstance(model, Path):
        status("loading", 0, 0)
        yield load(model)
        return
    with contextlib.ExitStack() as stack:
        folder = _cached(model, partitions, frames, reactions) or Path(
            stack.enter_context(tempfile.TemporaryDirectory(prefix="ordernm-", ignore_cleanup_errors=True)), model.name
        )
        _generate(model, folder, status, partitions, frames, reactions)
        status("loading", 0, 0)
        yield load(folder)


def _generate(model: Model, folder: Path, status: StatusLine, partitions: int, frames: bool, reactions: bool) -> None:
    """Generates and compiles the solver in a folder, unless it exists."""
    from .generation import generate
    from .runtime import PackageError
    from .runtime.standalone.files.manifest import check_files, read_manifest
    from .runtime.standalone.files.user_cache import trusted

    with contextlib.suppress(PackageError, OSError):
        if all(trusted(file) for file in folder.rglob("*")):
            check_files(folder, read_manifest(folder), ("",))
            os.utime(folder)  # marks the package as recently used
            return
    shutil.rmtree(folder, ignore_errors=True)  # generate would refuse a damaged folder
    mask = os.umask(0o077)
    try:
        generate(model, folder, progress=status, partitions=partitions, frames=frames, reactions=reactions)
    finally:
        os.umask(mask)
    _forget_old(folder.parent)


def _cached(model: Model, partitions: int, frames: bool, reactions: bool) -> Path | None:
    """The cache folder for the package of a model, or None if there is no cache. A warning gives the reason, unless the
    user has no home directory.

    The folder's name contains a digest of everything that affects the package: the model's files as read, the generator, the
    versions of Python packages, and the options. Names of compiled libraries contain flags, compiler and processor.
    """
    from .runtime.standalone.files.user_cache import make_private, user_cache

    key = hashlib.sha256(f"{model.digest} {partitions} {frames} {reactions}".encode())
    key.update(_generator())
    try:
        place = make_private(user_cache() / "simulated")
    except RuntimeError:  # this user has no home directory
        return None
    except OSError as error:
        warnings.warn(f"the solver is not kept for the next run: {error}", RuntimeWarning, stacklevel=1)
        return None
    if not os.access(place, os.W_OK | os.X_OK):
        warnings.warn(
            f"the solver is not kept for the next run: no permission to write in {place}", RuntimeWarning, stacklevel=1
        )
        return None
    return place / f"{model.name}-{key.hexdigest()[:16]}"


def _generator() -> bytes:
    """A digest of the generator's source files and of the versions of the packages that it needs."""
    package = Path(__file__).parent
    found = hashlib.sha256(sys.version.encode())
    for folder in (package, package.parent / "templates"):
        for file in sorted(folder.rglob("*")):
            if file.suffix in SOURCES:
                found.update(f"{file.relative_to(folder).as_posix()}\0".encode() + file.read_bytes())
    for name in NEEDED:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found.update(f"{name} {importlib.metadata.version(name)}\0".encode())
    return found.digest()


def _forget_old(place: Path) -> None:
    """Deletes all cached packages except the most recently used ones."""
    with contextlib.suppress(OSError):
        found = sorted((p for p in place.iterdir() if not p.name.startswith(".")), key=lambda p: p.stat().st_mtime)
        for old in found[:-KEPT]:
            shutil.rmtree(old, ignore_errors=True)
