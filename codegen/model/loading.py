"""Reads models from files and texts."""

from __future__ import annotations

import os
import re
from os import PathLike, fspath
from typing import Any, Final

from .assembly import assemble
from .collector import collector_paused
from .errors import ModelError, Problem, with_article
from .file_bytes import file_name
from .model import Model
from .positions import compose, read_file

_PATH: Final = re.compile(r"[^\n:]*\.ya?ml")
_XML: Final = re.compile(r"\s*<[?!A-Za-z]")


def load_model(path: str | PathLike[str]) -> Model:
    """Read a model file.

    Parameters
    ----------
    path : str or path
        The YAML file. Files that it includes are read too.

    Returns
    -------
    Model
        The checked model. `Model.warnings` lists doubtful entries.

    Raises
    ------
    ModelError
        If the file has errors. The exception lists all of them with line and column.

    Examples
    --------
    >>> import ordernm
    >>> model = ordernm.load_model("examples/four_bar.yaml")
    >>> model.name, model.coordinate_names
    ('four_bar', ('crank', 'coupler', 'rocker'))
    """
    text = "this is the text of a model; a path is needed here, and parse_model reads a text"
    name = file_name(path, "a Model, or the path of its file,", text)
    return parse_model(read_file(name), name, os.path.dirname(name) or ".")


def parse_model(text: str, filename: str = "<string>", folder: str | PathLike[str] | None = None) -> Model:
    """Read a model from YAML text.

    Parameters
    ----------
    text : str
        The text of a model file.
    filename : str, optional
        Name of the text in messages.
    folder : str or path, optional
        Folder of the files that the text includes or uses. Default: the text must not name any.

    Returns
    -------
    Model
        The checked model. `Model.warnings` lists doubtful entries.

    Raises
    ------
    ModelError
        If the text has errors. The exception lists all of them with line and column.

    Examples
    --------
    >>> import ordernm
    >>> model = ordernm.parse_model('''
    ... model: pendulum
    ... gravity: [0, 0, -9.81]
    ... bodies:
    ...   bob: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -1]}
    ... ''')
    >>> model.speed_names
    ('bob',)
    """
    _check_text(text, filename)
    if not text.strip():
        message = "the file is empty; a model needs at least the keys model and bodies"
        raise ModelError([Problem(filename, 1, 1, "", message)])
    with collector_paused():
        return assemble(compose(text, filename), None if folder is None else fspath(folder))


def _check_text(text: Any, filename: str) -> None:
    """Reports objects that are no text, paths, and robots in XML."""
    if not isinstance(text, str):
        raise TypeError(
            f"{with_article(type(text).__name__)} is given; the text of a model is needed; load_model reads a file"
        )
    if _PATH.fullmatch(text):
        message = f"{text!r} is the path of a file; the text of a model is needed here, and load_model reads a file"
        raise ModelError([Problem(filename, 1, 1, "", message)])
    if _XML.match(text):
        robot = "FILE" if filename == "<string>" else filename
        message = f"this is XML, not a model; a robot in URDF, MJCF or SDF is converted by: ordernm import {robot}"
        raise ModelError([Problem(filename, 1, 1, "", message)])
