"""``ordernm bench``: options of the command, and the function that runs it."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..folders import FolderError
from ..own_files import add_force, refuse_foreign_file

if TYPE_CHECKING:
    from ..terminal import StatusLine
    from .problem import Problem


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``ordernm bench``."""
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="problems to measure (default: all); motions or families selects a kind",
    )
    parser.add_argument("--list", action="store_true", help="print the names of the problems")
    parser.add_argument(
        "--quick", action="store_true", help="measure only a small part of each problem, which takes less time"
    )
    parser.add_argument(
        "--peers", action="store_true", help="also measure other programs, if installed, on the same models"
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="write the results as JSON after every problem")
    parser.add_argument("--compare", metavar="OLD", help="compare with an earlier run (JSON)")
    parser.add_argument(
        "--results",
        metavar="FILE",
        action="append",
        help="print an earlier run (JSON) without measuring; several are combined",
    )
    parser.add_argument(
        "--plots", metavar="FOLDER", help="draw time by size, a roofline, and robots beside Pinocchio (SVG)"
    )
    parser.add_argument("--page", metavar="FILE", help="write the results as a page of the manual (Markdown)")
    add_force(parser)


def bench(options: argparse.Namespace, status: StatusLine) -> tuple[list[str], list[str]]:
    """Run the command, except for printing.

    Returns
    -------
    lines, failures : list of str
        Lines to print, and failed checks.

    Raises
    ------
    UnknownProblemError, ResultsError, FolderError
        Before anything is measured.
    CompileError, NoCompilerError, OSError
    """
    from ..runtime.standalone.files.whole_file import write_whole
    from ..terminal import width
    from .catalogue import chosen
    from .lines import compare_lines, failures, list_lines
    from .results import DAMAGE, ResultsError, read_results, write_results

    problems = chosen(options.names)
    if options.list:
        _refuse_beside_list(options)
        return list_lines(problems), []
    if options.plots is not None and options.results is None and not any(_is_drawn(p, options.quick) for p in problems):
        raise ResultsError(
            "--plots: no selected problem has a picture; select a family (without --quick) or robots, or leave out --plots"
        )
    old = None if options.compare is None else read_results(Path(options.compare))
    _refuse_places(options)
    columns = width(sys.stdout)
    results = _measured(problems, options, status) if options.results is None else _earlier(options)
    try:
        lines, page, pictures = _shown(results, options, columns)
    except DAMAGE as error:
        if options.results is None:
            raise
        several = ", ".join(options.results)
        raise ResultsError(f"{several}: damaged, or of another version: {type(error).__name__}: {error}") from None
    _refuse_places(options)  # again: files may have changed during the measurement
    if options.output is not None:
        write_results(results, Path(options.output))
    if options.plots is not None:
        from .plots import write_plots

        if not pictures:
            raise ResultsError("--plots: the results contain no picture; only families and robots have one")
        write_plots(pictures, Path(options.plots))
    if options.page is not None:
        write_whole(Path(options.page), lambda file: file.write(page.encode()))
    if old is not None:
        lines += ["", *compare_lines(results, old, columns)]
    return lines, failures(results["problems"])


def _measured(problems: list[Problem], options: argparse.Namespace, status: StatusLine) -> dict[str, Any]:
    """Runs the problems and returns their results; after every problem, writes all results so far."""
    from .results import write_results

    def keep(results: dict[str, Any]) -> None:
        if options.output is not None:
            write_results(results, Path(options.output))

    return run(problems, options.quick, options.peers, status, keep)


def _earlier(options: argparse.Namespace) -> dict[str, Any]:
    """The results of earlier runs, combined into one."""
    from .results import ResultsError, joined, read_results

    if options.names or options.quick or options.peers:
        raise ResultsError(
            "--results takes an earlier run; leave out names, --quick and --peers, which start a new one"
        )
    return joined([(Path(file), read_results(Path(file))) for file in options.results])


def _shown(
    results: dict[str, Any], options: argparse.Namespace, columns: int | None
) -> tuple[list[str], str, dict[str, str]]:
    """Results as lines, and as page and pictures if requested."""
    from .lines import result_lines
    from .page import page_of
    from .plots import plots

    page = page_of(results) if options.page is not None else ""
    return result_lines(results, columns), page, plots(results) if options.plots is not None else {}


def _is_drawn(problem: Problem, quick: bool) -> bool:
    """Whether a picture can be drawn from the results of a problem."""
    from .problem import Family, Robots

    if isinstance(problem, Family):
        return len(problem.quick if quick else problem.sizes) > 1
    return isinstance(problem, Robots)


def _refuse_beside_list(options: argparse.Namespace) -> None:
    """Raises ResultsError if an option is given that has no meaning together with ``--list``."""
    from .results import ResultsError

    names = ("quick", "peers", "output", "compare", "results", "plots", "page", "force")
    if given := [f"--{name}" for name in names if getattr(options, name)]:
        raise ResultsError(f"--list only prints names: leave out {', '.join(given)}")


def _refuse_places(options: argparse.Namespace) -> None:
    """Raise ResultsError or FolderError if an output file cannot be written, or is a file that ordernm did not write."""
    from .results import ResultsError

    named = {"-o": options.output, "--page": options.page}
    places = {option: Path(place) for option, place in named.items() if place is not None}
    if options.force and not places and options.plots is None:
        raise ResultsError(
            "--force applies to the files of -o, --page and --plots; give one of them, or leave out --force"
        )
    for option, place in places.items():
        try:
            refuse_foreign_file(place, options.force)
        except FolderError as error:
            raise ResultsError(f"{option}: {error}") from None
    if options.plots is not None:
        from ..runtime.standalone.trajectory.plot import need
        from .plots import refuse_foreign

        try:
            need()
        except ImportError as error:
            raise ResultsError(f"--plots: {error}") from None
        refuse_foreign(Path(options.plots), options.force)


def run(
    problems: list[Any], quick: bool, peers: bool, status: StatusLine, keep: Callable[[dict[str, Any]], None]
) -> dict[str, Any]:
    """Measures problems, and other programs on them; after every problem, calls `keep` with all results so far."""
    from ..measure.clock import one_core
    from ..measure.core import peaks
    from ..measure.machine import machine
    from .measuring import measure
    from .results import FORMAT

    results: dict[str, Any] = {"format": FORMAT, "machine": machine(), "quick": quick, "problems": {}}
    with tempfile.TemporaryDirectory(prefix="ordernm-bench-", ignore_cleanup_errors=True) as folder, one_core():
        for i, problem in enumerate(problems):

            def progress(what: str, done: int = i) -> None:
                status(what, done, len(problems))

            results["problems"][problem.name] = measure(problem, Path(folder), quick, progress, 0.05 if quick else 0.1)
            keep(results)
        if any(r["kind"] == "family" for r in results["problems"].values()):
            status("measuring the peak performance of the core", len(problems), len(problems))
            results["peaks"] = peaks(Path(folder))
        if peers:
            from .peers.comparing import compare_with_peers

            results["peers"] = compare_with_peers(problems, Path(folder), quick, status)
    return results
