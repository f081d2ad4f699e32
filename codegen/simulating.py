"""``ordernm simulate``: from a model file or a generated package to a motion, its table, file and plot.

Output files are checked before the work starts, so that an unwritable file or a missing optional package is reported before a
long simulation.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arguments import number
from .cached_solver import read, solver_of
from .choices import more_choices
from .ending import NUMBERS_FAILED, Failure
from .own_files import add_force, refuse_foreign_file
from .terminal import StatusLine
from .wording import decimal_comma

if TYPE_CHECKING:
    from .ending import Ending
    from .runtime import Solver, Trajectory

SAMPLES, MOST_SAMPLES = 201, 10_000_000
"""Default and maximum number of times in a trajectory."""

METHODS = ("dop853", "rk4", "radau")

TOLERANCE = 1e-9
"""Default relative and absolute tolerance."""

ROWS, COLUMNS = 24, 6
"""Maximum number of rows, and of derivative columns, in the table of final values."""


class RequestError(Failure, ValueError):
    """Raised if the command line requests something impossible."""


class MotionError(Failure, ArithmeticError):
    """Raised if a motion cannot be computed: a loop does not close, a joint is singular, or steps become too small."""

    code = NUMBERS_FAILED


BETWEEN = ("linear", "hold", "cubic", "quintic")
"""Kinds of interpolation between the times of signals in files."""


@dataclasses.dataclass
class Run:
    """The result of a simulation.

    Attributes
    ----------
    trajectory : Trajectory
    end : float
        Requested end time, s.
    written : list of Path
    failed : OSError, ValueError or None
        Error while writing a file; the simulation itself succeeded.
    lines : list of str
        Lines to print.
    """

    trajectory: Trajectory
    end: float
    written: list[Path] = dataclasses.field(default_factory=list)
    failed: OSError | ValueError | None = None
    lines: list[str] = dataclasses.field(default_factory=list)

    @property
    def reached(self) -> float:
        """Time reached by the motion, s; its last sample may be earlier."""
        return float(self.trajectory.stats["t"])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of ``ordernm simulate``."""
    parser.add_argument("model", help="model file (YAML), or generated package")
    parser.add_argument("-t", "--time", type=number, metavar="SECONDS", help="end of the motion, which starts at 0")
    sampled = parser.add_mutually_exclusive_group()
    sampled.add_argument(
        "--samples",
        type=int,
        metavar="N",
        help=f"number of equidistant times from 0 to the end (default: {SAMPLES})",
    )
    sampled.add_argument(
        "--at",
        metavar="T,...",
        help="these times, such as 0,0.1,0.5; 0 and the end given by -t are added if missing",
    )
    parser.add_argument(
        "--sensitivities",
        metavar="NAME,...",
        default="",
        help="parameters with respect to which the motion is differentiated",
    )
    parser.add_argument(
        "-p",
        "--parameter",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="value of a design parameter, in SI units (default: as in the model)",
    )
    parser.add_argument(
        "--inputs",
        metavar="NAME=VALUE|FILE",
        action="append",
        default=[],
        help="a constant input, or signals over time: a .csv file whose first line has names (t and inputs), or a .npz file of "
        "arrays with these names; missing inputs are 0",
    )
    parser.add_argument(
        "--between",
        metavar="[NAME=]KIND",
        action="append",
        default=[],
        help=f"interpolation of signals: {', '.join(BETWEEN)} (default: {BETWEEN[0]}); for one input or for all",
    )
    parser.add_argument("--method", choices=METHODS, default=METHODS[0], help="the integrator (default: %(default)s)")
    parser.add_argument("--step", type=number, metavar="SECONDS", help="step of rk4, first step of other methods")
    for name, kind in (("rtol", "relative"), ("atol", "absolute")):
        parser.add_argument(
            f"--{name}", type=number, help=f"{kind} tolerance of dop853 and radau (default: {TOLERANCE:g})"
        )
    parser.add_argument("-o", "--output", metavar="FILE", help="write the trajectory: .npz, .parquet")
    parser.add_argument("--plot", metavar="FILE", help="draw outputs and their derivatives: .svg, .png, .pdf")
    add_force(parser)


def simulate(options: argparse.Namespace, status: StatusLine, remarks: list[str], width: int | None = None) -> Run:
    """Run ``ordernm simulate``, except for printing.

    Parameters
    ----------
    options : argparse.Namespace
        Contains the `Ending` of the command as ``ending``: at the end of the motion signals are deferred, so that results are
        written.
    remarks : list of str
        Receives warnings, also if an error ends the work.
    width : int, optional
        Maximum width of the printed lines.

    Raises
    ------
    RequestError, ImportError
        For impossible requests, before any work is done; also for arguments that `Solver.simulate` rejects.
    MotionError
    ModelError, FolderError, SingularJointError, CompileError, NoCompilerError, PackageError, TargetsDifferError
        Errors of `codegen.generate` and `codegen.load`.
    """
    times = times_of(options)
    ending: Ending = options.ending
    p, inputs = numbers_by_name("-p", options.parameter), inputs_of(options)
    sensitivities = tuple(name.strip() for name in options.sensitivities.split(",") if name.strip())
    if options.sensitivities and not sensitivities:
        raise RequestError(
            f"--sensitivities {options.sensitivities}: expected names of parameters, separated by commas"
        )
    steps = _steps(options)
    writers = _writers(options)

    def progress(t: float, end: float) -> None:
        ending.deferred = t >= end  # before the end, the integrator keeps partial results
        status.share(f"simulating, t = {t:.4g} of {end:.4g} s", t / end if end else 1.0)

    def moved(solver: Solver) -> Trajectory:
        status("simulating", 0, 0)
        with motion_errors():
            return solver.simulate(
                times, p=p or None, inputs=inputs or None, sensitivities=sensitivities, method=options.method,
                on_failure="return", progress=progress, **steps,
            )  # fmt: skip

    with contextlib.ExitStack() as stack:
        trajectory = _with_choices(options, status, remarks, moved, stack)
        ending.deferred = True
        done = Run(trajectory, times[-1])
        for path, write in writers if len(trajectory) else ():
            status(f"writing {path}", 0, 0)
            try:  # an error here affects neither other files nor the table
                refuse_foreign_file(path, options.force)  # the path is tested again, because a motion may take hours
                write(trajectory)
                done.written.append(path)
            except (OSError, ValueError) as error:  # without coordinates, a model cannot be plotted
                done.failed = done.failed or error
        done.lines = lines_of(done, width)  # units are read from the package, which may be in a temporary folder
    return done


def _with_choices(
    options: argparse.Namespace,
    status: StatusLine,
    remarks: list[str],
    moved: Callable[[Solver], Trajectory],
    stack: contextlib.ExitStack,
) -> Trajectory:
    """The simulated motion. If it ends at a dead point, the motion is repeated with more choices of independent
    coordinates."""
    with _remarks(remarks):
        model = read(options.model, status)
        solver = stack.enter_context(solver_of(model, status))
        trajectory = moved(solver)
    held = 1
    while not isinstance(model, Path) and (more := more_choices(solver, trajectory, held)):
        options.ending.deferred, held = False, more
        again = [
            f"the dependent coordinates were poorly determined at t = {trajectory.stats['t']:.6g} s, as at a dead point: "
            f"generated a solver with {held} choices of independent coordinates, and repeated the motion"
        ]
        try:
            with _remarks(again):
                solver = stack.enter_context(solver_of(model, status, partitions=held))
                trajectory = moved(solver)
        except KeyboardInterrupt:  # the second motion has no results yet; the first one is returned
            break
        remarks[:] = again
    return trajectory


@contextlib.contextmanager
def _remarks(remarks: list[str]) -> Iterator[None]:
    """Python's warnings in the block, without repetitions."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            yield
        finally:
            remarks += dict.fromkeys(str(w.message) for w in caught)


@contextlib.contextmanager
def motion_errors() -> Iterator[None]:
    """Converts errors of `Solver.simulate` to errors of the request or of the motion."""
    from numpy.linalg import LinAlgError

    from .runtime import AssemblyError, CompileError, NoCompilerError

    try:
        yield
    except (CompileError, NoCompilerError):
        raise
    except (LinAlgError, AssemblyError, ArithmeticError, RuntimeError) as error:
        # caught before ValueError, of which LinAlgError and AssemblyError are subclasses
        raise MotionError(str(error)) from error
    except (ValueError, KeyError, AttributeError) as error:  # an AttributeError: the package has no method simulate
        raise RequestError(str(error)) from None


# -- requests -----------------------------------------------------------------------------------------------------------


def times_of(options: argparse.Namespace) -> list[float]:
    """Times of the trajectory, from 0 to the end, s."""
    end = None if options.time is None else _positive("-t", options.time)
    if options.at is None:
        if end is None:
            raise RequestError("the end of the motion is missing; give -t SECONDS, or times by --at")
        n = SAMPLES if options.samples is None else options.samples
        if n < 2:
            raise RequestError(f"--samples is {n}; at least 2 are needed, for the start and the end")
        if n > MOST_SAMPLES:
            raise RequestError(f"--samples is {n}; at most {MOST_SAMPLES} are allowed")
        return [end * i / (n - 1) for i in range(n)]
    if options.samples is not None:
        raise RequestError("--samples and --at both define the times; give only one of them")
    times: list[float] = []
    for text in options.at.split(","):
        try:
            t = float(text)
        except ValueError:
            raise RequestError(
                f"--at: {text.strip()!r} is not a number; expected a list such as --at 0,0.1,0.5"
            ) from None
        if not (math.isfinite(t) and t >= 0):
            raise RequestError(f"--at: {text.strip()} is not a valid time; times must not be negative")
        if times and t <= times[-1]:
            raise RequestError(f"--at: {t:g} follows {times[-1]:g}; times must increase")
        times.append(t)
    if end is not None and times[-1] > end:
        raise RequestError(f"--at: {times[-1]:g} is after the end, -t {end:g}")
    times += [end] if end is not None and times[-1] < end else []
    times = times if times[0] == 0 else [0.0, *times]
    if len(times) < 2:
        raise RequestError("--at 0 is only the initial state; give a later time")
    return times


def numbers_by_name(option: str, given: Sequence[str]) -> dict[str, float]:
    """Converts ``NAME=VALUE``, repeated or separated by commas, to a mapping."""
    found: dict[str, float] = {}
    for whole, part in ((several, x) for several in given for x in several.split(",")):
        name, is_there, text = (x.strip() for x in part.partition("="))
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (name and is_there and math.isfinite(value)):
            raise RequestError(
                f"{option} {part}: expected NAME=VALUE with a finite number in SI units (80 mm is 0.08), such as "
                f"{option} length=1.2{'' if is_there else decimal_comma(whole)}"
            )
        if name in found:
            raise RequestError(f"{option}: {name} is given twice, as {found[name]:g} and {value:g}")
        found[name] = value
    return found


def inputs_of(options: argparse.Namespace) -> dict[str, Any]:
    """Constants and signals of a request, by the names of the inputs."""
    from .signal_files import SUFFIXES, SignalFileError, is_signal_file, joined, read_signals

    for text in options.inputs:
        if "=" not in text and not is_signal_file(text):
            raise RequestError(
                f"--inputs {text}: expected NAME=VALUE with a finite number, or a signal file, {' or '.join(SUFFIXES)}"
            )
    files = [x for x in options.inputs if is_signal_file(x)]
    inputs: dict[str, Any] = dict(numbers_by_name("--inputs", [x for x in options.inputs if x not in files]))
    kinds: dict[str, str] = {}
    for part in (x.strip() for several in options.between for x in several.split(",")):
        name, _, kind = part.rpartition("=")
        if kind not in BETWEEN:
            raise RequestError(f"--between {part}: expected one of {', '.join(BETWEEN)}, or NAME= and one of them")
        if name in kinds:
            raise RequestError(f"--between: {f'{name} is' if name else 'the kind of all inputs is'} given twice")
        kinds[name] = kind
    if kinds and not files:
        raise RequestError("--between applies to signals, but --inputs names no .csv or .npz file")
    signals = {}
    for path in files:
        try:
            t, found = read_signals(path)
        except SignalFileError as error:
            raise RequestError(f"--inputs {error}") from None
        for name, x in found.items():
            if name in inputs or name in signals:
                raise RequestError(f"--inputs {path}: {name} is given twice")
            signals[name] = (t, x)
    if unknown := [name for name in kinds if name and name not in signals]:
        raise RequestError(f"--between {unknown[0]}: no file has this signal; available are {', '.join(signals)}")
    return inputs | joined(signals, kinds, kinds.get("", BETWEEN[0]))


def _steps(options: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `Solver.simulate` for step sizes: tolerances, and a step if given."""
    given = {name: getattr(options, name) for name in ("rtol", "atol", "step") if getattr(options, name) is not None}
    given = {name: _positive(f"--{name}", value) for name, value in given.items()}
    if options.method != "rk4":
        return {"rtol": TOLERANCE, "atol": TOLERANCE} | given
    if tolerances := [f"--{name}" for name in given if name != "step"]:
        raise RequestError(
            f"--method rk4 has constant steps and no error control; leave out {' and '.join(tolerances)}"
        )
    if "step" not in given:
        raise RequestError("--method rk4 takes constant steps: give --step SECONDS, such as --step 0.001")
    return given


def _positive(option: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0):
        raise RequestError(f"{option} is {value:g}; expected a positive number")
    return value


def _writers(options: argparse.Namespace) -> list[tuple[Path, Callable[[Trajectory], object]]]:
    """The files to write, with functions that write them; raises RequestError or ImportError if a file cannot be
    written."""
    from .runtime.standalone.trajectory import files as trajectory_files
    from .runtime.standalone.trajectory import plot as trajectory_plot

    try:
        if options.output is not None:
            trajectory_files.need(trajectory_files.suffix_of(options.output))
        if options.plot is not None:
            trajectory_plot.suffix_of(options.plot)
            trajectory_plot.need()
    except ValueError as error:
        raise RequestError(str(error)) from None
    found: list[tuple[Path, Callable[[Trajectory], object]]] = []
    if options.output is not None:
        found.append((Path(options.output), lambda x: x.save(options.output)))
    if options.plot is not None:
        found.append((Path(options.plot), lambda x: x.plot(path=options.plot)))
    if options.force and not found:
        raise RequestError("--force applies to the files of -o and --plot, but neither is given")
    for path, _ in found:
        refuse_foreign_file(path, options.force)
    return found


# -- printed lines -------------------------------------------------------------------------------------------------------


def lines_of(run: Run, width: int | None) -> list[str]:
    """A summary of the trajectory, and the final values of outputs (or of coordinates, without outputs) with derivatives."""
    from .summary import table

    x = run.trajectory
    lines = x.lines()
    if not len(x):
        return lines
    names = x.output_names or x.names
    by = x.sensitivity_names[:COLUMNS]
    units = [x.unit(name) for name in names]
    has_units = any(units)
    header = [f"at t = {x.t[-1]:.6g} s", "value", *["unit"][:has_units], *(f"d / d {name}" for name in by)]
    rows = [
        [name, f"{x[name][-1]:.8g}", *[unit][:has_units], *(f"{x.derivative(name, d)[-1]:.8g}" for d in by)]
        for name, unit in zip(names, units, strict=True)
    ]
    lines += table(header, rows[:ROWS], width)
    if len(rows) > ROWS:
        lines.append(f"  and {len(rows) - ROWS} more")
    if len(x.sensitivity_names) > COLUMNS:
        lines.append(f"  and derivatives with respect to {len(x.sensitivity_names) - COLUMNS} more")
    if run.written:
        lines.append(f"  written: {', '.join(map(str, run.written))}")
    return lines
