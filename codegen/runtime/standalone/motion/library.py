"""The library of integrators, common to all packages, and cffi's form of its declarations: made at the first use and kept
in the user's cache."""

from __future__ import annotations

import contextlib
import re
import runpy
import sys
import threading
from pathlib import Path
from typing import Any

from ..errors import CompileError, NoCompilerError, PackageError
from ..files.build import Build, build_apart, short_key
from ..files.user_cache import user_cache

FOLDER = "motion"
HEADERS = ("scalar.h", "motion.h")

_opened: dict[Path, tuple[Any, Any]] = {}
_opening = threading.Lock()


def motion_library(folder: Path) -> tuple[Any, Any]:
    """The library compiled from ``motion/`` of a package, and its cffi interface.

    Raises
    ------
    NoCompilerError, CompileError, PackageError
    """
    if folder in _opened:  # reading the dictionary needs no lock
        return _opened[folder]
    with _opening:
        if folder not in _opened:
            sources = sorted(f.name for f in (folder / FOLDER).glob("*.c"))
            if not sources:
                raise PackageError(f"{folder} has no C files in {FOLDER}/: generate it again")
            build = Build(folder / FOLDER, FOLDER, sources)
            with contextlib.suppress(RuntimeError):  # without a home directory each package has its own library
                build.places.insert(0, user_cache() / FOLDER)
            ffi = _interface(folder)
            path = build.library()
            try:
                _opened[folder] = ffi.dlopen(str(path)), ffi
            except OSError as error:
                raise CompileError(f"{path} was compiled but cannot be opened: {error}") from None
        return _opened[folder]


class Declarations(Build):
    """Writes cffi's Python form of the integrators' declarations, because cffi reads it fifty times as fast as C.

    Raises
    ------
    RuntimeError
        If the user has no home directory.
    """

    suffix = ".py"

    def __init__(self, folder: Path, text: str):
        super().__init__(folder, "declarations")
        self.text, self.compiler, self.places = text, ["cffi"], [user_cache() / FOLDER]

    def key(self) -> str:
        import cffi

        return f"{self.name}-{short_key(self.text, cffi.__version__, sys.version)}"

    def _compile(self, output: Path, log_file: Path) -> None:
        ffi = _read(self.text)
        ffi.set_source(self.name, None, compiler_verbose=0)
        ffi.emit_python_code(str(output))


def _read(text: str) -> Any:
    from cffi import FFI

    ffi = FFI()
    ffi.cdef(text)
    return ffi


def _interface(folder: Path) -> Any:
    """The cffi interface of the integrators."""
    text = declarations("".join((folder / FOLDER / f).read_text(encoding="utf-8") for f in HEADERS))
    try:
        return runpy.run_path(str(Declarations(folder, text).library()))["ffi"]
    except (CompileError, NoCompilerError, RuntimeError, OSError):  # there is no cache
        return _read(text)


_apart: dict[tuple[Path, str, str, str], tuple[Any, Any]] = {}


def _library_apart(folder: Path, name: str, part: str, sealed: str, declaration: str) -> tuple[Any, Any]:
    """The cffi interface and the library of ``NAME_<part>.c``, which includes ``NAME.c``; compiled at the first use."""
    from cffi import FFI

    key = folder, name, part, sealed
    with _opening:
        if key not in _apart:
            ffi = FFI()
            ffi.cdef(declaration)
            path = build_apart(folder, name, part, sealed).library()
            try:
                _apart[key] = ffi, ffi.dlopen(str(path))
            except OSError as error:
                raise CompileError(f"{path} was compiled but cannot be opened: {error}") from None
        return _apart[key]


def precise_functions(folder: Path, name: str, sealed: str) -> int:
    """The address of the function table of ``NAME_precise.c``.

    Raises
    ------
    NoCompilerError, CompileError
    """
    ffi, library = _library_apart(folder, name, "precise", sealed, f"const void *{name}_precise(void);")
    return int(ffi.cast("intptr_t", getattr(library, f"{name}_precise")()))


def four_lanes(folder: Path, name: str, sealed: str) -> int:
    """The address of the function of ``NAME_four.c`` that adds functions for four directions to an ``ordernm_system``.

    Raises
    ------
    NoCompilerError, CompileError
    """
    ffi, library = _library_apart(folder, name, "four", sealed, f"void {name}_four(void *);")
    return int(ffi.cast("intptr_t", getattr(library, f"{name}_four")))


def declarations(header: str) -> str:
    """A C header without comments and without lines for the preprocessor or C++."""
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    text = re.sub(r"#ifdef __cplusplus.*?#endif", "", text, flags=re.DOTALL)
    return re.sub(r"^#.*$", "", text, flags=re.MULTILINE)
