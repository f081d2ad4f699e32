"""Builds ``direct_call.c``, the compiled part of calls, once per Python and NumPy version, where their headers are
installed."""

from __future__ import annotations

import functools
import importlib.machinery
import importlib.util
import os
import platform
import sysconfig
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import CompileError, FlagsError, NoCompilerError
from ..files.build import Build, short_key
from ..files.compiler import STANDARD, compiler_version

SOURCES = [Path(__file__).with_name(name) for name in ("direct_call.h", "direct_states.h", "direct_call.c")]

DIRECT = "fd"
"""NumPy's characters for the types of arrays that ``direct_call.c`` reads and writes."""


class CallerBuild(Build):
    """Compiles ``direct_call.c``, which is the same for all models.

    Raises
    ------
    CompileError
        If the headers of Python are missing.
    """

    def __init__(self, folder: Path, wanted: bool):
        super().__init__(folder, "ordernm_call")
        self.wanted = wanted
        include = sysconfig.get_path("include")
        if not os.path.exists(os.path.join(include, "Python.h")):
            raise CompileError(f"no Python.h in {include}")
        self.sources = [SOURCES[-1]]
        self.flags = ["-O2", "-I", include, "-I", np.get_include()]
        self.places = [*self.places[1:], folder]

    def key(self) -> str:
        python = short_key(str(sysconfig.get_config_var("SOABI")), np.__version__, _source(), *STANDARD, *self.flags)
        machine = short_key(platform.machine(), *self.compiler, compiler_version(tuple(self.compiler)))
        return f"{self.name}-{python}-{machine if self.compiler else '*'}"

    def _compile(self, output: Path, log_file: Path) -> None:
        # this module is optional, so a failure leaves a log only if ORDERNM_CFFI requests it
        super()._compile(output, log_file if self.wanted else output.with_name(log_file.name))


@functools.cache
def _source() -> str:
    return "".join(file.read_text(encoding="utf-8") for file in SOURCES)


@functools.cache
def _load_caller(path: str) -> Any:
    """The module of the compiled caller."""
    loader = importlib.machinery.ExtensionFileLoader("ordernm_call", path)
    spec = importlib.util.spec_from_file_location("ordernm_call", path, loader=loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


_refused: set[str] = set()
"""Keys of builds of ``direct_call.c`` that failed; these builds are not repeated."""


def find_caller(folder: Path) -> Any:
    """The module compiled from ``direct_call.c``; None if calls use cffi's ABI mode.

    The environment variable ``ORDERNM_CFFI`` selects the mode: ``api`` or ``abi``.

    Raises
    ------
    FlagsError, CompileError
    """
    mode = os.environ.get("ORDERNM_CFFI", "")
    if mode not in ("", "abi", "api"):
        raise FlagsError(
            f"ORDERNM_CFFI is {mode!r}; allowed are 'api' and 'abi'; leave it empty for the first that works"
        )
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
            raise CompileError(f"ORDERNM_CFFI=api: the calling module cannot be compiled or opened: {error}") from None
        return None
