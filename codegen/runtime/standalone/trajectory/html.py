"""A trajectory in a notebook: a table with a small curve for each series, without anything from elsewhere."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices

SHOWN = 12
"""So many series are shown."""

WIDTH, HEIGHT, MARGIN = 160, 28, 2
"""Of a curve, in pixels."""

BINS = 80
"""Of many times the least and the largest values of so many intervals are drawn, so that no peak is lost."""


def as_html(lines: Sequence[str], t: Array, series: Sequence[tuple[str, str, Array]]) -> str:
    """Lines of text, and series (name, unit, values (nt,)) over the times t (nt,)."""
    text = "<br>".join(escape(line.strip()) for line in lines)
    rows = [
        f"<tr><td style='text-align:left'>{escape(name)}</td><td style='text-align:left'>{escape(unit)}</td>"
        f"<td>{sparkline(t, values)}</td>{''.join(f'<td>{number}</td>' for number in _numbers(values))}</tr>"
        for name, unit, values in series[:SHOWN]
    ]
    head = "".join(f"<th>{word}</th>" for word in ("series", "unit", "over time", "least", "largest", "last"))
    left = len(series) - SHOWN
    more = f"<tr><td colspan='6' style='text-align:left'>and {left} more</td></tr>" if left > 0 else ""
    return f"<div><p>{text}</p><table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}{more}</tbody></table></div>"


def sparkline(t: Array, values: Array) -> str:
    """A curve as SVG; it is broken where values are not finite."""
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
    """Values between two places; in the middle, if they are all the same."""
    least, most = float(np.min(values[finite])), float(np.max(values[finite]))
    with np.errstate(all="ignore"):
        # halves, since their difference may be beyond floating-point numbers
        span = most / 2 - least / 2
        share = (values / 2 - least / 2) / span if span > 0 else np.full(len(values), 0.5)
    return low + (high - low) * share


def _extremes(values: Array, bins: int) -> Indices:
    """Places of the least and the largest value of each of so many intervals, and of the ends."""
    n = len(values)
    if n <= 2 * bins:
        return np.arange(n)
    edges = np.linspace(0, n, bins + 1).astype(int)
    kept = {0, n - 1}
    for a, b in itertools.pairwise(edges):
        kept |= {a + int(np.argmin(values[a:b])), a + int(np.argmax(values[a:b]))}
    return np.array(sorted(kept))


def _numbers(values: Array) -> list[str]:
    """The least, the largest and the last value."""
    finite = values[np.isfinite(values)]
    ends = [f"{np.min(finite):.6g}", f"{np.max(finite):.6g}"] if len(finite) else ["", ""]
    return [*ends, f"{values[-1]:.6g}" if len(values) else ""]
