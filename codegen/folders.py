"""The folder of a package: refused where it holds something else, replaced as a whole, put right after a kill.

A package is written beside its place, under a hidden name, and exchanged with what stands there in one step, so that there is a
package at any time. Where the system cannot exchange two folders, the old one is moved away first: a kill between the two moves
leaves it under its hidden name, and the next run moves it back. Whoever writes such a folder holds a lock on it, which the
system takes back when the process ends: so folders in use are known from leftovers.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import functools
import json
import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePath
from typing import Any

from .ending import Failure

OTHERS = ("_second", "_third", "_fourth")
"""What the names of files and C functions of further partitions have after the model's."""

ATTEMPTS = 20
"""Attempts to take a place that other processes take meanwhile."""


class FolderError(Failure, ValueError):
    """The output folder cannot be written, or holds something that `generate` did not write."""


def refuse_foreign(folder: Path, force: bool = False) -> list[str]:
    """Raise `FolderError` unless the folder is absent, empty, or an earlier output and nothing else.

    Parameters
    ----------
    folder : Path
    force : bool
        Whatever it holds; generated files are replaced then, and others stay.

    Returns
    -------
    list of str
        What is to stay.
    """
    try:
        if not folder.exists():
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                folder.stat()  # raises for a link that leads to itself, which `resolve` does before Python 3.13 only
            _refuse_unwritable(folder)
            return []
        if not folder.is_dir():
            raise FolderError(f"{folder} is a file; give a folder to write into with -o")
        here = Path.cwd()
        if folder.resolve() in (
            here,
            *here.parents,
        ):  # the folder is replaced as a whole: the shell would stand in nothing
            raise FolderError(f"{folder} is, or holds, the working directory; give a folder of its own with -o")
        manifest: Any = None
        with contextlib.suppress(OSError, ValueError, RecursionError):
            manifest = json.loads((folder / "model.json").read_text(encoding="utf-8"))
        listed = manifest.get("files", ()) if isinstance(manifest, dict) else ()
        listed = {str(n) for n in listed} if isinstance(listed, list) else set()
        found = list(_names(folder, {str(above) for n in listed for above in PurePath(n).parents}))
    except (OSError, RuntimeError) as error:  # a link that leads to itself
        raise FolderError(f"cannot write {folder}: {getattr(error, 'strerror', None) or error}") from None
    if not isinstance(manifest, dict) or manifest.get("generator") != "ordernm":
        if force or not found:
            return found
        raise FolderError(
            f"{folder} holds something that generate did not write; choose another folder with -o, or --force to replace "
            f"files of the same names and leave the others"
        )
    others = "|".join(OTHERS)
    own = re.compile(
        rf"{re.escape(str(manifest.get('name')))}({others})?(_precise|_four|_states|_threads)?(\.[a-z]+)?(-[0-9a-f-]+\.so|\.log)|motion/motion(-[0-9a-f-]+\.so|\.log)|ordernm_call-[0-9a-f-]+\.so|(.*/)?__pycache__|\.build-.*"
    )
    foreign = sorted(n for n in found if n not in listed and not own.fullmatch(n))
    if foreign and not force:
        raise FolderError(
            f"{folder} holds beside generated files {', '.join(foreign[:5])}{', ...' if len(foreign) > 5 else ''}, which "
            f"writing anew would lose; move that away, choose another folder with -o, or --force to leave it there"
        )
    return foreign


def unwritable(file: Path) -> str | None:
    """Why a file of that name cannot be written; None if nothing is known to stand in its way."""
    folder = file.resolve().parent
    if file.is_dir():
        return f"{file} is a folder; give the name of a file"
    if not folder.is_dir():
        return f"cannot write {file}: there is no folder {folder}"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"cannot write {file}: no permission to write in {folder}"
    return None


def _names(folder: Path, own: set[str], above: str = "") -> Iterator[str]:
    """What is in a folder; of its folders that a package has, such as those of the run time, what is in these."""
    for path in folder.iterdir():
        name = above + path.name
        if name in own and path.is_dir():
            yield from _names(path, own, f"{name}/")
        else:
            yield name


def _refuse_unwritable(folder: Path) -> None:
    """Raise `FolderError` where nothing can be put in the folder's place; better said before a minute's work than after it."""
    above = folder.resolve().parent
    while not above.exists():
        above = above.parent
    if not above.is_dir():
        raise FolderError(f"cannot write {folder}: {above} is a file; give a folder to write into with -o")
    if not os.access(above, os.W_OK | os.X_OK):
        raise FolderError(
            f"cannot write {folder}: no permission to write in {above}; choose another folder with -o, or change its permissions"
        )


def write_folder(folder: Path, files: dict[str, str], keep: Sequence[str] = ()) -> bool:
    """Write a package as a whole: it is complete beside its place before it takes it.

    A folder that holds these very files stays as it is, with its compiled library: False is returned. Where only files have
    changed that are not compiled, libraries are taken along; so is what else is to be kept, unless a file has its name.
    """
    folder = folder.resolve()  # a link to a folder stays one
    new = {name: text.encode() for name, text in files.items()}
    with contextlib.suppress(OSError):
        if all((folder / name).read_bytes() == content for name, content in new.items()):
            return False
    try:
        with _workshop(folder) as temporary:
            for name, content in new.items():
                (temporary / name).parent.mkdir(parents=True, exist_ok=True)
                (temporary / name).write_bytes(content)
            _keep_libraries(folder, temporary)
            _keep_others(folder, temporary, keep)
            _take_place(temporary, folder)
        return True
    except OSError as error:
        raise FolderError(f"cannot write {folder}: {error.strerror or error}") from None


def _keep_libraries(old: Path, new: Path) -> None:
    """Take compiled libraries along where the C has not changed."""
    not_compiled = {
        f"{source.stem}_model.h" for source in new.glob("*.c")
    }  # defaults and the initial state, for callers
    for source in new.glob("*.[ch]"):
        if source.name in not_compiled:
            continue
        before = old / source.name
        if not before.is_file() or before.read_bytes() != source.read_bytes():
            return
    for library in old.glob("*.so"):
        with contextlib.suppress(OSError):
            shutil.copy2(library, new / library.name)


def _keep_others(old: Path, new: Path, names: Sequence[str]) -> None:
    """Take files and folders along, but for those that are there anew."""
    for name in names:
        source, target = old / name, new / name
        if os.path.lexists(target) and not source.is_dir():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir() and not source.is_symlink():
            _keep_others(source, target, [p.name for p in source.iterdir()])
        else:
            shutil.copy2(source, target, follow_symlinks=False)


def put_right(folder: Path) -> None:
    """Move a package back that a killed run had moved away, and remove what killed runs have left beside it.

    What a living process is at work on stays.
    """
    try:
        folder = folder.resolve()
    except (OSError, RuntimeError):  # a link that leads to itself: `refuse_foreign` says so
        return
    hidden = re.compile(rf"\.{re.escape(folder.name)}-(new|old)-\d+-[0-9a-f]+")
    with contextlib.suppress(OSError), os.scandir(folder.parent) as entries:
        # moved away ones first
        for name in sorted((e.name for e in entries if hidden.fullmatch(e.name)), key=lambda n: "-new-" in n):
            left = folder.with_name(name)
            with _locked(left) as free:
                if not free:
                    continue
                if "-old-" in name and not folder.exists():
                    os.rename(left, folder)
                else:
                    shutil.rmtree(left, ignore_errors=True)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[bool | None]:
    """Hold the lock of a folder meanwhile; False: it is gone, or another holds it. None: the file system has no locks."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        yield False
        return
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        except OSError:
            yield None
        else:
            yield folder.exists()  # who had it before may have removed it
    finally:
        os.close(handle)


@contextlib.contextmanager
def _workshop(folder: Path) -> Iterator[Path]:
    """A hidden folder beside one, locked, and removed in the end with all that is in it."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    for _ in range(ATTEMPTS):
        place = _beside(folder, "new")
        place.mkdir()
        try:
            with _locked(place) as held:
                if held is not False:  # nobody took it for a leftover before it was locked
                    yield place
                    return
        finally:
            shutil.rmtree(place, ignore_errors=True)
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY), str(folder))


def _beside(folder: Path, what: str) -> Path:
    return folder.with_name(f".{folder.name}-{what}-{os.getpid()}-{os.urandom(4).hex()}")


def _take_place(new: Path, folder: Path) -> None:
    """Put a finished folder where another may stand, also while other processes do the same."""
    for attempt in range(ATTEMPTS):
        try:
            os.rename(new, folder)  # where nothing stands, or an empty folder
            return
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        with contextlib.suppress(FileNotFoundError):  # another process has moved it away
            if exchange(new, folder):
                return
        if _replace(new, folder):
            return
        time.sleep(0.001 * attempt)
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY), str(folder))


def _replace(new: Path, folder: Path) -> bool:
    """Move a folder away and another into its place; False: a third one was quicker."""
    old = _beside(folder, "old")
    with contextlib.suppress(FileNotFoundError):
        os.rename(folder, old)
    try:
        os.rename(new, folder)
        return True
    except OSError:
        with contextlib.suppress(OSError):
            os.rename(old, folder)
        return False
    finally:
        if folder.exists():  # else the old one stays, to be moved back
            shutil.rmtree(old, ignore_errors=True)


def exchange(one: Path, other: Path) -> bool:
    """Let two folders change places in one step; False where the system or the file system cannot."""
    call = _exchange_call()
    if call is None:
        return False
    if call(os.fsencode(one), os.fsencode(other)) == 0:
        return True
    number = ctypes.get_errno()
    if number in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP):
        return False
    raise OSError(number, os.strerror(number), str(other))


@functools.cache
def _exchange_call() -> Callable[[bytes, bytes], int] | None:
    """``renameat2`` of Linux, ``renamex_np`` of macOS."""
    here, swap = -100, 2  # AT_FDCWD; RENAME_EXCHANGE, RENAME_SWAP
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "darwin":
            function = library.renamex_np
            function.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_uint]
            return lambda one, other: int(function(one, other, swap))
        function = library.renameat2
        function.argtypes = [ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint]
        return lambda one, other: int(function(here, one, here, other, swap))
    except (OSError, AttributeError):
        return None
