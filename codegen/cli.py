"""The command line: ``generate model.yaml`` and ``ordernm COMMAND``.

Exit codes: 0 ok, 1 the model is wrong, 2 usage, 3 compiling failed, 4 the numbers failed.
"""

from __future__ import annotations

import argparse
import atexit
import contextlib
import gc
import importlib
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .version import __version__

OK, MODEL_WRONG, USAGE, COMPILING_FAILED, NUMBERS_FAILED = 0, 1, 2, 3, 4

NEW_MODEL = """\
# {name}: a pendulum to begin with; docs/model_format.md describes every key.
model: {name}
gravity: [0, 0, -9.81]                # m/s^2 in the ground frame
parameters:
  length: {{value: 1.0, unit: m}}       # a design parameter: derivatives with respect to it are exact
bodies:
  rod:
    parent: ground
    joint: {{type: revolute, axis: y, at: [0, 0, 0]}}
    shape: {{type: cylinder, axis: z, length: length, radius: 0.02, density: 2700, center: [0, 0, -length/2]}}
forces:
  friction: {{type: joint, joint: rod, value: -0.01*u.rod}}
initial:
  q: {{rod: 0.5}}
outputs:
  energy: kinetic_energy
"""


def _generate_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("model", help="model file (YAML)")
    parser.add_argument("-o", "--output", metavar="DIR", help="package to write (default: ./generated/NAME)")
    parser.add_argument("--target", choices=("c", "numpy", "both"), default="c", help="what the package's Solver uses")
    parser.add_argument("--layout", choices=("auto", "kinds", "unrolled"), default="auto",
                        help="one C function per kind of link, or one per link")  # fmt: skip
    parser.add_argument(
        "--partitions",
        type=int,
        choices=(1, 2),
        default=1,
        help="hold a second choice of independent coordinates, to change to at dead points",
    )
    parser.add_argument("--reactions", action="store_true", help="the solver also gives what joints and loops transmit")
    parser.add_argument("--no-check", action="store_true", help="do not compare with the generic engine")
    parser.add_argument("--no-compile", action="store_true", help="write the sources only")
    parser.add_argument("-v", "--verbose", action="store_true", help="print passes and operations of every sweep")


def _problem(text: object) -> None:
    print(text, file=sys.stderr)


def _tolerate_terminal() -> None:
    """A terminal without unicode shows ``?`` for what it lacks; it is no reason to fail."""
    with contextlib.suppress(AttributeError):  # a stream that somebody put in the place of stdout
        sys.stdout.reconfigure(errors="replace")  # type: ignore[union-attr]


def _load(file: str) -> Any:
    from .model import load_model

    return load_model(file)


def run_generate(options: argparse.Namespace) -> int:
    """``generate``."""
    from .generation import FolderError, generate
    from .model import ModelError
    from .runtime.solver import CompileError, SingularJointError, TargetsDifferError

    # the terminal's tables are loaded while the C compiler works
    threading.Thread(target=importlib.import_module, args=("rich.table",), daemon=True).start()
    try:
        report = generate(
            options.model, options.output, options.target, options.layout, partitions=options.partitions,
            reactions=options.reactions,
            compile=not options.no_compile,
            check=not options.no_check and not options.no_compile,
        )  # fmt: skip
    except (ModelError, SingularJointError) as error:
        _problem(error)
        return MODEL_WRONG
    except CompileError as error:
        _problem(f"generate: {error}")
        return COMPILING_FAILED
    except TargetsDifferError as error:
        _problem(f"generate: {error}")
        return NUMBERS_FAILED
    except FolderError as error:
        _problem(f"generate: {error}")
        return USAGE
    except OSError as error:
        _problem(f"generate: {error.filename or ''}: {error.strerror or error}")
        return USAGE
    print_report(report, options.verbose)
    return _verdict(report)


def _verdict(report: Any) -> int:
    from .generation import CHECK_TOLERANCE

    bad = {name: e for name, e in report.errors.items() if not e <= CHECK_TOLERANCE}
    if bad:
        _problem(f"the numbers differ from the generic engine's: {bad}; please report this with the model")
        return NUMBERS_FAILED
    return OK


FORWARD = (
    "start",
    "rotations",
    "closures",
    "pose",
    "velocities",
    "springs",
    "kinematics",
    "triangularize",
    "back_substitute",
)
DIRECTION = ("turns", "complete", "velocity_tangents", "spring_tangents", "balance_out", "balance_in", "balance_back")


def print_report(report: Any, verbose: bool = False) -> None:
    """Print what `generate` made."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False, soft_wrap=True)
    for warning in report.warnings:
        console.print(f"[yellow]{escape(str(warning))}[/yellow]")
    unchanged = "" if report.written else "  (unchanged)"
    console.print(f"[bold]{report.name}[/bold]  {escape(str(report.folder))}{unchanged}")
    console.print(
        f"  {report.bodies} bodies, {report.nq} coordinates, {report.nu} speeds, {report.parameters} parameters; "
        f"{report.links} links of {report.kinds} kinds, layout {report.layout}, target {report.target}"
    )
    for line in report.loops:
        console.print(f"  {escape(line)}")
    functions = sum(report.operations[s]["per_call"]["functions"] for s in FORWARD if s in report.operations)
    divisions = sum(report.operations[s]["per_call"]["divisions"] for s in FORWARD if s in report.operations)
    n = max(report.links, 1)
    udot, shared = report.flops(*FORWARD), report.flops(*DIRECTION)
    each = report.flops(*DIRECTION, per="per_direction")
    console.print(
        f"  udot: {udot} operations ({udot / n:.1f} a link, {divisions} of them divisions; {functions} sines and other functions)"
    )
    console.print(
        f"  derivatives: {shared} operations once, {each} per direction ({each / n:.1f} a link, "
        f"{each / max(udot, 1):.2f} of udot)"
    )
    if verbose:
        table = Table("sweep", "+", "*", "/", "functions", "+ each", "* each", "seconds", box=None,
                      title="operations per call, and of each direction", title_justify="left")  # fmt: skip
        table.columns[0].no_wrap = True
        for sweep, parts in report.operations.items():
            a, b = parts["per_call"], parts["per_direction"]
            table.add_row(sweep, *(str(a[k]) for k in ("additions", "multiplications", "divisions", "functions")),
                          str(b["additions"]), str(b["multiplications"]),
                          f"{report.sweep_seconds.get(sweep, 0.0):.3f}")  # fmt: skip
        console.print(table)
        table = Table("pass", "+", "*", "/", "functions", "seconds", box=None,
                      title="all blocks after every pass", title_justify="left")  # fmt: skip
        table.columns[0].no_wrap = True
        for name, o, seconds in report.passes:
            table.add_row(name, *(str(v) for v in o.values()), f"{seconds:.3f}")
        console.print(table)
        for name, size in report.files.items():
            console.print(f"  {size:>9} {name}")
    console.print("  " + ", ".join(f"{stage} {s:.2f} s" for stage, s in report.seconds.items()))
    if report.errors:
        console.print(
            f"  checked against the generic engine: relative error of udot {report.errors['udot']:.1e}, "
            f"of its derivatives {report.errors['dudot']:.1e}"
        )
    for remark in report.remarks:
        console.print(f"  [yellow]{escape(remark)}[/yellow]")


def run_check(options: argparse.Namespace) -> int:
    """``ordernm check``: read a model, close its loops, and say what is wrong with it."""
    from .model import ModelError

    try:
        model = _load(options.model)
    except ModelError as error:
        _problem(error)
        return MODEL_WRONG
    for warning in model.warnings:
        print(warning)
    choice: list[str] = []
    if model.loops:
        from .loops.description import describe
        from .loops.errors import AssemblyError, PartitionError
        from .loops.partition import partition

        try:
            choice = describe(model, partition(model))
        except (AssemblyError, PartitionError) as error:
            _problem(f"{options.model}: loops: {error}")
            return MODEL_WRONG
    print(f"{options.model}: {len(model.bodies)} bodies, {model.nq} coordinates, {model.nu} speeds: ok")
    for line in choice:
        print(f"  {line}")
    return OK


def run_show(options: argparse.Namespace) -> int:
    """``ordernm show``: print the tree of a model, or what a generated package is."""
    from .model import ModelError

    path = Path(options.model)
    if path.is_dir():
        from .runtime import load

        try:
            print(load(path, "numpy"))
        except ValueError as error:
            _problem(f"show: {error}")
            return USAGE
        return OK
    try:
        model = _load(options.model)
    except ModelError as error:
        _problem(error)
        return MODEL_WRONG
    from rich.console import Console
    from rich.markup import escape
    from rich.tree import Tree

    tree = Tree(f"[bold]{model.name}[/bold] ground")
    nodes: dict[int, Any] = {-1: tree}
    for k in model.outward:
        body = model.bodies[k]
        nodes[k] = nodes[body.parent].add(f"{body.name} [dim]{body.joint.type}[/dim]")
    console = Console(highlight=False)
    console.print(tree)
    names = {-1: "ground"} | {k: body.name for k, body in enumerate(model.bodies)}
    for loop in model.loops:
        console.print(f"  loop {loop.name}: {loop.type} from {names[loop.start.body]} to {names[loop.end.body]}")
    for spring in model.springs:
        console.print(f"  spring {spring.name}: from {names[spring.start.body]} to {names[spring.end.body]}")
    for p in model.parameters:
        console.print(escape(f"  parameter {p.name} = {p.value} {p.unit}".rstrip()))
    for o in model.outputs:
        console.print(f"  output {o.name}: {o.measure}")
    return OK


def run_new(options: argparse.Namespace) -> int:
    """``ordernm new``: write a first model file."""
    from .model import ModelError, parse_model

    path = Path(options.model)
    text = NEW_MODEL.format(name=path.stem)
    try:
        parse_model(text, str(path))
    except ModelError:  # the name is all that may be wrong with it: with blanks, a word of Python or C, ...
        _problem(f"new: {path.stem!r} cannot name a model; call the file after one, such as pendulum.yaml")
        return USAGE
    try:
        with open(path, "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        _problem(f"new: {path} exists; choose another name")
        return USAGE
    except OSError as error:
        _problem(f"new: cannot write {path}: {error.strerror or error}")
        return USAGE
    print(f"wrote {path}; now: generate {path}")
    return OK


def _be_short_lived() -> None:
    """A command's expressions live until it ends, which is soon: looking for cycles in them took a third of its time."""
    gc.disable()
    atexit.register(gc.freeze)


def generate_main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``generate``."""
    _tolerate_terminal()
    if arguments is None:
        _be_short_lived()
    parser = argparse.ArgumentParser(
        prog="generate", description="Generate a solver with exact design sensitivities from a model file."
    )
    _generate_arguments(parser)
    parser.add_argument("--version", action="version", version=f"ordernm {__version__}")
    return run_generate(parser.parse_args(arguments))


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``ordernm``."""
    _tolerate_terminal()
    if arguments is None:
        _be_short_lived()
    parser = argparse.ArgumentParser(prog="ordernm", description="Multibody solvers with exact design sensitivities.")
    parser.add_argument("--version", action="version", version=f"ordernm {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    generate = commands.add_parser("generate", help="generate a solver from a model file")
    _generate_arguments(generate)
    generate.set_defaults(run=run_generate)
    for name, run, help_text in (
        ("check", run_check, "read a model file and list what is wrong with it"),
        ("show", run_show, "print the tree of a model file, or what a generated package is"),
        ("new", run_new, "write a first model file"),
    ):
        command = commands.add_parser(name, help=help_text)
        command.add_argument("model", help="model file (YAML)")
        command.set_defaults(run=run)
    options = parser.parse_args(arguments)
    result: int = options.run(options)
    return result


if __name__ == "__main__":
    sys.exit(main())
