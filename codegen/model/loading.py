"""Reads models from files and texts."""

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
        The YAML file. Files that it includes are read too.

    Returns
    -------
    Model
        The checked model. `Model.warnings` lists doubtful entries.

    Raises
    ------
    ModelError
        If the file has errors. It lists all of them with line and column.

    Examples
    --------
    >>> import ordernm
    >>> model = ordernm.load_model("examples/four_bar.yaml")
    >>> model.name, model.coordinate_names
    ('four_bar', ('crank', 'coupler', 'rocker'))
    """
    name = fspath(path)
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
        If the text has errors. It lists all of them with line and column.

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
    if not text.strip():
        message = "the file is empty; a model needs at least the keys model and bodies"
        raise ModelError([Problem(filename, 1, 1, "", message)])
    with collector_paused():
        return assemble(compose(text, filename), None if folder is None else fspath(folder))
