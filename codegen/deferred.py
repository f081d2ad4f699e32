"""Deferred imports: a name of a package is imported when it is first used."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def deferred(package: str, places: Mapping[str, str]) -> Callable[[str], Any]:
    """Returns a function that a package can use as its ``__getattr__``.

    Parameters
    ----------
    package : str
        The package's ``__name__``.
    places : mapping of str to str
        The module that defines each name.
    """

    def found(name: str) -> Any:
        if name in places:
            return getattr(import_module(f".{places[name]}", package), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}; it has {', '.join(sorted(places))}")

    return found
