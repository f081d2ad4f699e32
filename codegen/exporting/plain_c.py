"""``ordernm export MODEL --c``: the functions of a solver as plain C for small machines, with a report of their sizes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..c_interface import package_context
from ..emit.c import C
from ..emit.repetition import json_text
from ..emit.templates import render
from ..folders import refuse_foreign, write_folder
from ..generation import check_flags, names_of
from ..model.loading import load_model
from ..model.model import Model
from ..pipeline import write_solver
from ..program.progress import Progress, silent
from ..runtime.standalone.errors import NoCompilerError
from ..version import __version__
from .sizes import Build, Size, measured

CLOSING = "\n`example.c` closes loops by at most 30 rounds of `closure` and `newton_step`."
"""A line of the README for models with loops."""

COLUMNS = ("additions", "multiplications", "divisions", "functions")


@dataclass(frozen=True, slots=True)
class Row:
    """One C function in the report of an export.

    Attributes
    ----------
    name : str
        Name in C, without the model's.
    operations : tuple of int
        Additions, multiplications, divisions, and calls of elementary functions, the same for every state.
    code, stack : int or None
        Bytes of code, and of the stack; None if they were not measured.
    """

    name: str
    operations: tuple[int, ...]
    code: int | None = None
    stack: int | None = None


@dataclass(frozen=True, slots=True)
class ExportedC:
    """A folder of plain C.

    Attributes
    ----------
    folder : Path
    files : tuple of str
        Names of its files.
    scalar : str
        Type of all numbers: ``"float64"`` or ``"float32"``.
    workspace : int
        Bytes of the workspace that a caller passes.
    functions : tuple of Row
    compiler : str
        The build that was measured; empty without a compiler.
    library : tuple of str
        Functions of the C library that the code calls.

    Examples
    --------
    >>> import ordernm, tempfile
    >>> found = ordernm.export_c("examples/pendulum.yaml", tempfile.mkdtemp(), functions="accelerations")
    >>> [row.name for row in found.functions]
    ['accelerations']
    """

    folder: Path
    files: tuple[str, ...]
    scalar: str
    workspace: int
    functions: tuple[Row, ...]
    compiler: str
    library: tuple[str, ...]

    def __repr__(self) -> str:
        return "\n".join(
            [f"{self.folder}: {len(self.files)} files, workspace {self.workspace} bytes", *table(self.functions)]
        )


def export_c(
    model: Model | str | os.PathLike[str],
    folder: str | os.PathLike[str] | None = None,
    *,
    functions: Sequence[str] | str | None = None,
    scalar: str = "float64",
    force: bool = False,
    progress: Progress = silent,
) -> ExportedC:
    """Write the functions of a solver as plain C99, with an example, a CMake file and a report of their sizes.

    Parameters
    ----------
    model : Model or path
        The model, or its file.
    folder : path, optional
        The folder to write. Default: ``exported/NAME``.
    functions : sequence of str, or str with commas, optional
        The functions, as in `generate`. Default: all.
    scalar : {"float64", "float32"}, optional
        Type of all numbers.
    force : bool, optional
        Also write into a folder with other files.
    progress : callable, optional
        Called as ``progress(stage, step, steps)``.

    Returns
    -------
    ExportedC
        The files, and the operations, bytes of code, stack and workspace of each function.

    Raises
    ------
    ModelError
        If the model has no solver, or the scalar type cannot hold its numbers.
    FolderError
        If the folder holds other files.
    CompileError
        If the compiler rejects the code.

    Examples
    --------
    >>> import ordernm, tempfile
    >>> found = ordernm.export_c("examples/four_bar.yaml", tempfile.mkdtemp(), functions="accelerations", scalar="float32")
    >>> found.scalar, found.workspace % 4
    ('float32', 0)
    """
    # long: the docstring describes every argument
    check_flags(force=force)
    model = model if isinstance(model, Model) else load_model(model)
    path = Path("exported", model.name) if folder is None else Path(folder)
    keep = refuse_foreign(path, force)
    names = names_of(functions)
    source = write_solver(model, functions=names, scalar=scalar, progress=progress)
    wanted = (f"{model.name}.c", f"{model.name}.h", f"{model.name}_directions.h")
    code = {file: source.files[file] for file in wanted if file in source.files}
    progress("measuring", 0, 0)
    build, rows = _measured(model.name, code, _rows(source.manifest))
    workspace = C.scalar(scalar).bytes * source.manifest["workspace"]
    files = code | _texts(model, source.manifest, scalar, build, rows)
    compiler, library = (build.compiler, build.library) if build else ("", ())
    found = ExportedC(path, tuple(sorted([*files, "model.json"])), scalar, workspace, rows, compiler, library)
    write_folder(path, files | {"model.json": json_text(_record(model.name, found))}, keep)
    return found


def _measured(name: str, code: Mapping[str, str], rows: tuple[Row, ...]) -> tuple[Build | None, tuple[Row, ...]]:
    """The measured build, or None without a compiler, and the rows with the sizes of functions."""
    try:
        build = measured(code, f"{name}.c", [f"{name}_{row.name}" for row in rows])
    except NoCompilerError:
        return None, rows
    return build, tuple(_with_size(row, build.sizes[f"{name}_{row.name}"]) for row in rows)


def _with_size(row: Row, size: Size) -> Row:
    return Row(row.name, row.operations, size.code, size.stack) if size.code else row


def _texts(
    model: Model, manifest: Mapping[str, Any], scalar: str, build: Build | None, rows: Sequence[Row]
) -> dict[str, str]:
    """All files of an export except the code."""
    of = C.scalar(scalar)
    context = {
        "name": model.name, "NAME": model.name.upper(), "version": __version__, "scalar": of.words,
        "numbers": manifest["workspace"], "workspace": of.bytes * manifest["workspace"], "report": table(rows),
        "measured": _how_measured(build), "closing": CLOSING if model.loops else "", **package_context(model, manifest),
    }  # fmt: skip
    return {
        f"{model.name}_model.h": render("package/model.h.jinja", context),
        "example.c": "".join(f"{line}\n" for line in context["program"]),
        "CMakeLists.txt": render("export/CMakeLists.txt.jinja", context),
        "README.md": render("export/README.md.jinja", context),
    }


def _how_measured(build: Build | None) -> str:
    """The sentence that says which build the sizes of a report belong to."""
    if build is None:
        return "There was no C compiler to measure code and stack."
    library = ", ".join(build.library) or "none"
    return (
        f"Code and stack are those of `{build.compiler}`.\nThey include all called functions except those of the C library: "
        f"{library}."
    )


def table(rows: Sequence[Row]) -> list[str]:
    """The report of functions as lines of a Markdown table."""
    measured_too = any(row.code is not None for row in rows)
    head = ("function", *COLUMNS, *(("bytes of code", "bytes of stack") if measured_too else ()))
    lines = [f"| {' | '.join(head)} |", f"| --- |{' ---: |' * (len(head) - 1)}"]
    for row in rows:
        sizes = ("?" if x is None else str(x) for x in (row.code, row.stack)) if measured_too else ()
        lines.append(f"| {' | '.join([row.name, *map(str, row.operations), *sizes])} |")
    return lines


def _rows(manifest: Mapping[str, Any]) -> tuple[Row, ...]:
    """One row for each C function; functions along directions have one for each number of directions."""
    rows = []
    for name, function in manifest["functions"].items():
        by_sweep = [manifest["operations"][sweep] for sweep in function.get("sweeps", ())]
        once = [sum(of["per_call"].get(c, 0) for of in by_sweep) for c in COLUMNS]
        each = [sum(of.get("per_direction", {}).get(c, 0) for of in by_sweep) for c in COLUMNS]
        for width in function.get("widths", (0,)):
            operations = tuple(a + (width or 1) * b for a, b in zip(once, each, strict=True)) if width else tuple(once)
            rows.append(Row(f"{name}_{width}" if width else name, operations))
    return tuple(rows)


def _record(name: str, found: ExportedC) -> dict[str, Any]:
    """The content of ``model.json``, by which a later export recognises its own files."""
    return {
        "generator": "ordernm", "version": __version__, "export": "c", "name": name, "files": list(found.files),
        "scalar": found.scalar, "workspace_bytes": found.workspace, "compiler": found.compiler,
        "functions": [
            {"name": r.name, **dict(zip(COLUMNS, r.operations, strict=True)), "code": r.code, "stack": r.stack}
            for r in found.functions
        ],
    }  # fmt: skip
