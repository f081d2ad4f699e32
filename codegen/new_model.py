"""``ordernm new``: a first model file, from one of several starters."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from .ending import OK, Failure
from .starters import DEFAULT, starters, text_of
from .terminal import StatusLine


def add_new_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``ordernm new``."""
    parser.add_argument("model", nargs="?", help="model file to write (YAML)")
    parser.add_argument("--from", dest="starter", metavar="STARTER", default=None,
                        help=f"what the file begins with, see --list (default: {DEFAULT})")  # fmt: skip
    parser.add_argument("--list", action="store_true", help="list the starters")
    parser.add_argument("--force", action="store_true", help="replace a file of that name")


def run_new(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm new``: write a first model file, or list the starters."""
    known = starters()
    if options.list:
        if options.model is not None or options.starter is not None or options.force:
            raise Failure("--list writes nothing; leave out the file and the other options")
        longest = max(map(len, known))
        print("\n".join(f"{name:{longest}}  {what}" for name, what in known.items()))
        return OK
    if options.model is None:
        raise Failure("which file? give one, such as pendulum.yaml; --list lists the starters")
    starter = options.starter or DEFAULT
    if starter not in known:
        raise Failure(f"--from {starter}: no such starter; {', '.join(known)} are available")
    _write(Path(options.model), starter, options.force)
    print(f"wrote {options.model}; now: generate {options.model}")
    return OK


def _write(path: Path, starter: str, force: bool) -> None:
    """Write a starter under the name of the file.

    Raises
    ------
    Failure
        If the name of the file cannot name a model, or the file exists.
    """
    from .model import ModelError, parse_model
    from .runtime.standalone.files.whole_file import write_whole

    text = text_of(starter, path.stem)
    try:
        parse_model(text, str(path))
    except ModelError:  # only the name can be wrong, such as a keyword of Python or C
        raise Failure(f"{path.stem!r} is not a valid model name; choose a file name such as pendulum.yaml") from None
    try:
        if os.path.lexists(path) and not force:
            raise Failure(f"{path} exists; choose another name, or use --force to replace it")
        write_whole(path, lambda file: file.write(text.encode()))
    except OSError as error:
        raise Failure(f"cannot write {path}: {error.strerror or error}") from None
