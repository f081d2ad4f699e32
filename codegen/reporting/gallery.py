"""A gallery: the reports of all models of a folder, and a page that lists them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from ..folders import FolderError
from ..measure.tables import Section, Table, number, seconds
from ..model.errors import ModelError
from ..own_files import refuse_foreign_file
from ..runtime.standalone.errors import AssemblyError, CompileError
from . import pages
from .measuring import Progress, Request, report

HEAD = [
    "model",
    "bodies",
    "loops",
    "freedoms",
    "udot in C",
    "udot + 8 directions",
    "worst error of udot",
    "of a derivative",
    "left out",
]

MADE = (
    "Times per state of a batch; the worst errors of all states against the generic engine in extended precision. Each report "
    "lists what it left out."
)

FAILURES = (ModelError, FolderError, CompileError, AssemblyError, np.linalg.LinAlgError, ArithmeticError)
"""Errors that concern one model only, after which the other models are still reported."""


def write_gallery(
    folder: Path, target: Path, request: Request, progress: Progress, force: bool = False
) -> dict[str, str]:
    """Write reports of all ``*.yaml`` files in a folder, each into its own folder beside ``index.html``.

    If a model cannot be read, compiled or computed, the others still get their reports.

    Returns
    -------
    dict of str to str
        Models without a report, with the reason.

    Raises
    ------
    FolderError
        If there are no models, or the target holds other files.
    """
    files = sorted(folder.glob("*.yaml"))
    if not files:
        raise FolderError(f"{folder} contains no model files (*.yaml)")
    pages.need()
    _refuse_foreign(target, {f.stem for f in files}, force)
    target.mkdir(parents=True, exist_ok=True)
    rows: list[list[str]] = []
    failed: dict[str, str] = {}
    for i, file in enumerate(files):
        progress(f"{file.stem}", i, len(files))
        try:
            rows.append(row(file.stem, report(file, target / file.stem, request=request, force=force)))
        except FAILURES as error:
            failed[file.stem] = str(error)
        _write(folder, target, rows, failed)  # written after each model, so that finished reports can be read
    return failed


def row(name: str, data: dict[str, Any]) -> list[str]:
    """The row for a report in the list of the gallery."""
    g, times = data["generated"], data.get("times", {}).get("functions", {})
    taken = [seconds(times[n]["compiled"]["least"]) if n in times else "-" for n in ("udot", "udot + 8 directions")]
    errors = data.get("errors") or []
    worst = (
        max((e["udot"] for e in errors), default=None),
        max((max(e["derivatives"].values()) for e in errors), default=None),
    )
    return [name, *(str(g[k]) for k in ("bodies", "loops", "freedoms")), *taken, *(number(x, 2) for x in worst),
            str(len(data["skipped"]))]  # fmt: skip


def _refuse_foreign(target: Path, names: set[str], force: bool) -> None:
    if target.exists() and not target.is_dir():
        raise FolderError(f"{target} is a file; give a folder to write into with -o")
    if target.is_dir():
        refuse_foreign_file(target / pages.PAGE, force)
    foreign = sorted({p.name for p in target.glob("*")} - names - {pages.PAGE})
    if foreign and not force:
        raise FolderError(
            f"{target} contains files that no gallery wrote: {', '.join(foreign[:5])}. Choose another folder with -o, "
            f"or use --force to keep them there"
        )
    for name in sorted(names):
        pages.refuse_foreign(target / name, force)


def _write(folder: Path, target: Path, rows: list[list[str]], failed: dict[str, str]) -> None:
    links = [[Markup('<a href="{0}/index.html">{0}</a>').format(r[0]), *r[1:]] for r in rows]
    sections = [
        Section("Models", [f"No report of {name}: {why}" for name, why in failed.items()], (), [Table("", HEAD, links)])
    ]
    text = pages.page(f"Reports of {folder.resolve().name}", MADE, sections, {})
    (target / pages.PAGE).write_text(text, encoding="utf-8")
