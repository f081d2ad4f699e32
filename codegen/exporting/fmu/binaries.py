"""Binaries of an FMU: for this machine by the C compiler, for others by zig."""

from __future__ import annotations

import importlib.util
import platform
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...runtime.standalone.errors import CompileError, NoCompilerError
from ...runtime.standalone.files.compiler import compile_seconds, find_compiler, optimization

FLAGS = ("-std=gnu11", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden", "-w")
"""Flags of all builds. Products and sums are rounded one by one, so that all platforms compute the same numbers."""

NATIVE = "-march=native"
"""The flag that FMUs leave out, because they run on other processors of the same kind."""


@dataclass(frozen=True, slots=True)
class Platform:
    """A platform for which FMUs may have a binary.

    Attributes
    ----------
    zig : str
        The target, as zig calls it.
    ending : str
        Ending of the file of a library.
    folders : dict of str to str
        Name of the folder of binaries by version of the standard; FMI 2.0 has none for other processors than x86.
    """

    zig: str
    ending: str
    folders: dict[str, str]


PLATFORMS = {
    "x86_64-linux": Platform("x86_64-linux-gnu.2.17", ".so", {"3.0": "x86_64-linux", "2.0": "linux64"}),
    "aarch64-linux": Platform("aarch64-linux-gnu.2.17", ".so", {"3.0": "aarch64-linux"}),
    "x86_64-windows": Platform("x86_64-windows-gnu", ".dll", {"3.0": "x86_64-windows", "2.0": "win64"}),
    "x86_64-darwin": Platform("x86_64-macos", ".dylib", {"3.0": "x86_64-darwin", "2.0": "darwin64"}),
    "aarch64-darwin": Platform("aarch64-macos", ".dylib", {"3.0": "aarch64-darwin"}),
}


LINKED = {".so": ("-lm", "-Wl,-z,defs"), ".dylib": ("-lm",)}
"""Flags of the linker by ending of the library. With them it refuses libraries in which a function is missing."""


class PlatformError(ValueError):
    """Raised for platforms that are unknown, or for which a version of the standard has no binaries."""


def this_platform() -> str:
    """The platform of this machine, which may be none of `PLATFORMS`."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    system = {"win32": "windows"}.get(sys.platform, sys.platform)
    return f"{machine}-{system}"


def chosen(given: Sequence[str] | str | None, version: str) -> list[str]:
    """The platforms that a user names: ``"all"``, ``"none"``, or a list; None stands for this machine.

    Raises
    ------
    PlatformError
    """
    able = [n for n, p in PLATFORMS.items() if version in p.folders]
    names = [this_platform()] if given is None else given.split(",") if isinstance(given, str) else list(given)
    names = able if names == ["all"] else [] if names == ["none"] else [n.strip() for n in names]
    for name in names:
        if name not in PLATFORMS:
            raise PlatformError(f"platform {name!r} is unknown; platforms are {', '.join(PLATFORMS)}, all, and none")
        if name not in able:
            raise PlatformError(
                f"FMI {version} has no binaries for {name}, only for {', '.join(able)}; choose these, or FMI 3.0"
            )
    return list(dict.fromkeys(names))


def compiled(texts: Mapping[str, str], name: str, platforms: Sequence[str], version: str) -> dict[str, bytes]:
    """Binaries by their place in the FMU.

    Raises
    ------
    NoCompilerError
        If there is no compiler for a platform.
    CompileError
    """
    found = {}
    with tempfile.TemporaryDirectory(prefix="ordernm-") as temporary:
        folder = Path(temporary)
        for file, text in texts.items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_text(text, encoding="utf-8")
        for of in platforms:
            about = PLATFORMS[of]
            library = f"{name}{about.ending}"
            flags = [*(flag for flag in optimization() if flag != NATIVE), *FLAGS]
            files = sorted(f for f in texts if f.endswith(".c"))
            _run([*_compiler(of), *flags, *files, "-I.", "-o", library, *LINKED.get(about.ending, ())], folder, of)
            found[f"binaries/{about.folders[version]}/{library}"] = (folder / library).read_bytes()
    return found


def _compiler(of: str) -> list[str]:
    """The command of the compiler for a platform."""
    if of == this_platform():
        return find_compiler()
    if importlib.util.find_spec("ziglang") is None:
        raise NoCompilerError(
            f"binaries for {of} need zig: pip install 'ordernm[fmi]'; or omit platforms, to build for this machine only"
        )
    return [sys.executable, "-m", "ziglang", "cc", "-target", PLATFORMS[of].zig, "-s"]


def _run(command: Sequence[str], folder: Path, of: str) -> None:
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False, timeout=compile_seconds(), stdin=subprocess.DEVNULL
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise CompileError(
            f"the compiler for {of} took longer than {compile_seconds():g} s; ORDERNM_COMPILE_SECONDS sets another limit"
        ) from None
    except OSError as error:
        raise NoCompilerError(f"the compiler for {of} cannot be run: {error}") from None
    if done.returncode:
        raise CompileError(f"{' '.join(command[:4])} ... failed for {of}:\n{done.stderr[-2000:]}")
