"""Model files and texts to models."""

from __future__ import annotations

import os
from os import PathLike, fspath

from .assembly import assemble
from .collector import collector_paused
from .errors import ModelError, Problem
from .model import Model
from .positions import compose, read_file


def load_model(path: str | PathLike[str]) -> Model:
    """Read a model file.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    Model
        Checked; doubts are in `Model.warnings`.

    Raises
    ------
    ModelError
        With every problem of the file, each with its place.
    """
    name = fspath(path)
    return parse_model(read_file(name), name, os.path.dirname(name) or ".")


def parse_model(text: str, filename: str = "<string>", folder: str | PathLike[str] | None = None) -> Model:
    """Read a model from YAML text; like `load_model`.

    Parameters
    ----------
    text : str
    filename : str
        Name for messages.
    folder : str or path, optional
        Where the files are that the text includes or uses; it may name none where this is left out.
    """
    if not text.strip():
        message = "the file is empty; a model has at least the keys model and bodies"
        raise ModelError([Problem(filename, 1, 1, "", message)])
    with collector_paused():
        return assemble(compose(text, filename), None if folder is None else fspath(folder))
