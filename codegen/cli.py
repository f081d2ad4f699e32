"""The command line: ``generate model.yaml`` and ``ordernm COMMAND``.

Exit codes: 0 ok, 1 error in the model, 2 wrong usage, 3 compilation failed, 4 numerical failure; 128 plus the number of a signal
that ended the command, 130 for Ctrl-C.
"""

from __future__ import annotations

import argparse
import atexit
import contextlib
import gc
import os
import signal
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from .ending import COMPILING_FAILED, MODEL_WRONG, NUMBERS_FAILED, OK, SIGNALLED, USAGE, Ending, Failure
from .folders import OTHERS
from .own_files import add_force
from .terminal import StatusLine, width, write_lines
from .version import __version__

COMPUTING = ("simulate", "report", "bench")
"""Commands that may need NumPy's threads, for large matrices."""

PROBLEMS = 50
"""Maximum number of problems of a model that are printed."""


def _generate_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("model", help="model file (YAML)")
    parser.add_argument("-o", "--output", metavar="DIR", help="package to write (default: ./generated/NAME)")
    parser.add_argument(
        "--target", choices=("c", "numpy", "both"), default="c", help="code that the package's Solver runs"
    )
    parser.add_argument("--scalar", choices=("float64", "float32"), default="float64",
                        help="scalar type of the C code; float32 packages do not integrate motions")  # fmt: skip
    parser.add_argument("--layout", choices=("auto", "kinds", "unrolled"), default="auto",
                        help="one C function per kind of link, or one per link")  # fmt: skip
    parser.add_argument(
        "--partitions",
        type=int,
        choices=range(1, len(OTHERS) + 2),
        default=1,
        help="number of choices of independent coordinates, which are exchanged at dead points",
    )
    parser.add_argument(
        "--reactions",
        action="store_true",
        help="include wrenches transmitted by joints and loops, with derivatives",
    )
    parser.add_argument(
        "--frames", action="store_true", help="include motions of all bodies and of points fixed in them"
    )
    parser.add_argument(
        "--functions",
        metavar="NAME,...",
        help="functions to generate (default: all): accelerations, sensitivities, gradients, outputs, ...; or groups: "
        "dynamics, rates, mass, forces, states, statics, frames, simulate, motion (simulate and its adjoint)",
    )
    parser.add_argument("--no-check", action="store_true", help="do not compare with the generic engine")
    compiling = parser.add_mutually_exclusive_group()
    compiling.add_argument("--no-compile", action="store_true", help="write the sources only")
    compiling.add_argument(
        "--compile-all",
        action="store_true",
        help="compile all functions now; otherwise, less common ones are compiled at their first call",
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="print passes and operations of every sweep")
    add_force(parser)


def _problem(text: object) -> None:
    """Prints an error message to stderr."""
    write_lines(str(text).splitlines(), sys.stderr)


def _tolerate_terminal() -> None:
    """Prevents errors on output: a terminal without Unicode shows ``?``, and closed streams are replaced."""
    for name, mode in (
        ("stdin", "r"),
        ("stdout", "w"),
        ("stderr", "w"),
    ):  # in the order of the file descriptors: each file opened takes the lowest free one
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115
    with contextlib.suppress(AttributeError):  # stdout may be replaced by another stream
        sys.stdout.reconfigure(errors="replace")  # type: ignore[union-attr]


def _wrong(error: Any) -> None:
    """Prints the first problems of a model, at most `PROBLEMS`."""
    from .summary import first

    for line in first(error.problems, PROBLEMS, "and {} more problems; solve these first"):
        _problem(line)
    _explain(error)


def _explain(error: BaseException) -> None:
    """Prints the address of the section that explains an error, if there is such a section."""
    from .explanations import explanation

    if line := explanation(error):
        _problem(line)


def run_generate(options: argparse.Namespace, status: StatusLine) -> int:
    """Runs ``generate``."""
    from .generation import generate
    from .mechanics.procedures import UnknownFunctionError

    if options.compile_all and options.target == "numpy":
        raise Failure("--compile-all compiles the C, which --target numpy does not use; leave out one of them")
    if options.scalar != "float64" and options.target != "c":
        raise Failure(f"--scalar {options.scalar} needs --target c: NumPy has float64; leave out one of them")
    try:
        report = generate(
            options.model, options.output, options.target, options.layout, partitions=options.partitions,
            reactions=options.reactions,
            frames=options.frames,
            functions=options.functions,
            scalar=options.scalar,
            compile="all" if options.compile_all else not options.no_compile,
            check=not options.no_check and not options.no_compile,
            progress=status, force=options.force,
        )  # fmt: skip
    except UnknownFunctionError as error:
        raise Failure(str(error)) from None
    status.close()
    print_report(report, options.verbose)
    return _verdict(report)


def _verdict(report: Any) -> int:
    if bad := report.disagreeing:
        _problem(f"the results differ from those of the generic engine: {bad}; please report this with the model")
        return NUMBERS_FAILED
    return OK


def print_report(report: Any, verbose: bool = False) -> None:
    """Prints the report of `generate`."""
    lines = report.lines(verbose, width(sys.stdout))
    remarks = {f"  {remark}" for remark in report.remarks}
    name = f"{report.name}  {report.folder}"
    styles = ["warning" if s in remarks or "warning: " in s else "bold" if s.startswith(name) else "" for s in lines]
    write_lines(lines, sys.stdout, styles)


def run_check(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm check``: reads a model, closes its loops, and lists problems."""
    from .pipeline import look_ahead
    from .summary import first
    from .wording import counted

    model = _load(options.model, status)
    chosen = _choose(model, options.model, status)
    status("expanding", 0, 0)
    look_ahead(model, chosen)
    status.close()
    warnings = first(model.warnings, PROBLEMS, "warning: {} more like these")
    sizes = ", ".join((counted(len(model.bodies), "body", "bodies"), counted(model.nq, "coordinate"),
                       counted(model.nu, "speed")))  # fmt: skip
    lines = [*warnings, f"{options.model}: {sizes}: ok", *(f"  {line}" for line in _described(model, chosen))]
    write_lines(lines, sys.stdout, ["warning" if "warning: " in line else "" for line in lines])
    return OK


def _load(file: str, status: StatusLine) -> Any:
    from .model import load_model

    status("reading", 0, 0)
    return load_model(file)


def _choose(model: Any, file: str, status: StatusLine) -> Any:
    """The choice of dependent coordinates, or None for a model without loops; ModelError if loops cannot be closed."""
    if not model.loops:
        return None
    from .loops.errors import AssemblyError, PartitionError
    from .loops.partition import partition
    from .model.errors import ModelError, Problem

    status("choosing dependent coordinates", 0, 0)
    try:
        return partition(model)
    except (AssemblyError, PartitionError) as error:
        raise ModelError([Problem(file, None, None, "loops", str(error))]) from None


def _described(model: Any, chosen: Any) -> list[str]:
    """The choice of dependent coordinates as text."""
    if chosen is None:
        return []
    from .loops.description import describe
    from .summary import first

    return first(describe(model, chosen), PROBLEMS, "and {} lines more")


def run_show(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm show``: the contents of a model or of a generated package."""
    from .listing import list_model, list_package

    if Path(options.model).is_dir():
        lines = list_package(Path(options.model), options.verbose)
        status.close()
        write_lines(lines, sys.stdout)
        return OK
    model = _load(options.model, status)
    lines = list_model(model, options.verbose)
    try:
        if (chosen := _choose(model, options.model, status)) is not None:
            from .mechanics.structure.description import describe_regions

            lines += [f"  {line}" for line in (*_described(model, chosen), *describe_regions(model, chosen))]
    finally:  # write the lines even if loops cannot be closed
        status.close()
        write_lines(lines, sys.stdout)
    return OK


def run_import(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm import``: converts a robot file to a model file, and lists what is left out."""
    from .importing.command import ExistsError, run
    from .wording import counted

    status("reading", 0, 0)
    try:
        found, target = run(options)
    except ExistsError as error:
        raise Failure(str(error)) from None
    status.close()
    for warning in found.warnings:
        _problem(warning)
    left = [f"  left out: {what}" for what in found.left_out]
    if target is None:
        print(found.text, end="")
        write_lines([line.strip() for line in left], sys.stderr)
        return OK
    sizes = ", ".join((counted(len(found.model.bodies), "body", "bodies"), counted(found.model.nu, "speed")))
    write_lines([f"wrote {target}: {sizes}; now: generate {target}", *left], sys.stdout, ["bold"])
    return OK


def run_simulate(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm simulate``: computes a motion, its table, file and plot; Ctrl-C keeps the motion computed so far."""
    from .simulating import simulate

    remarks: list[str] = []
    try:
        run = simulate(options, status, remarks, width(sys.stdout))
    finally:
        status.close()
        for remark in remarks:
            _problem(remark if "warning: " in remark else f"warning: {remark}")
    write_lines(run.lines, sys.stdout, ["bold"])
    return _how_it_ended(run, options.ending.received)


def run_report(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm report``: speed and error of a model, or of all models in a folder."""
    from .reporting.command import run

    lines, problems, code = run(options, status)
    status.close()
    for line in problems:
        _problem(line)
    write_lines(lines, sys.stdout, ["bold"])
    return code


def run_bench(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm bench``: measures problems with known solutions."""
    from .bench.command import bench

    lines, failures = bench(options, status)
    status.close()
    write_lines(lines, sys.stdout)
    for line in failures:
        _problem(f"bench: {line}")
    return NUMBERS_FAILED if failures else OK


def _how_it_ended(run: Any, received: Sequence[int]) -> int:
    """The exit code of a simulation; prints a line on stderr unless it was successful."""
    from .runtime.standalone.trajectory.trajectory import INTERRUPTED

    where = f"at t = {run.reached:.6g} of {run.end:.6g} s"
    left = f"; until then: {', '.join(map(str, run.written))}" if run.written else ""
    if run.trajectory.ended == INTERRUPTED or received:
        number = received[-1] if received else signal.SIGINT
        how = "interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}"
        _problem(f"simulate: {how} {where}{left}")
        return SIGNALLED + number
    if isinstance(run.failed, OSError):
        raise run.failed
    if run.failed is not None:
        raise Failure(str(run.failed))
    if run.reached < run.end:
        from .explanations import section

        _problem(f"simulate: ended {where}: {run.trajectory.ended}{left}")
        _problem(section("SimulationError"))
        return NUMBERS_FAILED
    return OK


def _be_short_lived(command: str) -> None:
    """Disables garbage collection, which took a third of the time of a command; commands end soon.

    Also disables Pydantic's search for plugins in installed packages, and threads of NumPy in commands with small matrices only.
    """
    gc.disable()
    if command not in COMPUTING:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    atexit.register(gc.freeze)


def _expected() -> dict[type[Exception], int]:
    """The exit codes of errors of packages, of compilers and of missing optional packages."""
    from .runtime.standalone import errors

    return {
        errors.CompileError: COMPILING_FAILED, errors.NoCompilerError: COMPILING_FAILED,
        errors.TargetsDifferError: NUMBERS_FAILED, errors.SingularJointError: MODEL_WRONG,
        errors.AssemblyError: NUMBERS_FAILED, errors.SimulationError: NUMBERS_FAILED,
        errors.PackageError: USAGE, ImportError: USAGE,
    }  # fmt: skip


def _run(options: argparse.Namespace) -> int:
    """Runs a command; converts its errors to messages and exit codes."""
    command, status = options.command, StatusLine(sys.stderr)
    try:
        from .model.errors import ModelError
        from .runtime.standalone.files.compiling import silent

        try:
            with Ending().handling() as options.ending, status, silent():
                if "" in (getattr(options, "model", None), getattr(options, "file", None)):
                    raise Failure("the name of the model is empty; give a file")
                code: int = options.run(options, status)
                sys.stdout.flush()
            return code
        except ModelError as error:
            _wrong(error)
            return MODEL_WRONG
        except Failure as failure:
            _problem(f"{command}: {failure}")
            _explain(failure)
            return failure.code
        except tuple(codes := _expected()) as error:
            code = next(number for kind, number in codes.items() if isinstance(error, kind))
            _problem(error if code == MODEL_WRONG else f"{command}: {error}")
            _explain(error)
            return code
    except KeyboardInterrupt as interrupt:
        number = getattr(interrupt, "number", signal.SIGINT)
        how = "interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}"
        _problem(f"{command}: {how}" + (f" while {status.where}" if status.stage else ""))
        return SIGNALLED + number
    except BrokenPipeError:
        _forget_output()
        return SIGNALLED + signal.SIGPIPE
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        _forget_output()
        _problem(f"{command}: {name}{error.strerror or error}")
        return USAGE
    except MemoryError:
        _problem(f"{command}: out of memory" + (f" while {status.where}" if status.stage else ""))
        return USAGE


def _forget_output() -> None:
    """Redirects stdout to the null device, so that text still in its buffer causes no error when the process ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def generate_main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``generate``."""
    return _ended(_generate_main, arguments, "generate")


def _ended(run: Callable[[Sequence[str] | None], int], arguments: Sequence[str] | None, program: str) -> int:
    """Runs a program and returns its exit code; handles Ctrl-C also while modules are being imported."""
    try:
        return run(arguments)
    except KeyboardInterrupt:
        _problem(f"{program}: interrupted")
        return SIGNALLED + signal.SIGINT


def _generate_main(arguments: Sequence[str] | None) -> int:
    _tolerate_terminal()
    if arguments is None:
        _be_short_lived("generate")
    parser = argparse.ArgumentParser(
        prog="generate", description="Generate a solver with exact design sensitivities from a model file."
    )
    _generate_arguments(parser)
    parser.add_argument("--version", action="version", version=f"ordernm {__version__}")
    parser.set_defaults(run=run_generate, command="generate")
    return _run(parser.parse_args(arguments))


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``ordernm``."""
    return _ended(_main, arguments, "ordernm")


def _main(arguments: Sequence[str] | None) -> int:
    _tolerate_terminal()
    given = sys.argv[1:] if arguments is None else arguments
    command = given[0] if given else ""
    if arguments is None:
        _be_short_lived(command)
    return _run(parser_of_commands(command).parse_args(arguments))


def parser_of_commands(wanted: str | None = None) -> argparse.ArgumentParser:
    """The parser of all ``ordernm`` commands; only the modules of the commands in `wanted` are imported, if it is
    given."""
    parser = argparse.ArgumentParser(prog="ordernm", description="Multibody solvers with exact design sensitivities.")
    parser.add_argument("--version", action="version", version=f"ordernm {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    generate = commands.add_parser("generate", help="generate a solver from a model file")
    _generate_arguments(generate)
    generate.set_defaults(run=run_generate)
    for name, run, module, help_text in (
        ("simulate", run_simulate, ".simulating", "simulate a motion and its derivatives with respect to parameters"),
        ("import", run_import, ".importing.command", "convert a robot file to a model file: URDF, MJCF, SDF"),
        (
            "report",
            run_report,
            ".reporting.command",
            "measure a model's speed and errors: a page with figures, and its data",
        ),
        ("bench", run_bench, ".bench.command", "measure accuracy and speed on problems with known solutions"),
    ):
        command = commands.add_parser(name, help=help_text)
        if wanted in (None, name):
            import_module(module, __package__).add_arguments(command)
        command.set_defaults(run=run)
    for name, module, help_text in (
        ("new", ".new_model", "write a first model file"),
        ("export", ".exporting.command", "write a solver for other programs: plain C for small machines"),
        ("doctor", ".doctor", "show compiler, processor, extras and cache, and whether a solver compiles"),
        ("completion", ".completing", "print a script that completes commands in a shell"),
        ("view", ".viewing", "show a mechanism and its motion in a browser, or write a page or a picture"),
        ("equations", ".showing_equations", "print the equations of motion: mass matrix and right side"),
        ("statements", ".showing_equations", "print every statement that a solver computes, with equation numbers"),
    ):
        command = commands.add_parser(name, help=help_text)
        if wanted in (None, name):
            showing = import_module(module, __package__)
            getattr(showing, f"add_{name}_arguments")(command)
            command.set_defaults(run=getattr(showing, f"run_{name}"))
    for name, run, help_text in (
        ("check", run_check, "read a model file and list what is wrong with it"),
        ("show", run_show, "print what a model file, or a generated package, holds"),
    ):
        command = commands.add_parser(name, help=help_text)
        command.add_argument("model", help="model file (YAML)" + (", or generated package" if run is run_show else ""))
        if run is run_show:
            command.add_argument("-v", "--verbose", action="store_true",
                                 help="list all bodies of a large model, all functions of a package")  # fmt: skip
        command.set_defaults(run=run)
    return parser


if __name__ == "__main__":
    sys.exit(main())
