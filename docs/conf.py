"""The documentation site: ``npm install --prefix docs && python -m sphinx -W docs build/site``."""

import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

from codegen.version import __version__

sys.path.insert(0, str(Path(__file__).parent))  # for command_line and live_page
sys.path.insert(0, str(Path(__file__).parents[1] / "examples" / "gallery"))  # for stage

project = "ordernm"
author = "The ordernm developers"
copyright = author
release = version = __version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "command_line",
    "live_page",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["build", "node_modules"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
myst_dmath_double_inline = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # numpydoc's sections have shapes and units
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

MATHJAX = "node_modules/mathjax/es5/tex-svg.js"  # one file that needs no fonts: the site works offline
mathjax_path = Path(MATHJAX).name
html_static_path = [MATHJAX]
if not (Path(__file__).parent / MATHJAX).exists():
    html_static_path = []
    logging.getLogger(__name__).warning(
        "docs/%s is missing, so equations are not typeset; run: npm install --prefix docs", MATHJAX
    )

sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "ignore_pattern": r"stage\.py",
    "image_scrapers": ("matplotlib", "stage.scraper"),
    "copyfile_regex": r".*\.yaml",
    "within_subsection_order": "FileNameSortKey",
    "show_signature": False,
    "plot_gallery": True,
    "abort_on_example_error": True,
}

html_theme = "furo"
html_title = f"ordernm {release}"
html_theme_options = {"navigation_with_keys": True}


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the option ``gallery``; without it, the gallery's scripts do not run and its pages have no pictures."""
    app.add_config_value("gallery", True, "html", bool)
    app.connect("builder-inited", without_pictures, priority=5)  # before sphinx_gallery reads its own option
    return {"parallel_read_safe": True}


def without_pictures(app: Sphinx) -> None:
    """Passes ``-D gallery=0`` to sphinx_gallery, whose ``-D plot_gallery=0`` gives warnings."""
    if not app.config.gallery:
        app.config.plot_gallery = False
