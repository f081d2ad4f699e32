"""``ordernm report``: options and output of the command."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..arguments import number
from ..ending import MODEL_WRONG, NUMBERS_FAILED, OK, Failure
from ..own_files import add_force

if TYPE_CHECKING:
    from ..terminal import StatusLine

Reports = dict[str, dict[str, Any]]
"""Reports by the names of their models' files."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``ordernm report``."""
    parser.add_argument("model", help="model file (YAML), or a folder of them")
    parser.add_argument("-o", "--output", metavar="DIR", default="report", help="folder to write (default: ./report)")
    parser.add_argument(
        "-t", "--time", type=number, metavar="SECONDS", default=5.0, help="duration of the motions (default: 5)"
    )
    parser.add_argument(
        "--compare",
        metavar="OLD",
        help="list the differences from an earlier report or gallery: its folder, or report.json",
    )
    add_force(parser)


def run(options: argparse.Namespace, status: StatusLine) -> tuple[list[str], list[str], int]:
    """Write a report of a model, or of all models of a folder, and compare it with an earlier one.

    Returns
    -------
    lines, problems : list of str
    code : int
        The exit code.
    """
    from . import Request, report, write_gallery
    from .agreement import read, read_gallery

    if not 0 < options.time < float("inf"):
        raise Failure(f"--time is {options.time:g}; give a positive number of seconds")
    request, model, target = Request(end=options.time), Path(options.model), Path(options.output)
    # before the work: the new report may replace the old one
    old = _earlier_reports(options, status) if options.compare is not None else {}
    if not model.is_dir():
        data = report(model, target, request=request, progress=status, force=options.force)
        lines = [f"wrote {target / 'index.html'}, report.md, report.json"]
        lines += [f"left out: {s['text']}" for s in data["skipped"]]
        differences, code = _differences({name: (x, read(target)) for name, x in old.items()})
        return lines + differences, [], code
    failed = write_gallery(model, target, request, status, options.force)
    new = read_gallery(target) if old else {}
    lines = [f"wrote {target / 'index.html'}"]
    for name in sorted(new.keys() ^ old.keys()) if old else ():
        lines.append(f"{name}: there is no {'earlier' if name in new else 'new'} report to compare")
    differences, code = _differences({name: (x, new[name]) for name, x in old.items() if name in new})
    problems = [f"report: {name}: {why}" for name, why in failed.items()]
    return lines + differences, problems, MODEL_WRONG if failed else code


def _earlier_reports(options: argparse.Namespace, status: StatusLine) -> Reports:
    """The reports to compare with. Raises Failure if they belong to another model or machine."""
    from ..measure.machine import machine
    from ..model import load_model
    from .agreement import NoReportError, incomparable, read, read_gallery

    earlier, model = Path(options.compare), Path(options.model)
    try:
        old = read_gallery(earlier) if model.is_dir() else {model.stem: read(earlier)}
    except NoReportError as error:
        raise Failure(f"--compare: {error}") from None
    status("reading", 0, 0)
    here = {"machine": machine()}
    for name, found in old.items():
        file = model / f"{name}.yaml" if model.is_dir() else model
        if not model.is_dir() or file.is_file():
            new = here | {"model": load_model(file).name if file.is_file() else found["model"]}
            if why := incomparable(found, new):
                raise Failure(f"--compare: {earlier}: {why}")
    return old


def _differences(pairs: dict[str, tuple[dict[str, Any], dict[str, Any]]]) -> tuple[list[str], int]:
    """Differences from earlier reports, by name, and the exit code."""
    from .agreement import agreed, disagreements

    found = {name: disagreements(*pair) for name, pair in pairs.items()}
    lines = [f"{name}: {x}" for name, several in found.items() for x in several or [agreed(*pairs[name])]]
    return lines, NUMBERS_FAILED if any(found.values()) else OK
