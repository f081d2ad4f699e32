"""Names that the model format takes, from names that may be anything; the same ones every time."""

from __future__ import annotations

import re
from collections.abc import Iterable
from collections.abc import Set as AbstractSet
from typing import Final

from ..model import ModelBuilder, ModelError
from ..model.entries import RESERVED

_LONGEST: Final = 200
"""Characters of a name: YAML reads keys of up to 1024."""
_NAME: Final = re.compile(f"[A-Za-z_][A-Za-z0-9_]{{0,{_LONGEST - 1}}}")
_YAML: Final = frozenset({"null"})
"""What YAML would not read as a name."""


def is_name(text: str) -> bool:
    """Whether a body may be called so."""
    return bool(_NAME.fullmatch(text)) and text not in RESERVED and text not in _YAML


def made_name(text: str) -> str:
    """A name that looks like a text: other characters become ``_``, and long ones are cut."""
    name = re.sub("[^A-Za-z0-9_]+", "_", text)[: _LONGEST - 2]
    if not name.strip("_"):
        name = "link"
    if name[0].isdigit():
        name = f"_{name}"
    return name if is_name(name) else f"{name}_"


def names_for(texts: Iterable[str], taken: Iterable[str] = ()) -> dict[str, str]:
    """A name for every text, all different; those that are names already keep theirs.

    Parameters
    ----------
    texts : iterable of str
        Different from each other, in the order in which they may choose.
    taken : iterable of str
        Names that are not free.
    """
    listed, used = list(texts), set(taken)
    result = {text: text for text in listed if is_name(text) and text not in used}
    used |= result.keys()
    for text in listed:
        if text not in result:
            result[text] = free_name(made_name(text), used)
            used.add(result[text])
    return {text: result[text] for text in listed}


def free_name(wanted: str, used: Iterable[str]) -> str:
    """The name, or the first of NAME_2, NAME_3, ... that is not used."""
    taken = used if isinstance(used, AbstractSet) else set(used)
    name, k = wanted, 1
    while name in taken:
        k += 1
        name = f"{wanted}_{k}"
    return name


def model_name(text: str) -> str:
    """A name for the model, and so for the package: lower case, no word of Python or C, no module."""
    name = made_name(text).lower().strip("_") or "robot"
    if name[0].isdigit():
        name = f"robot_{name}"
    return name if names_a_model(name) else f"{name}_robot"


def names_a_model(name: str) -> bool:
    """Whether a model, and so a package, may be called so."""
    builder = ModelBuilder(name)
    builder.body("link", mass=1, axis="x", inertia={"xx": 1, "yy": 1, "zz": 1})
    try:
        builder.build()
    except ModelError:
        return False
    return True
