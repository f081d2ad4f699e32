"""``ordernm export MODEL --casadi``: a folder with a library that `casadi.external` opens, and its C files."""

from __future__ import annotations

import _ctypes
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..emit.repetition import json_text
from ..emit.templates import render
from ..folders import refuse_foreign, write_folder
from ..generation import check_flags, generate
from ..mechanics.procedures import UnknownFunctionError
from ..model.loading import load_model
from ..model.model import Model
from ..program.progress import Progress, silent
from ..runtime.standalone.files.manifest import read_manifest
from ..version import __version__
from ..wording import nearest
from .bridged import BRIDGED, SECOND, Bridged, BridgeError
from .functions import check_name
from .library import build, described, write
from .source import casadi_name


@dataclass(frozen=True, slots=True)
class ExportedCasadi:
    """A folder with a library for CasADi.

    Attributes
    ----------
    folder : Path
    library : Path
        The compiled library.
    files : tuple of str
        Names of the other files.
    functions : dict of str to str
        Each function with its arguments and its result; ``second`` at the end says that second derivatives exist.

    Examples
    --------
    >>> import ordernm.casadi, tempfile
    >>> found = ordernm.casadi.export_casadi("examples/pendulum.yaml", tempfile.mkdtemp(), functions="accelerations")
    >>> list(found.functions)
    ['accelerations_pendulum']
    """

    folder: Path
    library: Path
    files: tuple[str, ...]
    functions: dict[str, str]

    def __repr__(self) -> str:
        return "\n".join([str(self.library), *(f"{n}{x}" for n, x in self.functions.items())])


def export_casadi(
    model: Model | str | os.PathLike[str],
    folder: str | os.PathLike[str] | None = None,
    *,
    functions: Sequence[str] | str | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> ExportedCasadi:
    """Write a library with functions for CasADi, with exact derivatives. Neither writing nor compiling needs CasADi.

    Parameters
    ----------
    model : Model or path
        The model, or its file.
    folder : path, optional
        The folder to write. Default: ``exported/NAME_casadi``.
    functions : sequence of str, or str with commas, optional
        The functions, as in `function`. Default: all that the model has.
    force : bool, optional
        Also write into a folder with other files.
    progress : callable, optional
        Called as ``progress(stage, step, steps)``.

    Returns
    -------
    ExportedCasadi
        The library and its functions.

    Raises
    ------
    BridgeError
        A ValueError, if a function is unknown, the model has no states, or this process has opened an earlier library
        of the folder.
    ModelError
        If the model has no solver.
    FolderError
        If the folder holds other files.
    CompileError
        If the compiler rejects the code.

    Examples
    --------
    >>> import ordernm.casadi, tempfile
    >>> found = ordernm.casadi.export_casadi("examples/pendulum.yaml", tempfile.mkdtemp(), functions="outputs")
    >>> found.library.name
    'pendulum_casadi.so'
    """
    # long: the docstring describes every argument
    check_flags(force=force)
    model = model if isinstance(model, Model) else load_model(model)
    names = _chosen(model, functions)
    check_name(model.name)
    path = Path("exported", f"{model.name}_casadi") if folder is None else Path(folder)
    keep = refuse_foreign(path, force)
    with tempfile.TemporaryDirectory(prefix="ordernm-") as temporary:
        package, written = Path(temporary, model.name), Path(temporary, "written")
        _generated(model, names, package, progress)
        manifest = read_manifest(package)
        found = {n: f for n, f in described(package, manifest).items() if n in names}
        written.mkdir()
        files = write(package, manifest, found, written)
        texts = {f: (written / f).read_text(encoding="utf-8") for f in files}
    library = f"{model.name}_casadi.so"
    _refuse_opened(path, library, texts)
    shown = {casadi_name(n, model.name): _shown(f) for n, f in found.items()}
    context = {"name": model.name, "version": __version__, "functions": shown, "first": next(iter(shown))}
    texts["README.md"] = render("casadi/README.md.jinja", context)
    listed = [*texts, "model.json", library]
    record = {"generator": "ordernm", "version": __version__, "export": "casadi", "name": model.name, "files": listed}
    write_folder(path, texts | {"model.json": json_text(record | {"functions": shown})}, keep)
    progress("compiling", 0, 0)
    os.replace(build(path, model.name), path / library)
    return ExportedCasadi(path, path / library, tuple(sorted(listed[:-1])), shown)


def _refuse_opened(folder: Path, library: str, texts: Mapping[str, str]) -> None:
    """Raise an error if this process has opened the library: the same path, opened again, would give the old functions.

    Raises
    ------
    BridgeError
    """
    known = getattr(os, "RTLD_NOLOAD", None)
    if known is None or not (folder / library).exists():
        return
    if all((folder / f).is_file() and (folder / f).read_text(encoding="utf-8") == text for f, text in texts.items()):
        return
    try:
        opened = _ctypes.dlopen(str(folder / library), os.RTLD_LAZY | known)
    except OSError:  # it is not open
        return
    _ctypes.dlclose(opened)
    raise BridgeError(
        f"this process has opened {folder / library}, and would go on using its old functions; delete all functions of "
        "the library, export into another folder, or start a new process"
    )


def _chosen(model: Model, functions: Sequence[str] | str | None) -> list[str]:
    """The functions by name.

    Raises
    ------
    BridgeError
    """
    if not model.nq:
        raise BridgeError(
            f"{model.name}: the model has no degree of freedom, so there is no state for a function of CasADi"
        )
    has = {"outputs": bool(model.outputs), "closure": bool(model.loops), "inverse_dynamics": not model.loops}
    known = [n for n in BRIDGED if has.get(n, True)]
    given = functions.split(",") if isinstance(functions, str) else known if functions is None else list(functions)
    for name in given:
        if name not in known:
            raise BridgeError(
                f"functions: {model.name} has no function {name!r} for CasADi; allowed are {', '.join(known)}"
                f"{nearest(name, known)}"
            )
    return given


def _generated(model: Model, names: Sequence[str], package: Path, progress: Progress) -> None:
    """Generates a package of some functions with first derivatives, and with second derivatives if the model has
    these."""
    needed = [x for n in names for x in (n, *BRIDGED[n]) if x]
    second = [SECOND[n] for n in names if n in SECOND]
    options: dict[str, Any] = {"target": "c", "compile": False, "progress": progress}
    while True:
        try:
            generate(model, package, functions=[*needed, *second], **options)
            return
        except UnknownFunctionError as error:
            if error.function not in second:
                raise
            second.remove(error.function)


def _shown(f: Bridged) -> str:
    """Arguments and result of a function, for people."""
    given = ", ".join(f"{a}[{f.size(a)}]" for a in f.arguments)
    return f"({given}) -> {f.value.results[0]}[{f.rows}]{', second' if f.second else ''}"
