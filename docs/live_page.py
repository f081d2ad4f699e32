"""Writes the page that computes beside docs/live/index.md, if ziglang and the files from npm are installed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util import logging

sys.path.insert(0, str(Path(__file__).parent / "live"))

from build import PageError, documentation_page, missing_tools


def write(app: Sphinx) -> None:
    """Builds the page, or writes a page that says which tools were missing."""
    if app.builder.format != "html":
        return
    missing = missing_tools() if app.config.live_page else "the option live_page"
    if missing:
        logging.getLogger(__name__).info("the page that computes is left out; it needs %s", missing)
        text = (
            f"<!DOCTYPE html><html lang='en'><title>not built</title><p>This site was built without {missing}.</html>"
        )
    else:
        try:
            text = documentation_page()
        except PageError as error:
            raise ExtensionError(str(error)) from error
    folder = Path(app.outdir) / "live"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "page.html").write_text(text)


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the option ``live_page`` and the step that writes the page."""
    app.add_config_value("live_page", True, "html", bool)
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True}
