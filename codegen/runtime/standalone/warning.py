"""Warnings that mean the line of whoever uses a solver."""

from __future__ import annotations

import os
import sys
import warnings

_HERE = os.path.dirname(os.path.dirname(__file__))
OURS = (os.path.dirname(_HERE) if __name__.endswith("runtime.standalone.warning") else _HERE) + os.sep
"""Folder of the generated package, or of ordernm, whose lines no warning points at."""


def warn(message: str) -> None:
    """Warn, with the nearest line that is not of a package itself."""
    level, frame = 1, sys._getframe(0)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(OURS):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, RuntimeWarning, stacklevel=level)
