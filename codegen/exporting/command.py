"""``ordernm export``: a solver for other programs."""

from __future__ import annotations

import argparse
import sys

from ..arguments import number
from ..ending import OK, Failure
from ..own_files import add_force
from ..terminal import StatusLine, write_lines

OPTIONS = {
    "c": ("scalar", "functions"), "fmu": ("fmi", "platforms", "method", "energies", "stop"), "casadi": ("functions",),
}  # fmt: skip
"""Kinds of exports, and their own options."""


def add_export_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``ordernm export``."""
    parser.add_argument("model", help="model file (YAML)")
    parser.add_argument("--c", action="store_true",
                        help="plain C99 for small machines: no heap, no global variables, with a report of sizes")  # fmt: skip
    parser.add_argument("--fmu", action="store_true",
                        help="functional mock-up unit: Model Exchange and Co-Simulation, with source code")  # fmt: skip
    parser.add_argument("--casadi", action="store_true",
                        help="library of functions for CasADi, with first and second derivatives")  # fmt: skip
    parser.add_argument("-o", "--output", metavar="PATH",
                        help="folder, or file of an FMU, to write (default: ./exported/NAME, ./exported/NAME.fmu)")  # fmt: skip
    parser.add_argument("--functions", metavar="NAME,...", help="functions of --c or --casadi (default: all)")
    of_c = parser.add_argument_group("plain C")
    of_c.add_argument("--scalar", choices=("float64", "float32"), help="type of all numbers (default: float64)")
    of_fmu = parser.add_argument_group("FMU")
    of_fmu.add_argument("--fmi", choices=("3.0", "2.0"), help="version of the standard (default: 3.0)")
    of_fmu.add_argument("--platforms", metavar="NAME,...",
                        help="x86_64-linux, aarch64-linux, x86_64-windows, x86_64-darwin, aarch64-darwin; all, or none "
                             "(default: this machine)")  # fmt: skip
    of_fmu.add_argument("--method", choices=("dop853", "radau"), help="integrator of Co-Simulation (default: dop853)")
    of_fmu.add_argument("--energies", action="store_true", help="add both energies to the outputs")
    of_fmu.add_argument("--stop", type=number, metavar="SECONDS", help="end of the default experiment (default: 1)")
    add_force(parser)


def run_export(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm export``: writes the files, and prints a report."""
    kinds = [kind for kind in OPTIONS if getattr(options, kind)]
    if len(kinds) != 1:
        raise Failure("give one of --c (plain C), --fmu (functional mock-up unit) and --casadi (library of CasADi)")
    (kind,) = kinds
    for name in sorted({n for names in OPTIONS.values() for n in names}.difference(OPTIONS[kind])):
        if getattr(options, name) not in (None, False):
            of = " and ".join(f"--{other}" for other, names in OPTIONS.items() if name in names)
            raise Failure(f"--{name} is an option of {of}, not of --{kind}")
    lines = {"c": _plain_c, "fmu": _fmu, "casadi": _casadi}[kind](options, status)
    status.close()
    write_lines(lines, sys.stdout, ["bold"])
    return OK


def _fmu(options: argparse.Namespace, status: StatusLine) -> list[str]:
    """Writes a functional mock-up unit; returns the report."""
    from .fmu.binaries import PlatformError
    from .fmu.export import export_fmu

    given = {n: getattr(options, n) for n in ("fmi", "platforms", "method", "stop") if getattr(options, n) is not None}
    if not 0.0 < given.get("stop", 1.0) < float("inf"):
        raise Failure(f"--stop {options.stop}: expected a positive number of seconds")
    try:
        found = export_fmu(
            options.model, options.output, energies=options.energies, force=options.force, progress=status, **given
        )
    except PlatformError as error:
        raise Failure(str(error)) from None
    return [repr(found), f"states: {', '.join(found.states) or 'none'}"]


def _plain_c(options: argparse.Namespace, status: StatusLine) -> list[str]:
    """Writes a folder of plain C; returns the report of its functions."""
    from ..mechanics.procedures import UnknownFunctionError
    from .plain_c import export_c, table

    try:
        found = export_c(
            options.model, options.output, functions=options.functions, scalar=options.scalar or "float64",
            force=options.force, progress=status,
        )  # fmt: skip
    except UnknownFunctionError as error:
        raise Failure(str(error)) from None
    sizes = (
        f"code and stack by {found.compiler}" if found.compiler else "no C compiler, so code and stack are not measured"
    )
    return [
        f"{found.folder}: {len(found.files)} files; workspace {found.workspace} bytes; {sizes}",
        *table(found.functions),
    ]


def _casadi(options: argparse.Namespace, status: StatusLine) -> list[str]:
    """Writes and compiles a library of CasADi; returns the list of its functions."""
    from ..casadi.bridged import BridgeError
    from ..casadi.exporting import export_casadi

    try:
        found = export_casadi(
            options.model, options.output, functions=options.functions, force=options.force, progress=status
        )
    except BridgeError as error:
        raise Failure(str(error)) from None
    return repr(found).splitlines()


__all__ = ["add_export_arguments", "run_export"]
