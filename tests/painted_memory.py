"""Memory filled with NaN before a call, so that NaN in the results shows reads of memory that was not written."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest


def filled(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Fill new memory of NumPy with NaN; returns the sizes of the filled arrays."""
    sizes = []

    def full(shape: Any, dtype: Any = float, *given: Any, **named: Any) -> np.ndarray:
        is_real = np.issubdtype(np.dtype(dtype), np.floating)
        found = np.full(shape, np.nan if is_real else 0, dtype, *given, **named)
        sizes.append(found.size)
        return found

    monkeypatch.setattr(np, "empty", full)
    return sizes
