"""A trajectory for notebooks: a self-contained HTML table with a small curve for each series."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ....html_tables import Markup, html_of
from ..arrays import Array, Indices

SHOWN = 12
"""Number of series shown."""

WIDTH, HEIGHT, MARGIN = 160, 28, 2
"""Size of a curve and its margin, in pixels."""

BINS = 80
"""Number of intervals of a long series; its curve shows the minimum and maximum of each, so that no peak is lost."""


def as_html(lines: Sequence[str], t: Array, series: Sequence[tuple[str, str, Array]]) -> str:
    """HTML of lines of text, and of series (name, unit, values (nt,)) over the times t (nt,)."""
    head = ("series", "unit", "over time", "least", "largest", "last")
    rows = ((name, unit, Markup(sparkline(t, values)), *_numbers(values)) for name, unit, values in series)
    return html_of(lines, head, rows, SHOWN)


def sparkline(t: Array, values: Array) -> str:
    """A curve as SVG, interrupted where values are not finite."""
    finite = np.isfinite(t) & np.isfinite(values)
    picture = f"<svg width='{WIDTH}' height='{HEIGHT}' viewBox='0 0 {WIDTH} {HEIGHT}' role='img' aria-hidden='true'>"
    if not finite.any():
        return f"{picture}</svg>"
    x = _scaled(t, finite, MARGIN, WIDTH - MARGIN)
    y = _scaled(values, finite, HEIGHT - MARGIN, MARGIN)
    drawn = []
    ends = np.flatnonzero(np.diff(np.concatenate([[False], finite, [False]]).astype(int)))
    for start, end in zip(ends[::2], ends[1::2], strict=True):
        kept = start + _extremes(values[start:end], max(2, BINS * (end - start) // len(t)))
        points = " ".join(f"{x[i]:.1f},{y[i]:.1f}" for i in kept)
        if len(kept) == 1:
            drawn.append(f"<circle cx='{x[start]:.1f}' cy='{y[start]:.1f}' r='1.5' fill='currentColor'/>")
        else:
            drawn.append(f"<polyline points='{points}' fill='none' stroke='currentColor' stroke-width='1.2'/>")
    return f"{picture}{''.join(drawn)}</svg>"


def _scaled(values: Array, finite: NDArray[np.bool_], low: float, high: float) -> Array:
    """The values mapped to the range from low to high; if all are equal, the middle of the range."""
    least, most = float(np.min(values[finite])), float(np.max(values[finite]))
    with np.errstate(all="ignore"):
        # values are halved, since their difference may overflow
        span = most / 2 - least / 2
        share = (values / 2 - least / 2) / span if span > 0 else np.full(len(values), 0.5)
    return low + (high - low) * share


def _extremes(values: Array, bins: int) -> Indices:
    """Indices of the minimum and maximum in each of the intervals, and of the ends."""
    n = len(values)
    if n <= 2 * bins:
        return np.arange(n)
    edges = np.linspace(0, n, bins + 1).astype(int)
    kept = {0, n - 1}
    for a, b in itertools.pairwise(edges):
        kept |= {a + int(np.argmin(values[a:b])), a + int(np.argmax(values[a:b]))}
    return np.array(sorted(kept))


def _numbers(values: Array) -> list[float | None]:
    """The minimum, maximum and last value; None where there are no finite values."""
    finite = values[np.isfinite(values)]
    ends = [float(np.min(finite)), float(np.max(finite))] if len(finite) else [None, None]
    return [*ends, float(values[-1]) if len(values) else None]
