"""Names of a package that are imported when they are first asked for."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def deferred(package: str, places: Mapping[str, str]) -> Callable[[str], Any]:
    """What a package has for ``__getattr__``.

    Parameters
    ----------
    package : str
        Its ``__name__``.
    places : mapping of str to str
        For each name, the module of the package that has it.
    """

    def found(name: str) -> Any:
        if name in places:
            return getattr(import_module(f".{places[name]}", package), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}; it has {', '.join(sorted(places))}")

    return found
