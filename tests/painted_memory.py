"""Memory that is full of NaN before a call: what a function reads and has not written is seen in its results."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest


def filled(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Let NumPy fill new memory with NaN; returns the sizes of the arrays that it fills."""
    sizes = []

    def full(shape: Any, dtype: Any = float, *given: Any, **named: Any) -> np.ndarray:
        is_real = np.issubdtype(np.dtype(dtype), np.floating)
        found = np.full(shape, np.nan if is_real else 0, dtype, *given, **named)
        sizes.append(found.size)
        return found

    monkeypatch.setattr(np, "empty", full)
    return sizes
