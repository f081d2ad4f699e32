"""Force laws along the line between two points, a file each: what is in this folder is what there is.

A file is called after the type that it adds and holds one ``LAW``, a `LineLaw`. Nothing else names it.
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
"""By type, in the order of the alphabet."""
