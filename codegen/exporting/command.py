"""``ordernm export``: a solver for other programs."""

from __future__ import annotations

import argparse
import sys

from ..ending import OK, Failure
from ..own_files import add_force
from ..terminal import StatusLine, write_lines


def add_export_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``ordernm export``."""
    parser.add_argument("model", help="model file (YAML)")
    parser.add_argument("--c", action="store_true",
                        help="plain C99 for small machines: no heap, no variables, with a report of sizes")  # fmt: skip
    parser.add_argument("-o", "--output", metavar="DIR", help="folder to write (default: ./exported/NAME)")
    parser.add_argument("--scalar", choices=("float64", "float32"), default="float64", help="type of all numbers")
    parser.add_argument("--functions", metavar="NAME,...", help="the functions, if not all, as in generate")
    add_force(parser)


def run_export(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm export``: writes the folder, and prints the report of its functions."""
    from ..mechanics.procedures import UnknownFunctionError
    from .plain_c import export_c, table

    if not options.c:
        raise Failure("what shall it become? give --c for plain C")
    try:
        found = export_c(
            options.model, options.output, functions=options.functions, scalar=options.scalar, force=options.force,
            progress=status,
        )  # fmt: skip
    except UnknownFunctionError as error:
        raise Failure(str(error)) from None
    status.close()
    sizes = (
        f"code and stack by {found.compiler}" if found.compiler else "no C compiler, so code and stack are not measured"
    )
    lines = [
        f"{found.folder}: {len(found.files)} files; workspace {found.workspace} bytes; {sizes}",
        *table(found.functions),
    ]
    write_lines(lines, sys.stdout, ["bold"])
    return OK


__all__ = ["add_export_arguments", "run_export"]
