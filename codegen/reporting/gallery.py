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
    "Times per state of a batch; errors against the generic engine in extended precision, the worst of all states. Each report "
    "says what it left out."
)

FAILURES = (ModelError, FolderError, CompileError, AssemblyError, np.linalg.LinAlgError, ArithmeticError)
"""Errors that are of one model, and leave the others as they are."""


def write_gallery(
    folder: Path, target: Path, request: Request, progress: Progress, force: bool = False
) -> dict[str, str]:
    """Reports of all ``*.yaml`` in a folder, each in a folder of its own beside ``index.html``.

    A model that cannot be read, compiled or computed costs no other one its report.

    Returns
    -------
    dict of str to str
        Models that there is no report of, and why.

    Raises
    ------
    FolderError
        There are no models, or something else stands where the gallery is to be.
    """
    files = sorted(folder.glob("*.yaml"))
    if not files:
        raise FolderError(f"{folder} holds no model files (*.yaml)")
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
        _write(folder, target, rows, failed)  # after each: what is there can be looked at meanwhile
    return failed


def row(name: str, data: dict[str, Any]) -> list[str]:
    """What the list shows of a report."""
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
            f"{target} holds {', '.join(foreign[:5])}, which no gallery wrote; choose another folder with -o, or --force to "
            f"leave that where it is"
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
