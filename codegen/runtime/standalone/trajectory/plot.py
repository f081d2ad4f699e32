"""Plots of trajectories: small panels over time, drawn by matplotlib, which is imported only when needed.

The plots are readable in black and white, because curves in a panel differ by dashes. Drawing without pyplot opens no
window and ignores the user's settings: the same trajectory gives the same bytes.
"""

from __future__ import annotations

import functools
import io
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..files.whole_file import MARK, suffix_among, write_whole

FORMATS: dict[str, dict[str, str | None]] = {
    ".svg": {"Date": None, "Creator": MARK},
    ".png": {"Software": MARK},
    ".pdf": {"CreationDate": None, "Creator": MARK},
}
"""For each suffix of a picture file, the metadata that omit dates."""

MOST_PANELS, CUT = 60, 24
"""Maximum number of series in a picture, and maximum number if the user names none."""

WIDTHS = {1: 6.5, 2: 8.0, 3: 9.0}
"""Width of a picture in inches, by the number of panels side by side."""

MOST_CURVES = 8
"""Maximum number of derivatives in one panel; further ones are not shown."""

DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 2, 1, 2)))
COLOURS = ("#000000", "#0072b2", "#d55e00", "#8a8a8a", "#009e73", "#aa4499", "#4d4d4d", "#b8860b")
"""Styles of the curves in one panel; colour-blind readers can distinguish these colours."""

SETTINGS = {"svg.hashsalt": "ordernm", "text.parse_math": False, "font.size": 9, "font.family": "DejaVu Sans",
            "axes.formatter.limits": (-3, 4), "path.simplify": True, "savefig.dpi": 150, "figure.dpi": 100}  # fmt: skip

ROUNDING = 1e-12
"""Relative change below which a curve is drawn as constant."""

Series = tuple[str, str, Array]
"""A series of a trajectory: name, unit, values (nt,)."""


class PlotError(ValueError):
    """Raised if a plot cannot be drawn, or if the file type is not allowed."""


def suffix_of(path: str | os.PathLike[str]) -> str:
    """The suffix of a picture file; raises an error with the allowed suffixes for any other."""
    return suffix_among(path, FORMATS, PlotError, f"pictures are written as {', '.join(FORMATS)}")


def need() -> Any:
    """The matplotlib module; raises ImportError with installation instructions if it is missing."""
    try:
        import matplotlib
    except ImportError as error:
        raise ImportError('plots need matplotlib: pip install "ordernm[plot]", or pip install matplotlib') from error
    return matplotlib


def draw(
    title: str,
    t: Array,
    panels: Sequence[tuple[Series, Sequence[Series]]],
    path: str | os.PathLike[str] | None = None,
    cut: bool = False,
) -> Any:
    """A figure with a panel for each series over the times t (nt,), and beside it a panel for the derivatives of this
    series.

    Parameters
    ----------
    panels : sequence of (series, derivatives)
        The name of a derivative is the variable of differentiation.
    path : path, optional
        File to write.
    cut : bool
        Whether to show only the first of many series, instead of raising an error.
    """
    suffix = None if path is None else suffix_of(path)
    matplotlib = need()
    if not panels:
        raise PlotError(
            "there is nothing to plot: no series were named, or the model has neither outputs nor coordinates"
        )
    if len(panels) > MOST_PANELS and not cut:
        raise PlotError(f"{len(panels)} series are too many for a picture, {MOST_PANELS} are allowed; name fewer")
    notes = []
    if cut and len(panels) > CUT:
        notes.append(f"the first {CUT} of {len(panels)} series")
        panels = panels[:CUT]
    directions = max(len(derivatives) for _, derivatives in panels)
    if directions > MOST_CURVES:
        notes.append(f"the first {MOST_CURVES} of {directions} derivatives")
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        figure = _figure(", ".join([title, *notes]), t, panels, bool(directions))
        if path is not None and suffix is not None:
            metadata = FORMATS[suffix]
            write_whole(Path(path), lambda file: figure.savefig(file, format=suffix[1:], metadata=metadata))
    figure._repr_png_ = functools.partial(png_of, figure)  # for notebooks, without a pyplot backend
    return figure


def png_of(figure: Any) -> bytes:
    """The PNG image of a figure."""
    file = io.BytesIO()
    figure.savefig(file, format="png", metadata=FORMATS[".png"])
    return file.getvalue()


def _figure(title: str, t: Array, panels: Sequence[tuple[Series, Sequence[Series]]], derivatives: bool) -> Any:
    from matplotlib.figure import Figure

    n = len(panels)
    across = 2 if derivatives else 1 if n < 4 else 2 if n < 9 else 3
    down = n if derivatives else math.ceil(n / across)
    width = 9.0 if derivatives else WIDTHS[across]
    height = 1.75 * down if down > 1 else 2.6
    figure = Figure(figsize=(width, height + 0.5), layout="constrained")
    figure.suptitle(title, fontsize=10, fontweight="bold", x=0.01, horizontalalignment="left")
    axes = figure.subplots(down, across, sharex=True, squeeze=False)
    places = axes[:, 0] if derivatives else axes.ravel()
    for (series, several), place, row in zip(panels, places, axes if derivatives else places, strict=False):
        _curves(place, t, [series], _labelled(series[0], series[1]))
        if derivatives:
            _derivatives(row[1], t, series[0], several[:MOST_CURVES])
    for left_over in places[n:]:
        left_over.set_axis_off()
    for column in range(across):
        last = max(i for i in range(down) if derivatives or i * across + column < n)
        axes[last, column].set_xlabel("t (s)")
        axes[last, column].tick_params(labelbottom=True)
    return figure


def _derivatives(place: Any, t: Array, name: str, several: Sequence[Series]) -> None:
    """Draws derivatives in one panel; small ones are multiplied by a power of ten, which the legend gives."""
    if len(several) == 1:
        ((by, unit, values),) = several
        _curves(place, t, [(by, unit, values)], _labelled(f"d {name} / d {by}", unit))
        return
    exponents = _exponents([values for _, _, values in several])
    scaled = [
        (_labelled(by + (f" × {10.0**e:g}" if e else ""), unit), unit, values * 10.0**e)
        for (by, unit, values), e in zip(several, exponents, strict=True)
    ]
    _curves(place, t, scaled, f"derivatives of {name} with respect to")
    place.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False, handlelength=3.2)


def _exponents(several: Sequence[Array]) -> list[int]:
    """Exponents of the powers of ten that bring curves to a similar height; zero for curves within a factor of ten of
    the highest."""
    heights = [float(np.max(np.abs(x[np.isfinite(x)]), initial=0.0)) for x in several]
    highest = max(heights)
    found = []
    for height in heights:
        share = math.log10(highest) - math.log10(height) if height > 0 else 0.0
        # rounding errors must not be magnified
        found.append(math.floor(share) if 1.0 <= share <= -math.log10(ROUNDING) else 0)
    return found


def _curves(place: Any, t: Array, several: Sequence[Series], label: str) -> None:
    """Draws curves in a panel, with the label above the panel on the left, where a long label fits."""
    from matplotlib.ticker import MaxNLocator

    few = len(t) < 3
    for i, (name, _, values) in enumerate(several):
        style, colour = DASHES[i % len(DASHES)], COLOURS[i % len(COLOURS)]
        shown = np.where(np.isfinite(values), values, np.nan)
        place.plot(t, shown, linestyle=style, color=colour, linewidth=1.3, marker="o" if few else None, label=name)
    _keep_flat(place, [values for _, _, values in several])
    place.set_title(label, loc="left", fontsize=9, pad=4)
    place.yaxis.set_major_locator(MaxNLocator(4))
    place.xaxis.set_major_locator(MaxNLocator(6))
    place.grid(True, linewidth=0.4, color="#d0d0d0")
    for side in ("top", "right"):
        place.spines[side].set_visible(False)


def _keep_flat(place: Any, several: Sequence[Array]) -> None:
    """Widens the axis of curves that are constant to rounding."""
    finite = [x[np.isfinite(x)] for x in several]
    values = np.concatenate(finite) if finite else np.zeros(0)
    if not len(values):
        return
    low, high = float(np.min(values)), float(np.max(values))
    size = max(abs(low), abs(high))
    if high - low <= ROUNDING * size or size < 1e-300:
        half = size / 2 or 1.0
        place.set_ylim((low / 2 + high / 2) - half, (low / 2 + high / 2) + half)


def _labelled(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name
