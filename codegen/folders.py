"""The folder of a package: it is refused if it contains foreign files, replaced as a whole, and restored after a kill.

A package is written to a hidden folder beside the target, and then exchanged with it in one step, so that there is
always a complete package. If the system cannot exchange folders, the old folder is first moved to a hidden name. A kill
between the two moves leaves the old folder under this name, and the next run moves it back. The writer holds a lock on
its hidden folder, which the system releases when the process ends; so leftovers can be distinguished from folders in
use.
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
"""Suffixes that the model's name gets in files and C functions of further partitions."""

ATTEMPTS = 20
"""Maximum number of attempts to replace a folder while other processes replace it, too."""


class FolderError(Failure, ValueError):
    """The output folder cannot be written, or contains files that `generate` did not write."""


def refuse_foreign(folder: Path, force: bool = False) -> list[str]:
    """Raises `FolderError` unless the folder is absent, empty, or contains only a previous package.

    Parameters
    ----------
    folder : Path
    force : bool
        Accept any content: generated files are replaced, and others stay.

    Returns
    -------
    list of str
        Names of files to keep.
    """
    try:
        if not folder.exists():
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                folder.stat()  # raises for a link to itself; from Python 3.13 on, `resolve` does not
            _refuse_unwritable(folder)
            return []
        if not folder.is_dir():
            raise FolderError(f"{folder} is a file; give a folder to write into with -o")
        here = Path.cwd()
        if folder.resolve() in (
            here,
            *here.parents,
        ):  # the folder is replaced as a whole, which would remove the shell's working directory
            raise FolderError(f"{folder} is, or contains, the working directory; give another folder with -o")
        manifest: Any = None
        with contextlib.suppress(OSError, ValueError, RecursionError):
            manifest = json.loads((folder / "model.json").read_text(encoding="utf-8"))
        listed = manifest.get("files", ()) if isinstance(manifest, dict) else ()
        listed = {str(n) for n in listed} if isinstance(listed, list) else set()
        found = list(_names(folder, {str(above) for n in listed for above in PurePath(n).parents}))
    except (OSError, RuntimeError) as error:  # the folder is a symbolic link to itself
        raise FolderError(f"cannot write {folder}: {getattr(error, 'strerror', None) or error}") from None
    if not isinstance(manifest, dict) or manifest.get("generator") != "ordernm":
        if force or not found:
            return found
        raise FolderError(
            f"{folder} contains files that generate did not write; choose another folder with -o, or use --force to replace "
            f"files of the same names and keep the others"
        )
    others = "|".join(OTHERS)
    own = re.compile(
        rf"{re.escape(str(manifest.get('name')))}({others})?(_precise|_four|_states|_threads)?(\.[a-z]+)?(-[0-9a-f-]+\.so|\.log)|motion/motion(-[0-9a-f-]+\.so|\.log)|ordernm_call-[0-9a-f-]+\.so|(.*/)?__pycache__|\.build-.*"
    )
    foreign = sorted(n for n in found if n not in listed and not own.fullmatch(n))
    if foreign and not force:
        raise FolderError(
            f"{folder} contains {', '.join(foreign[:5])}{', ...' if len(foreign) > 5 else ''} besides generated files, which "
            f"would be lost; move them away, choose another folder with -o, or use --force to keep them"
        )
    return foreign


def unwritable(file: Path) -> str | None:
    """The reason why a file cannot be written; None if no obstacle is known."""
    folder = file.resolve().parent
    if file.is_dir():
        return f"{file} is a folder; give the name of a file"
    if not folder.is_dir():
        return f"cannot write {file}: there is no folder {folder}"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"cannot write {file}: no permission to write in {folder}"
    return None


def _names(folder: Path, own: set[str], above: str = "") -> Iterator[str]:
    """The names of the entries of a folder, with the contents of subfolders that belong to a package."""
    for path in folder.iterdir():
        name = above + path.name
        if name in own and path.is_dir():
            yield from _names(path, own, f"{name}/")
        else:
            yield name


def _refuse_unwritable(folder: Path) -> None:
    """Raises `FolderError` if the folder cannot be created; it is called before any work is done."""
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
    """Writes a package as a whole: all files are written to a hidden folder, which is then moved to its place.

    Returns False if the folder already contains the same files; it then keeps its compiled library. If only files have changed
    that are not compiled, libraries are kept. Files named in `keep` stay, unless a new file has the same name.
    """
    folder = folder.resolve()  # keeps a symbolic link in place
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
    """Copies compiled libraries to the new folder if the C code has not changed."""
    not_compiled = {
        f"{source.stem}_model.h" for source in new.glob("*.c")
    }  # headers with defaults and the initial state, for callers only
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
    """Copies named files and folders to the new folder, except those that it contains already."""
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
    """Moves a package back that a killed run had moved away, and removes leftovers of killed runs.

    Folders in use by running processes stay.
    """
    try:
        folder = folder.resolve()
    except (OSError, RuntimeError):  # a symbolic link to itself, which `refuse_foreign` reports
        return
    hidden = re.compile(rf"\.{re.escape(folder.name)}-(new|old)-\d+-[0-9a-f]+")
    with contextlib.suppress(OSError), os.scandir(folder.parent) as entries:
        # moved packages are restored first
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
    """Holds the lock of a folder. Yields False if the folder does not exist or another process holds the lock; None if
    the file system has no locks."""
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
            yield folder.exists()  # the previous owner of the lock may have removed the folder
    finally:
        os.close(handle)


@contextlib.contextmanager
def _workshop(folder: Path) -> Iterator[Path]:
    """A locked hidden folder beside `folder`; it is removed with its contents at the end."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    for _ in range(ATTEMPTS):
        place = _beside(folder, "new")
        place.mkdir()
        try:
            with _locked(place) as held:
                if held is not False:  # no process removed the folder as a leftover before it was locked
                    yield place
                    return
        finally:
            shutil.rmtree(place, ignore_errors=True)
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY), str(folder))


def _beside(folder: Path, what: str) -> Path:
    return folder.with_name(f".{folder.name}-{what}-{os.getpid()}-{os.urandom(4).hex()}")


def _take_place(new: Path, folder: Path) -> None:
    """Moves a finished folder to its place, even if other processes do the same."""
    for attempt in range(ATTEMPTS):
        try:
            os.rename(new, folder)  # succeeds if no folder, or an empty one, has this name
            return
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        with contextlib.suppress(FileNotFoundError):  # another process has moved the old folder away
            if exchange(new, folder):
                return
        if _replace(new, folder):
            return
        time.sleep(0.001 * attempt)
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY), str(folder))


def _replace(new: Path, folder: Path) -> bool:
    """Moves the old folder away and the new one to its place; False if another process did so first."""
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
        if folder.exists():  # if not, the old folder stays for the next run to restore
            shutil.rmtree(old, ignore_errors=True)


def exchange(one: Path, other: Path) -> bool:
    """Exchanges two folders in one step; False if the operating system or the file system cannot do this."""
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
    """The system call that exchanges folders: ``renameat2`` of Linux or ``renamex_np`` of macOS."""
    here, swap = -100, 2  # the constants AT_FDCWD; RENAME_EXCHANGE, RENAME_SWAP
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
