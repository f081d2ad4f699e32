"""``ordernm completion``: a script that lets a shell complete commands, options and file names."""

from __future__ import annotations

import argparse

from .ending import OK, Failure
from .terminal import StatusLine

SHELLS = ("bash", "zsh", "tcsh")


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
    print(shtab.complete(parser_of_commands(), options.shell))
    return OK
