"""Renders the templates. They live in ``templates/`` of the checkout, inside the package in a wheel."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import jinja2


@cache
def environment() -> jinja2.Environment:
    package = Path(__file__).resolve().parent.parent
    folders = [package / "templates", package.parent / "templates"]
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader([str(f) for f in folders]),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def render(template: str, context: Mapping[str, object]) -> str:
    """The text of a template."""
    return environment().get_template(template).render(context)
