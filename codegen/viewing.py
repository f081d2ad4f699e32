"""``ordernm view``: a mechanism in a browser, as a page, as a picture or as an animation."""

from __future__ import annotations

import argparse
import contextlib
import warnings
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arguments import number
from .cached_solver import read, solver_of
from .ending import OK, Failure
from .own_files import add_force, refuse_foreign_file
from .simulating import RequestError, motion_errors, numbers_by_name
from .terminal import StatusLine

if TYPE_CHECKING:
    from .runtime import Solver, Trajectory

RATE = 30
"""Number of results per second of a motion that is simulated for a view."""

MOST_RESULTS = 100_000
"""Maximum number of results of a motion that is simulated for a view."""

LARGEST_PORT = 65535


def add_view_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``ordernm view``."""
    parser.add_argument("model", help="model file (YAML), or generated package with frames")
    motion = parser.add_mutually_exclusive_group()
    motion.add_argument("-t", "--time", type=number, metavar="SECONDS", help="simulate, and play the motion")
    motion.add_argument("--trajectory", metavar="FILE", help="play the motion of a file: .npz, .parquet")
    parser.add_argument("-p", "--parameter", metavar="NAME=VALUE", action="append", default=[],
                        help="value of a design parameter, in SI units (default: as in the model)")  # fmt: skip
    parser.add_argument(
        "--reactions", action="store_true", help="show arrows of the forces that joints and loops transmit"
    )
    parser.add_argument("--forces", action="store_true", help="show arrows of the forces and torques of force elements")
    parser.add_argument("--html", metavar="FILE", help="write a page that needs no server and no network: .html")
    parser.add_argument("--picture", metavar="FILE", help="draw the initial state: .svg, .png, .pdf")
    parser.add_argument("--animate", metavar="FILE", help="draw the motion: .gif, .png")
    parser.add_argument("--port", type=int, metavar="N", help="port of the view (default: any that is free)")
    parser.add_argument("--no-browser", action="store_true", help="print the address only")
    add_force(parser)


def run_view(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm view``.

    Raises
    ------
    RequestError, FolderError, ImportError
        For impossible requests, before any work is done.
    """
    _check(options)
    with _warnings_printed(status):
        return _shown(options, status)


@contextlib.contextmanager
def _warnings_printed(status: StatusLine) -> Iterator[None]:
    """Prints Python's warnings like those of other commands, without a place in Python files."""

    def show(message: Warning | str, *place: Any, **more: Any) -> None:
        status.after(str(message) if "warning: " in str(message) else f"warning: {message}")

    with warnings.catch_warnings():
        warnings.simplefilter("default", RuntimeWarning)
        warnings.showwarning = show
        yield


def _shown(options: argparse.Namespace, status: StatusLine) -> int:
    model = read(options.model, status)
    folder = Path(options.model).resolve().parent if Path(options.model).is_file() else Path()
    written = _files(options)
    with solver_of(model, status, frames=True, reactions=options.reactions) as solver, motion_errors():
        p = _parameters(solver, options)
        motion = _motion(solver, options, p, status)
        if options.trajectory and motion is not None:
            motion._shown_by(solver)  # refuses a trajectory of another model
        arrows, of_file = _arrows(solver, options), solver if options.trajectory else None
        if options.picture:
            start = motion.q[0] if motion is not None else solver.assemble(*solver.initial, p)[0]
            at, when = (p, 0.0) if motion is None else (motion.p, motion.t[0])
            solver.picture(start, at, t=when, path=options.picture, folder=folder)
        if options.animate and motion is not None:
            motion.animate(options.animate, of_file, folder=folder)
        if options.html and motion is not None:
            motion.html(options.html, of_file, folder=folder, arrows=arrows)
        if not written or (options.html and motion is None):
            if motion is None:
                view = solver.view(p=p, folder=folder, port=options.port or 0, arrows=arrows)
            else:
                view = motion.view(of_file, folder=folder, port=options.port or 0, arrows=arrows)
            with contextlib.closing(view):
                if options.html:
                    view.html(options.html)
                else:
                    _wait(view, options, status)
    status.close()
    for path in written:
        print(f"wrote {path}")
    return OK


def _check(options: argparse.Namespace) -> None:
    """Refuse options that contradict each other, and files that cannot be written."""
    if options.animate and options.time is None and options.trajectory is None:
        raise RequestError("--animate draws a motion: give -t SECONDS, or --trajectory FILE")
    if options.trajectory and options.parameter:
        raise RequestError("-p is for a motion that is computed; the one of --trajectory has its own parameters")
    if options.port is not None and not 0 < options.port <= LARGEST_PORT:
        raise RequestError(f"--port is {options.port}; 1 to {LARGEST_PORT} are allowed")
    if _files(options) and (options.port is not None or options.no_browser):
        raise RequestError(
            "--port and --no-browser are for a view; with --html, --picture or --animate nothing is served"
        )
    if options.force and not _files(options):
        raise RequestError(
            "--force is for files, and nothing is written: leave it out, or give --html, --picture or --animate"
        )
    for name, suffixes in (
        ("html", (".html", ".htm")),
        ("picture", (".svg", ".png", ".pdf")),
        ("animate", (".gif", ".png")),
    ):
        if path := getattr(options, name):
            if Path(path).suffix.lower() not in suffixes:
                raise RequestError(f"--{name} {path}: a name that ends in {' or '.join(suffixes)} is needed")
            refuse_foreign_file(Path(path), options.force)
    if options.picture or options.animate:
        from .runtime.standalone.trajectory.plot import need as need_matplotlib

        need_matplotlib()
    if options.html or not _files(options):
        from .runtime.standalone.display.viewer import need as need_viser

        need_viser()


def _files(options: argparse.Namespace) -> list[str]:
    return [path for path in (options.picture, options.animate, options.html) if path]


def _arrows(solver: Solver, options: argparse.Namespace) -> list[str]:
    """Kinds of arrows that the options select.

    Raises
    ------
    RequestError
        For --forces, if the model has no force element with arrows.
    """
    from .runtime.standalone.display.forces import applied_kinds

    applied = applied_kinds(solver._manifest["display"]) if options.forces else []
    if options.forces and not applied:
        raise RequestError("--forces: no force element of the model has arrows; leave it out")
    return ["reactions"] * options.reactions + applied


def _parameters(solver: Solver, options: argparse.Namespace) -> dict[str, float]:
    """Parameters of the command line, by name."""
    given = numbers_by_name("-p", options.parameter)
    for name in given:
        if name not in solver.parameter_names:
            known = ", ".join(solver.parameter_names) or "none"
            raise RequestError(f"-p {name}: the model has no such parameter; its parameters: {known}")
    return given


def _motion(solver: Solver, options: argparse.Namespace, p: dict[str, float], status: StatusLine) -> Trajectory | None:
    """The motion from a file or a simulation; None if the options ask for a single state."""
    from .runtime import Trajectory
    from .runtime.standalone.trajectory.files import TrajectoryFileError

    if options.trajectory:
        try:
            return Trajectory.load(options.trajectory)
        except TrajectoryFileError as error:
            raise Failure(str(error)) from None
    if options.time is None:
        return None
    if not 0 < options.time < MOST_RESULTS / RATE:
        raise RequestError(f"-t is {options.time:g}; more than 0 s and less than {MOST_RESULTS / RATE:g} s are allowed")
    status("simulating", 0, 0)
    n = max(2, round(options.time * RATE))
    times = [options.time * i / n for i in range(n + 1)]
    with motion_errors():
        return solver.simulate(times, p=p or None)


def _wait(view: Any, options: argparse.Namespace, status: StatusLine) -> None:
    """Open the browser, and wait for Ctrl-C."""
    status.close()
    opened = not options.no_browser and webbrowser.open(view.url)
    print(f"{view.url}" + ("" if opened else "  (open it in a browser)") + "; Ctrl-C ends the view", flush=True)
    view.wait()
