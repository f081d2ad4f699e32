"""Warnings that mean the line of whoever uses a solver."""

from __future__ import annotations

import os
import sys
import warnings

OURS = os.path.dirname(os.path.dirname(__file__)) + os.sep
"""Files of the run time and the package, which a warning never means."""


def warn(message: str) -> None:
    """Warn, with the nearest line that is not of a package itself."""
    level, frame = 1, sys._getframe(0)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(OURS):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, RuntimeWarning, stacklevel=level)
