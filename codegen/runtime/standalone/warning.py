"""Warnings that point to the user's line of code."""

from __future__ import annotations

import os
import sys
import warnings

_HERE = os.path.dirname(os.path.dirname(__file__))
OURS = (os.path.dirname(_HERE) if __name__.endswith("runtime.standalone.warning") else _HERE) + os.sep
"""Folder of the generated package, or of ordernm; warnings point to the first line outside."""


def warn(message: str) -> None:
    """Issues a RuntimeWarning at the innermost line outside the package."""
    level, frame = 1, sys._getframe(0)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(OURS):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, RuntimeWarning, stacklevel=level)
