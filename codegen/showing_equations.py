"""``ordernm equations``: the equations of motion of a model, printed or written to a file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .ending import MODEL_WRONG, Failure
from .own_files import add_force, refuse_foreign_file
from .runtime.standalone.files.whole_file import MARK, write_whole
from .terminal import StatusLine

MARKED = {None: "# {}\n", "sympy": "# {}\n", "latex": "% {}\n"}
"""The first line of a file, by its kind."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``ordernm equations``."""
    parser.add_argument("model", help="model file (YAML)")
    how = parser.add_mutually_exclusive_group()
    for name, said in (
        ("latex", "LaTeX, for a document with amsmath"),
        ("sympy", "a module of Python that makes the matrices with sympy"),
    ):
        how.add_argument(f"--{name}", dest="written", action="store_const", const=name, help=said)
    parser.add_argument(
        "--form", choices=("tree", "multipliers", "embedded"),
        help="of a model with loops: with multipliers (default), or in the independent speeds",
    )  # fmt: skip
    parser.add_argument("--values", action="store_true", help="numbers of the model in the place of parameters")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="a value for a parameter; may be repeated"
    )
    parser.add_argument("--simplify", action="store_true", help="let sympy simplify every entry, which may take long")
    parser.add_argument("-o", "--output", metavar="FILE", help="file to write (default: print)")
    add_force(parser)


def run(options: argparse.Namespace, status: StatusLine) -> str:
    """What is printed."""
    from .model import load_model
    from .symbolic import SymbolicError, equations
    from .symbolic.writing import as_latex, as_sympy, as_text

    target = None if options.output is None else Path(options.output)
    if target is not None:
        refuse_foreign_file(target, options.force)
    if options.values and options.set:
        raise Failure("--values gives all parameters numbers, --set one; leave out one of them")
    status("reading", 0, 0)
    model = load_model(options.model)
    status("forming equations", 0, 0)
    given: Any = "values" if options.values else _values(options.set)
    try:
        found = equations(model, parameters=given, form=options.form, simplify=options.simplify, force=options.force)
    except SymbolicError as error:
        failure = Failure(str(error))
        failure.code = MODEL_WRONG
        raise failure from None
    text = {"latex": as_latex, "sympy": as_sympy, None: as_text}[options.written](found)
    if target is None:
        return text
    marked = MARKED[options.written].format(MARK) + text
    write_whole(target, lambda file: file.write(marked.encode("utf-8")))
    return f"wrote {target}: {found.terms} terms\n"


def _values(given: list[str]) -> dict[str, float]:
    """Values of parameters from ``NAME=VALUE``."""
    found = {}
    for text in given:
        name, equals, value = text.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise Failure(f"--set {text}: give NAME=VALUE with a number, such as --set mass=2.5") from None
        if not equals:
            raise Failure(f"--set {text}: give NAME=VALUE with a number, such as --set mass=2.5")
    return found
