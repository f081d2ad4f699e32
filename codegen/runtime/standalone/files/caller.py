"""What calls a library: cffi's API mode, a small module that is compiled once for a user's Python, where it can be had."""

from __future__ import annotations

import contextlib
import functools
import importlib.machinery
import importlib.util
import io
import os
import platform
import sysconfig
from pathlib import Path
from typing import Any

from ..errors import CompileError, FlagsError, NoCompilerError
from .build import Build, short_key
from .compiler import STANDARD, compiler_version

CALLER = "int ordernm_call(void *, void *, long, double, long);\n"
"""What cffi's API mode compiles: calls of the functions of ``NAME_calls.c``, of all packages, by their addresses."""

SOURCE = """\
static int ordernm_call(void *function, void *x, long given, double t, long k)
{
    return ((int (*)(double *const *, long, double, long))function)(x, given, t, k);
}
"""


class CallerBuild(Build):
    """How cffi's caller is compiled: once for a user's Python, whatever the model is.

    Raises
    ------
    CompileError
        There are no headers of Python.
    """

    def __init__(self, folder: Path, wanted: bool):
        super().__init__(folder, "ordernm_call")
        self.wanted = wanted
        include = sysconfig.get_path("include")
        if not os.path.exists(os.path.join(include, "Python.h")):
            raise CompileError(f"no Python.h in {include}")
        self.flags = ["-O1", "-I", include]
        self.places = [*self.places[1:], folder]

    def key(self) -> str:
        import cffi

        python = short_key(cffi.__version__, str(sysconfig.get_config_var("SOABI")), SOURCE, *STANDARD, *self.flags)
        machine = short_key(platform.machine(), *self.compiler, compiler_version(tuple(self.compiler)))
        return f"{self.name}-{python}-{machine if self.compiler else '*'}"

    def _compile(self, output: Path, log_file: Path) -> None:
        from cffi import FFI

        ffi = FFI()
        ffi.cdef(CALLER)
        ffi.set_source("_ordernm_call", SOURCE)
        source = output.with_name("ordernm_call.c")
        with contextlib.redirect_stdout(io.StringIO()):  # cffi tells what it writes
            ffi.emit_c_code(str(source))
        self.sources = [source]
        # what fails is done without, and leaves no log, unless it was asked for
        super()._compile(output, log_file if self.wanted else output.with_name(log_file.name))


@functools.cache
def _load_caller(path: str) -> Any:
    """The functions of a compiled caller."""
    loader = importlib.machinery.ExtensionFileLoader("_ordernm_call", path)
    spec = importlib.util.spec_from_file_location("_ordernm_call", path, loader=loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module.lib


_refused: set[str] = set()
"""Keys of callers that could not be compiled, which are not tried again."""


def find_caller(folder: Path) -> Any:
    """The functions of `CALLER` in cffi's API mode; None where ABI mode must serve.

    ``ORDERNM_CFFI`` of the environment asks for one of them: ``api`` or ``abi``.

    Raises
    ------
    FlagsError, CompileError
    """
    mode = os.environ.get("ORDERNM_CFFI", "")
    if mode not in ("", "abi", "api"):
        raise FlagsError(f"ORDERNM_CFFI is {mode!r}; allowed are 'api' and 'abi', or nothing for the first that works")
    if mode == "abi":
        return None
    try:
        build = CallerBuild(folder, mode == "api")
        key = build.key()
        if mode != "api" and key in _refused:
            return None
        try:
            return _load_caller(str(build.library()))
        except (CompileError, NoCompilerError, ImportError, OSError):
            _refused.add(key)
            raise
    except (CompileError, NoCompilerError, ImportError, OSError) as error:
        if mode == "api":
            raise CompileError(f"ORDERNM_CFFI=api: cffi's API mode cannot be used: {error}") from None
        return None
