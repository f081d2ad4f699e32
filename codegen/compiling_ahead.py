"""Compiles a package's first library while the rest of the package is still being written."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .runtime.sections import carried_files
from .runtime.standalone.errors import CompileError
from .runtime.standalone.files.build import Build, first_build
from .runtime.standalone.files.compiler import CFLAGS
from .runtime.standalone.files.user_cache import PRIVATE, in_cache


class CompilingAhead:
    """Compiles a copy of a package's C code in a thread, unless it is already compiled. As a context, it stops the thread at the
    end.

    Errors are ignored here: the package is then compiled in its folder, and errors are reported there.

    Parameters
    ----------
    folder : Path
        The future folder of the package.
    everything : bool
        Whether to compile all functions.
    """

    def __init__(self, folder: Path, everything: bool) -> None:
        self.folder = folder
        self.everything = everything
        self._library: Path | None = None
        self._thread = threading.Thread(target=self._compile, daemon=True)
        self._build: Build | None = None
        self._copy: Path | None = None

    def begin(self, files: Mapping[str, str], manifest: Mapping[str, Any]) -> None:
        """Starts the compilation in a thread.

        Parameters
        ----------
        files : mapping of str to str
            Generated files; only C files are compiled.
        manifest : mapping
            See `codegen.manifest.manifest`.
        """
        if CFLAGS in os.environ:  # other flags may make the compiler record the path of the source
            return
        with contextlib.suppress(OSError, CompileError):
            self._copy = Path(tempfile.mkdtemp(prefix="ordernm-"))
            for name, text in {**files, **carried_files(manifest)}.items():
                if name.endswith((".c", ".h")):
                    file = self._copy / name
                    file.parent.mkdir(parents=True, exist_ok=True)
                    file.write_text(text, encoding="utf-8")
            self._build = first_build(self._copy, manifest, self.everything)
            self._build.places[0] = self.folder
            if self._build.compiler and self._build.found() is None:
                self._build.places = [self._copy]
                self._thread.start()
                # without waiting, this thread would hold the interpreter and delay the compiler by a tenth of a second
                self._build.stop.begun.wait()

    def _compile(self) -> None:
        assert self._build is not None
        try:
            with contextlib.suppress(CompileError):
                self._library = self._build.library()
        finally:
            self._build.stop.begun.set()

    def place(self) -> None:
        """Waits until the library is compiled, and moves it into the package."""
        if self._thread.is_alive():
            self._thread.join()
        if self._library is not None:
            hidden = self.folder / f".build-{self._library.name}"
            with contextlib.suppress(OSError):
                shutil.copyfile(self._library, hidden)
                if in_cache(hidden):
                    hidden.chmod(PRIVATE)
                hidden.replace(self.folder / self._library.name)

    def __enter__(self) -> CompilingAhead:
        return self

    def __exit__(self, *_: object) -> None:
        if self._build is not None:
            self._build.stop.now()
        if self._thread.is_alive():
            self._thread.join()
        if self._copy is not None:
            shutil.rmtree(self._copy, ignore_errors=True)
