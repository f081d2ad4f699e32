"""``ordernm report``: speed against error of one model, as a page that anyone makes again.

`measuring` says what is measured and in which order; each part has a file of its own, which returns plain numbers;
`figures` draws them, `pages` prints them as HTML, Markdown and JSON.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .gallery import write_gallery
    from .measuring import Request, report

_PLACES = {"Request": "measuring", "report": "measuring", "write_gallery": "gallery"}


def __getattr__(name: str) -> Any:
    # imported when first asked for: processes that take times need neither sympy nor what draws
    if name in _PLACES:
        return getattr(import_module(f".{_PLACES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = ["Request", "report", "write_gallery"]
