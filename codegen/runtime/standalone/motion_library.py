"""The integrators of a package, which are the same in all packages: compiled when first used, kept in the user's cache."""

from __future__ import annotations

import contextlib
import os
import re
import threading
from pathlib import Path
from typing import Any

from .build import Build, user_cache
from .errors import CompileError, PackageError

FOLDER = "motion"
HEADER = "motion.h"
CFLAGS = "ORDERNM_CFLAGS"

_opened: dict[Path, tuple[Any, Any]] = {}
_opening = threading.Lock()


def motion_library(folder: Path) -> tuple[Any, Any]:
    """The library of the C files in ``motion/`` of a package, and the cffi object that knows its declarations.

    Raises
    ------
    NoCompilerError, CompileError, PackageError
    """
    from cffi import FFI

    with _opening:
        if folder not in _opened:
            sources = sorted(f.name for f in (folder / FOLDER).glob("*.c"))
            if not sources:
                raise PackageError(f"{folder} has no C files in {FOLDER}/: generate it again")
            build = Build(folder / FOLDER, FOLDER, sources)
            with contextlib.suppress(RuntimeError):  # a user without a home; else packages share one library
                build.places.insert(0, user_cache() / FOLDER)
            ffi = FFI()
            ffi.cdef(declarations((folder / FOLDER / HEADER).read_text(encoding="utf-8")))
            path = build.library()
            try:
                _opened[folder] = ffi.dlopen(str(path)), ffi
            except OSError as error:
                raise CompileError(f"{path} was compiled but cannot be opened: {error}") from None
        return _opened[folder]


_precise: dict[tuple[Path, str], tuple[Any, int]] = {}


def precise_functions(folder: Path, name: str) -> int:
    """The address of the table of functions of ``NAME_precise.c``.

    Raises
    ------
    NoCompilerError, CompileError
    """
    from cffi import FFI

    with _opening:
        if (folder, name) not in _precise:
            ffi = FFI()
            ffi.cdef(f"const void *{name}_precise(void);")
            build = Build(folder, f"{name}_precise", [f"{name}_precise.c"])
            if CFLAGS not in os.environ:
                build.flags = ["-O0"]  # it is needed at once, and seldom called
            path = build.library()
            try:
                library = ffi.dlopen(str(path))
            except OSError as error:
                raise CompileError(f"{path} was compiled but cannot be opened: {error}") from None
            _precise[folder, name] = library, int(ffi.cast("intptr_t", getattr(library, f"{name}_precise")()))
        return _precise[folder, name][1]


def declarations(header: str) -> str:
    """A C header without comments, and without what only the preprocessor and C++ read."""
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    text = re.sub(r"#ifdef __cplusplus.*?#endif", "", text, flags=re.DOTALL)
    return re.sub(r"^#.*$", "", text, flags=re.MULTILINE)
