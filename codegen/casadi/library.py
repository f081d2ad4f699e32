"""The library of a package for CasADi: written into the user's cache and compiled there once."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..runtime.standalone.calls.numpy_target import NumpyTarget
from ..runtime.standalone.files.build import Build, short_key
from ..runtime.standalone.files.manifest import check_files, refuse_another
from ..runtime.standalone.files.user_cache import make_private, user_cache
from ..runtime.standalone.files.whole_file import write_whole
from .bridged import Bridged, bridged
from .source import text

ENGINE = Path(__file__).with_name("external.h")
"""The part of the C text that is the same for all models."""


def described(folder: Path, manifest: Mapping[str, Any]) -> dict[str, Bridged]:
    """The functions of a package that can become functions of CasADi.

    Raises
    ------
    BridgeError, PackageError
    """
    check_files(folder, manifest, (".c", ".h", "_numpy.py"))
    return bridged(manifest, NumpyTarget(folder, manifest))


def write(folder: Path, manifest: Mapping[str, Any], functions: Mapping[str, Bridged], into: Path) -> list[str]:
    """Writes all C files of the library, and returns their names; the first two are compiled."""
    name = manifest["name"]
    headers = [f"{name}.h", f"{name}_directions.h"]
    files = [f"{name}_casadi.c", f"{name}.c", ENGINE.name, *(h for h in headers if (folder / h).is_file())]
    contents = {files[0]: text(manifest, functions.values()), ENGINE.name: ENGINE.read_text(encoding="utf-8")}
    for file in files:
        content = (contents.get(file) or (folder / file).read_text(encoding="utf-8")).encode()
        write_whole(into / file, lambda opened, content=content: opened.write(content))  # type: ignore[misc]
    return files


def build(folder: Path, name: str) -> Path:
    """Compiles the written files.

    Raises
    ------
    NoCompilerError, CompileError
    """
    made = Build(folder, f"{name}_casadi", [f"{name}_casadi.c", f"{name}.c"])
    made.places = [folder]
    return made.library()


def library(folder: Path, manifest: Mapping[str, Any], functions: Mapping[str, Bridged]) -> Path:
    """The compiled library of a package, in the user's cache or, if that is not safe, in a temporary folder.

    Raises
    ------
    PackageError
        If the package was generated again since it was opened.
    """
    refuse_another(folder, str(manifest.get("seal", "")))
    check_files(folder, manifest, (".c", ".h"))
    key = short_key(str(manifest.get("seal", manifest["hash"])), manifest["name"], text(manifest, functions.values()))
    try:
        place = make_private(user_cache() / "casadi" / f"{manifest['name']}-{key}")
    except (OSError, RuntimeError):
        place = Path(tempfile.mkdtemp(prefix="ordernm-"))
    write(folder, manifest, functions, place)
    return build(place, manifest["name"])
