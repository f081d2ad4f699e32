"""Compiles a package once; the library is kept beside the package or in the user's cache and identified by digests."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shlex
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import CompileError, NoCompilerError
from .compiler import (
    CFLAGS,
    COMMAND,
    STANDARD,
    Stop,
    compiler_version,
    find_compiler,
    optimization,
    processor,
    run_all,
    searches,
)
from .compiling import waiting
from .manifest import refuse_another
from .user_cache import PRIVATE, in_cache, make_private, trusted, user_cache

FLAGS = {"four": ("-O3", "-march=native"), "precise": ("-O1",)}
"""Flags of separate libraries, unless the environment gives flags. For four directions, -O3 makes motions 5 per cent faster,
which is worth the longer compilation. A motion waits while functions in long double compile, so -O1 is used. With -O0,
derivatives near a pose where a loop loses rank take twice as long."""

OF_MOTIONS = ("", "motion", "gradients")
"""Libraries that need functions of ``<name>_motion.c``; for other libraries this file would be empty."""

_INCLUDE = re.compile(rb'^ *# *include "([^"]+)"', re.MULTILINE)


class Build:
    """Compiles the C code of a package to a library.

    The library's name contains three keys (of the source; of flags and processor; of the compiler) and a digest of the library
    itself. The digest detects truncated files, which would crash the process when opened. A library gets its name only when it is
    complete, so several processes may build it at the same time.

    Parameters
    ----------
    folder : Path
        The folder of the package.
    name : str
        The model's name.
    sources : list of str
        C files; default: ``<name>.c``, ``<name>_calls.c`` and, if its functions are needed, ``<name>_motion.c``.
    part : str
        Name of a library with only some of the functions; empty for all functions.
    number, units
        The library's number in C, and its compile units, which are compiled in parallel; see ``libraries`` of ``model.json``.
    sealed : str
        The seal of the manifest when the package was opened. A package that has been generated again since is refused.
    """

    suffix = ".so"

    def __init__(
        self,
        folder: Path,
        name: str,
        sources: Sequence[str] = (),
        part: str = "",
        number: int = 0,
        units: Sequence[int] = (),
        sealed: str = "",
    ):
        self.folder = folder
        self.sealed = sealed
        self.name = name
        self.part = part
        self.number = number
        self.units = units
        self.sources = [folder / s for s in sources or [f"{name}.c", f"{name}_calls.c"]]
        motion = folder / f"{name}_motion.c"
        if not sources and part in OF_MOTIONS and motion.is_file():
            self.sources.append(motion)
        self.flags = optimization()
        try:
            self.compiler = find_compiler()
        except NoCompilerError as error:
            self.compiler, self.complaint = [], error
        self.places = [folder]
        self.stop = Stop()
        with contextlib.suppress(RuntimeError):  # this user has no home directory
            self.places.append(user_cache() / name)

    def key(self) -> str:
        """First part of the library's file name; without a compiler, ``*`` stands for the compiler's key."""
        source = hashlib.sha256()
        for text in _texts(self.sources):
            source.update(text)
        machine = short_key(*STANDARD, *self.flags, processor())
        compiler = short_key(*self.compiler, compiler_version(tuple(self.compiler))) if self.compiler else "*"
        part = f".{self.part}" if self.part else ""
        return f"{self.name}{part}-{source.hexdigest()[:16]}-{machine}-{compiler}"

    def exists(self) -> bool:
        """Whether all source files exist; a package contains only the files that its functions need."""
        return all(s.is_file() for s in self.sources)

    def found(self, key: str = "") -> Path | None:
        """The compiled library, if it exists. Removes damaged libraries, and ignores cached libraries that other users
        can write to."""
        for place in self.places:
            for found in sorted(place.glob(f"{key or self.key()}-*{self.suffix}")):
                if not trusted(found):
                    continue
                with contextlib.suppress(OSError):
                    if found.stem.endswith(f"-{digest(found)}"):
                        return found
                    found.unlink()
        return None

    def library(self, rebuild: bool = False) -> Path:
        """Returns the path of the library, and compiles it if necessary.

        Raises
        ------
        NoCompilerError, CompileError, PackageError
        """
        refuse_another(self.folder, self.sealed)
        key = self.key()
        found = None if rebuild else self.found(key)
        if found is not None:
            return found
        if not self.compiler:
            raise self.complaint
        refusals = []
        for place in self.places:
            try:
                if in_cache(place):
                    make_private(place)
                else:
                    place.mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryDirectory(prefix=".build-", dir=place, ignore_cleanup_errors=True) as temporary:
                    made = Path(temporary) / "library.so"
                    with waiting(f"{self.name}{self.part and f' ({self.part})'}"):
                        self._compile(made, place / f"{self.name}.log")
                    library = place / f"{key}-{digest(made)}{self.suffix}"
                    if in_cache(place):
                        made.chmod(PRIVATE)
                    os.replace(made, library)
                return library
            except OSError as error:  # the folder is read-only, full or insecure, or has a folder of that name
                refusals.append(str(error))
        raise CompileError(f"no folder to write the library of {self.name} to: {'; '.join(refusals)}")

    def _compile(self, output: Path, log_file: Path) -> None:
        flags = [*searches(self.compiler), *self.flags]
        refused, log = self._run(flags, output)
        for unknown, called in (("-march=native", "march"), ("--param", "--param")):
            complaints = [line for line in log.splitlines() if not line.startswith(COMMAND)]
            named = refused and any(called in line for line in complaints)
            if named and any(f.startswith(unknown) for f in flags):
                flags = [f for f in flags if not f.startswith(unknown)]
                refused, log = self._run(flags, output)
        if not refused and output.exists():
            with contextlib.suppress(OSError):
                log_file.unlink()
            return
        log = log or f"{shlex.join(self.compiler)} reported no error, but wrote no library\n"
        if not self._compiles(output):
            log = f"{shlex.join(self.compiler)} fails even on a C file of one line; set CC to a C compiler\n{log}"
        log_file.write_text(log, encoding="utf-8")
        sources = ", ".join(map(str, self.sources))
        first = "\n".join(log.splitlines()[:12])
        raise CompileError(f"the C compiler failed on {sources}; the complete log is in {log_file}:\n{first}")

    def _compiles(self, output: Path) -> bool:
        """Whether the compiler can compile a trivial function."""
        source, made = output.with_name("one_line.c"), output.with_name("one_line.o")
        source.write_text("int one_line(void) { return 0; }\n", encoding="utf-8")
        refused, _ = run_all([[*self.compiler, "-c", "-o", str(made), str(source)]], self.stop)
        return not refused and made.exists()

    def _run(self, flags: list[str], output: Path) -> tuple[bool, str]:
        """Compiles the sources in parallel and links them; returns whether this failed, and the log."""
        common = [*self.compiler, *STANDARD, *flags]
        if len(self.sources) == 1:
            return run_all([[*common, "-o", str(output), str(self.sources[0]), "-lm"]], self.stop)
        library = [f"-DORDERNM_LIBRARY={self.number}"] if self.part else []
        first, *others = self.sources
        tasks = [(first, f"{first.stem}_{n}", [*library, f"-DORDERNM_UNIT={n}"]) for n in self.units]
        tasks = (tasks or [(first, first.stem, library)]) + [(s, s.stem, library) for s in others]
        objects = [output.with_name(f"{stem}.o") for _, stem, _ in tasks]
        parts = [
            [*(f for f in common if f != "-shared"), *defined, "-c", "-o", str(o), str(s)]
            for (s, _, defined), o in zip(tasks, objects, strict=True)
        ]
        refused, log = run_all(parts, self.stop)
        if refused:
            return refused, log
        return run_all([[*common, "-o", str(output), *map(str, objects), "-lm"]], self.stop)


def _texts(sources: Sequence[Path]) -> Iterator[bytes]:
    """Contents of C files and of all files that they include, each file once."""
    known, waiting = set(sources), [*reversed(sources)]
    while waiting:
        file = waiting.pop()
        text = file.read_bytes()
        yield text
        for name in _INCLUDE.findall(text):
            found = file.parent / os.fsdecode(name)
            if found not in known and found.is_file():
                known.add(found)
                waiting.append(found)


def build_apart(folder: Path, name: str, part: str, sealed: str = "", number: int = 0) -> Build:
    """The build of ``NAME_<part>.c``; "states", "four" and "precise" include ``NAME.c``, "threads" does not.

    `number`: the library of ``NAME.c`` whose functions are compiled; 0 for all.
    """
    build = Build(folder, f"{name}_{part}", [f"{name}_{part}.c"], sealed=sealed)
    if part in FLAGS and CFLAGS not in os.environ:
        build.flags = list(FLAGS[part])
    if part == "threads":
        build.flags.append("-pthread")
    if number:
        build.flags.append(f"-DORDERNM_LIBRARY={number}")
    return build


def builds(folder: Path, manifest: Mapping[str, Any], sealed: str = "") -> dict[str, Build]:
    """The builds of a package by name: "" is the library with all functions; then follow the libraries with some
    functions."""
    name, sources = manifest["name"], manifest.get("sources", ())
    parts = manifest.get("libraries", {})
    found = {
        part: Build(folder, name, part=part, number=x["number"], units=x["units"], sealed=sealed)
        for part, x in parts.items()
    }
    return {"": Build(folder, name, sources, sealed=sealed)} | found


def first_build(folder: Path, manifest: Mapping[str, Any], everything: bool = False, further: bool = False) -> Build:
    """The build that `generate` compiles: the library of most calls, or of all; for a further partition, the library for
    motions."""
    found = builds(folder, manifest)
    whole, *first = found.values()
    if everything or not first:
        return whole
    return found.get("motion", first[0]) if further else first[0]


def digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:8]


def short_key(*parts: str) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:8]
