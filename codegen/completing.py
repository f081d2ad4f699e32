"""``ordernm completion``: a script that lets a shell complete commands, options and file names."""

from __future__ import annotations

import argparse
from typing import Any

from .ending import OK, Failure
from .terminal import StatusLine

SHELLS = ("bash", "zsh", "tcsh")

FILES = ("model", "file", "FILE", "NAME=VALUE|FILE", "OLD")
"""Names, in the help, of values that are files."""

FOLDERS = ("DIR", "FOLDER")
"""Names, in the help, of values that are folders."""


def add_completion_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``ordernm completion``."""
    where = "~/.local/share/bash-completion/completions/ordernm"
    parser.add_argument("shell", choices=SHELLS, help=f"such as: ordernm completion bash > {where}")


def run_completion(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm completion``: prints the script."""
    from .cli import parser_of_commands

    try:
        import shtab
    except ImportError:
        raise Failure('completion needs shtab: pip install "ordernm[completion]", or pip install shtab') from None
    parser = parser_of_commands()
    _complete_files(parser, shtab.FILE, shtab.DIRECTORY)
    print(shtab.complete(parser, options.shell))
    return OK


def _complete_files(parser: argparse.ArgumentParser, file: Any, folder: Any) -> None:
    """Marks the arguments of all commands that name files or folders."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                _complete_files(command, file, folder)
        elif (name := action.metavar or action.dest) in FILES:
            action.complete = file  # type: ignore[attr-defined]
        elif name in FOLDERS:
            action.complete = folder  # type: ignore[attr-defined]
