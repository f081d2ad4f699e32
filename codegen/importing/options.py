"""Options of an import."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from ..model.errors import nearest


@dataclass(frozen=True, slots=True)
class Options:
    """Options of an import; see `import_model`."""

    name: str | None = None
    model: str | None = None
    key: str | None = None
    base: str | None = None
    keep_fixed: bool = False
    repair: bool = False
    free_mimic: bool = False
    motors: bool = False
    exact_angles: bool = False
    parameterize: str | Mapping[str, Iterable[str] | str] | Iterable[str] | None = None
    loops: str | os.PathLike[str] | None = None
    package_paths: Sequence[str | os.PathLike[str]] = ()
    folder: str | os.PathLike[str] | None = None


def options_of(given: Mapping[str, Any]) -> Options:
    """The options that a user gives by name.

    Raises
    ------
    TypeError
        If there is no option of that name.
    ValueError
        If an option that is true or false has another value.
    """
    known = [f.name for f in fields(Options)]
    for name in given:
        if name not in known:
            raise TypeError(f"an import has no option {name!r}; options are {', '.join(known)}{nearest(name, known)}")
    for f in fields(Options):
        if f.type == "bool" and not isinstance(given.get(f.name, False), bool):
            raise ValueError(f"{f.name} is {given[f.name]!r}; allowed are True and False")
    return Options(**given)
