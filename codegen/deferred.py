"""Deferred imports: a name of a package is imported when it is first used."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from .wording import nearest

ROOT = __package__ or ""


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
        raise AttributeError(f"module {_public(package)!r} has no attribute {name!r}{_hint(package, places, name)}")

    return found


def _public(module: str) -> str:
    """The name under which users import a module."""
    return "ordernm" + module.removeprefix(ROOT)


def _hint(package: str, places: Mapping[str, str], name: str) -> str:
    """Where a name is that a package lacks, or what the package has."""
    if name.startswith("_"):
        return ""  # programs ask modules for such names
    root = import_module(ROOT)
    if package == ROOT and name in root._MODULES:
        return f"; it is a module: import {_public(ROOT)}.{name}"
    names = {ROOT: root.__all__} | {f"{ROOT}.{m}": import_module(f"{ROOT}.{m}").__all__ for m in sorted(root._MODULES)}
    elsewhere = " and ".join(_public(m) for m, known in names.items() if name in known)
    return f"; it is in {elsewhere}" if elsewhere else f"; it has {', '.join(sorted(places))}{nearest(name, places)}"
