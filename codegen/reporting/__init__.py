"""``ordernm report``: speed and accuracy of one model, as a page that anyone can reproduce.

`measuring` defines the measurements and their order. Each part has a file of its own, which returns plain numbers.
`figures` draws them, and `pages` prints them as HTML, Markdown and JSON.
"""

from typing import TYPE_CHECKING

from ..deferred import deferred

if TYPE_CHECKING:
    from .gallery import write_gallery
    from .measuring import Request, report

_PLACES = {"Request": "measuring", "report": "measuring", "write_gallery": "gallery"}

# imported at first use: processes that only measure times need neither sympy nor matplotlib
__getattr__ = deferred(__name__, _PLACES)

__all__ = ["Request", "report", "write_gallery"]
