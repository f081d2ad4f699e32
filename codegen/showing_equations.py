"""``ordernm equations`` and ``ordernm statements``: prints the formulas that a model computes, or writes them to a
file."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .ending import MODEL_WRONG, OK, Failure
from .own_files import add_force, refuse_foreign_file
from .runtime.standalone.files.whole_file import MARK, write_whole
from .terminal import StatusLine

FORMATS = {
    "latex": "LaTeX, for a document with amsmath",
    "mathml": "MathML, one formula a line",
    "sympy": "a module of Python that makes the matrices with sympy",
    "html": "a page for a browser, in one file",
}

MARKED = {"": "# {}\n", "sympy": "# {}\n", "latex": "% {}\n", "mathml": "<!-- {} -->\n", "html": "<!-- {} -->\n"}
"""The first line of a file, by its format."""


class WrongRequest(Failure):
    """Raised if the model lacks the requested equations, or if an argument names nothing in the model."""

    code = MODEL_WRONG


def _add_common(parser: argparse.ArgumentParser, formats: list[str]) -> None:
    parser.add_argument("model", help="model file (YAML)")
    how = parser.add_mutually_exclusive_group()
    for name in formats:
        how.add_argument(f"--{name}", dest="format", action="store_const", const=name, help=FORMATS[name])
    parser.set_defaults(format="")
    parser.add_argument("-o", "--output", metavar="FILE", help="file to write (default: print)")


def add_equations_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``ordernm equations``."""
    _add_common(parser, list(FORMATS))
    parser.add_argument(
        "--form", choices=("tree", "multipliers", "embedded"),
        help="equations of a model with loops: with multipliers (default), or in the independent speeds (embedded)",
    )  # fmt: skip
    parser.add_argument("--values", action="store_true", help="numbers of the model in the place of parameters")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="a value for a parameter; may be repeated"
    )
    parser.add_argument(
        "--intermediates", action="store_true", help="intermediate variables z1, z2, ... for long sums of large models"
    )
    parser.add_argument("--simplify", action="store_true", help="let sympy simplify every entry, which may take long")
    parser.add_argument("--force-size", action="store_true", help="also compute equations that are too large")
    parser.add_argument("--force-file", action="store_true", help="also replace a file that ordernm did not write")
    parser.add_argument("--force", action="store_true", help="--force-size and --force-file")


def add_statements_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``ordernm statements``."""
    _add_common(parser, ["latex", "html"])
    add_force(parser)
    parser.add_argument(
        "--functions", metavar="NAME,...",
        help="functions of the solver whose statements are wanted, such as accelerations,sensitivities (default: all)",
    )  # fmt: skip
    parser.add_argument("--reactions", action="store_true", help="also the wrenches in joints and loops")
    parser.add_argument("--frames", action="store_true", help="also the motions of all bodies")


def run_equations(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm equations``."""
    if options.values and options.set:
        raise Failure(
            "--values gives every parameter a number, --set a single parameter; leave out one of the two options"
        )
    if options.force_file and options.output is None:
        raise Failure("--force-file is for a file that -o names; leave it out")
    given: Any = "values" if options.values else _values(options.set)

    def made(model: Any) -> tuple[str, str]:
        from .symbolic import equations
        from .symbolic.pages import equations_mathml, equations_page
        from .symbolic.writing import as_latex, as_sympy, as_text

        found = equations(
            model, parameters=given, form=options.form, intermediates=options.intermediates, simplify=options.simplify,
            force=options.force or options.force_size,
        )  # fmt: skip
        if options.intermediates and not found.intermediates:
            print(
                f"equations: {model.name} has no long sums, so no intermediate variables are introduced",
                file=sys.stderr,
            )
        write = {"": as_text, "latex": as_latex, "sympy": as_sympy, "mathml": equations_mathml, "html": equations_page}
        return write[options.format](found), f"{found.terms} terms"

    return _run(options, status, made, "--force-file")


def run_statements(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm statements``."""
    if options.force and options.output is None:
        raise Failure("--force is for a file that -o names; leave it out")
    functions = None if options.functions is None else [name.strip() for name in options.functions.split(",")]

    def made(model: Any) -> tuple[str, str]:
        from .symbolic import statements
        from .symbolic.pages import statements_page
        from .symbolic.recursion_writing import as_latex, as_text

        found = statements(model, functions=functions, reactions=options.reactions, frames=options.frames)
        write = {"": as_text, "latex": as_latex, "html": statements_page}
        return write[options.format](found), f"{found.count} statements"

    return _run(options, status, made, "--force")


def _run(
    options: argparse.Namespace, status: StatusLine, made: Callable[[Any], tuple[str, str]], to_replace: str
) -> int:
    """Read the model, and print the text that `made` returns or write it to a file; `to_replace` is the option that replaces a
    foreign file."""
    from .model import load_model
    from .symbolic import SymbolicError

    target = None if options.output is None else Path(options.output)
    if target is not None:
        forced = options.force or getattr(options, "force_file", False)
        refuse_foreign_file(target, forced, to_replace)
    status("reading", 0, 0)
    model = load_model(options.model)
    status("forming equations", 0, 0)
    try:
        text, size = made(model)
    except SymbolicError as error:
        raise WrongRequest(str(error)) from error
    status.close()
    if target is None:
        print(text, end="")
        return OK
    first = MARKED[options.format].format(MARK)
    write_whole(target, lambda file: file.write((first + text).encode("utf-8")))
    print(f"wrote {target}: {size}")
    return OK


def _values(given: list[str]) -> dict[str, float]:
    """Values of parameters from ``NAME=VALUE``."""
    found = {}
    for text in given:
        name, equals, value = text.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            equals = ""
        if not equals:
            raise Failure(f"--set {text}: give NAME=VALUE with a number, such as --set mass=2.5")
    return found
