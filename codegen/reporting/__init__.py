"""``ordernm report``: speed against error of one model, as a page that anyone makes again.

`measuring` says what is measured and in which order; each part has a file of its own, which returns plain numbers;
`figures` draws them, `pages` prints them as HTML, Markdown and JSON.
"""

from .gallery import gallery
from .measuring import Request, report

__all__ = ["Request", "gallery", "report"]
