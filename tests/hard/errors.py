"""Errors of derivatives, as the tests of hard cases measure them."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np


def error(found: Any, exact: Any) -> float:
    """The largest error of an entry of a vector, divided by the vector's largest entry."""
    size = max(abs(y) for y in exact)
    return float(max(abs(mpmath.mpf(float(x)) - y) for x, y in zip(found, exact, strict=True)) / size)


def errors(found: Any, exact: Any) -> list[float]:
    """The result of `error` for each direction."""
    return [error(x, y) for x, y in zip(found, exact, strict=True)]


def by_scale(found: Any, exact: Any, udot: Any, steps: Any) -> list[float]:
    """For each direction the largest error of what a step along it changes udot by, in parts of the larger of both.

    The measure for a parameter that hardly matters, such as the mass of a light body on a heavy one: what counts is by how much
    a change of all of it would be wrong.
    """
    size = max(abs(float(x)) for x in udot)
    return [
        float(max(abs(float(mpmath.mpf(float(x)) - y)) * step for x, y in zip(a, b, strict=True)))
        / max(size, step * max(abs(float(y)) for y in b))
        for a, b, step in zip(found, exact, np.asarray(steps, float), strict=True)
    ]
