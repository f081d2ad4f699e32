"""Force laws along the line between two points, one file each; every file in this folder is a law.

A file has the name of its type and contains one ``LAW``, a `LineLaw`. No other list names it.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import Final

from ..line_law import LineLaw, LineLawError


def _found() -> dict[str, LineLaw]:
    laws = {}
    for name in sorted(module.name for module in iter_modules(__path__)):
        law = getattr(import_module(f".{name}", __name__), "LAW", None)
        if not isinstance(law, LineLaw) or law.type != name:
            seen = f"a law of type {law.type!r}" if isinstance(law, LineLaw) else "no law"
            raise LineLawError(f"{name}.py in {__name__} has {seen}; LAW = LineLaw({name!r}, ...) is needed")
        laws[name] = law
    return laws


LINE_LAWS: Final[dict[str, LineLaw]] = _found()
"""Laws by type, in alphabetical order."""
