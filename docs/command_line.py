"""Directive ``commands``: a section for each command of ``ordernm``, written from the parser of its arguments."""

from __future__ import annotations

import argparse
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from codegen.cli import parser_of_commands

WIDTH = 90
"""Columns of a usage line."""


class Commands(Directive):
    """Sections with the usage and the options of all commands."""

    def run(self) -> list[nodes.Node]:
        (commands,) = [a for a in parser_of_commands()._actions if isinstance(a, argparse._SubParsersAction)]
        helps = {a.dest: a.help or "" for a in commands._choices_actions}
        return [_section(name, helps[name], parser) for name, parser in sorted(commands.choices.items())]


def _section(name: str, text: str, parser: argparse.ArgumentParser) -> nodes.section:
    section = nodes.section(ids=[nodes.make_id(name)], names=[name])
    section += nodes.title(text=name)
    section += nodes.paragraph(text=f"{text[:1].upper()}{text[1:]}.")
    parser.formatter_class = _Formatter
    usage = parser.format_usage().removeprefix("usage: ")
    section += nodes.literal_block(usage, usage, language="text")
    table = nodes.definition_list()
    for action in parser._actions:
        if not isinstance(action, argparse._HelpAction):
            table += _definition(action)
    section += table
    return section


class _Formatter(argparse.HelpFormatter):
    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=WIDTH)


def _definition(action: argparse.Action) -> nodes.definition_list_item:
    """The names of an argument, its values, and its help."""
    form = _Formatter("")
    default = (
        form._get_default_metavar_for_optional if action.option_strings else form._get_default_metavar_for_positional
    )
    value = "" if action.nargs == 0 else form._format_args(action, default(action))
    term = nodes.term()
    for i, name in enumerate(action.option_strings or [value]):
        term += [nodes.Text(", " if i else ""), nodes.literal(text=name)]
    if action.option_strings and value:
        term += [nodes.Text(" "), nodes.literal(text=value)]
    text = form._expand_help(action) if action.help else ""
    if action.default and action.default != argparse.SUPPRESS and "default" not in text:
        text += f" (default: {action.default})"
    return nodes.definition_list_item("", term, nodes.definition("", nodes.paragraph(text=text)))


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the directive."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True}
