"""Valid names for the model format, made from arbitrary names in a reproducible way."""

from __future__ import annotations

import re
from collections.abc import Iterable
from collections.abc import Set as AbstractSet
from typing import Final

from ..model import ModelBuilder, ModelError
from ..model.entries import RESERVED

_LONGEST: Final = 200
"""Largest length of a name: YAML reads keys of up to 1024 characters."""
_NAME: Final = re.compile(f"[A-Za-z_][A-Za-z0-9_]{{0,{_LONGEST - 1}}}")
_YAML: Final = frozenset({"null"})
"""Words that YAML would not read as a name."""


def is_name(text: str) -> bool:
    """Whether a text is a valid name of a body."""
    return bool(_NAME.fullmatch(text)) and text not in RESERVED and text not in _YAML


def made_name(text: str) -> str:
    """A valid name similar to a text: other characters become ``_``, and long names are cut."""
    name = re.sub("[^A-Za-z0-9_]+", "_", text)[: _LONGEST - 2]
    if not name.strip("_"):
        name = "link"
    if name[0].isdigit():
        name = f"_{name}"
    return name if is_name(name) else f"{name}_"


def names_for(texts: Iterable[str]) -> dict[str, str]:
    """A different name for every text; valid names are kept.

    Parameters
    ----------
    texts : iterable of str
        All different; earlier ones get their names first.
    """
    listed = list(texts)
    result = {text: text for text in listed if is_name(text)}
    used = set(result)
    for text in listed:
        if text not in result:
            result[text] = free_name(made_name(text), used)
            used.add(result[text])
    return {text: result[text] for text in listed}


def free_name(wanted: str, used: Iterable[str]) -> str:
    """NAME, or the first of NAME_2, NAME_3, ... that is not used."""
    taken = used if isinstance(used, AbstractSet) else set(used)
    name, k = wanted, 1
    while name in taken:
        k += 1
        name = f"{wanted}_{k}"
    return name


def model_name(text: str) -> str:
    """A name for the model and the package, similar to a text: in lower case, and no keyword of Python or C or module name."""
    name = made_name(text).lower().strip("_") or "robot"
    if name[0].isdigit():
        name = f"robot_{name}"
    return name if names_a_model(name) else f"{name}_robot"


def names_a_model(name: str) -> bool:
    """Whether a text is a valid name for a model and its package."""
    builder = ModelBuilder(name)
    builder.body("link", mass=1, axis="x", inertia={"xx": 1, "yy": 1, "zz": 1})
    try:
        builder.build()
    except ModelError:
        return False
    return True
