"""Figures as SVG text, drawn by matplotlib and readable in black and white."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from ..runtime.standalone.files.whole_file import MARK

SETTINGS: dict[Any, Any] = {
    "svg.hashsalt": "ordernm", "svg.fonttype": "none", "font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9, "axes.grid": True, "axes.grid.which": "major", "grid.linewidth": 0.4, "grid.color": "#cccccc",
    "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False, "text.parse_math": False,
}  # fmt: skip

STYLES: tuple[dict[str, Any], ...] = (
    {"color": "#000000", "marker": "o", "linestyle": "-"},
    {"color": "#0072b2", "marker": "^", "linestyle": (0, (5, 2))},
    {"color": "#8a8a8a", "marker": "s", "linestyle": (0, (1, 1.2))},
    {"color": "#d55e00", "marker": "D", "linestyle": (0, (5, 1, 1, 1))},
    {"color": "#000000", "marker": "P", "linestyle": (0, (8, 3))},
    {"color": "#0072b2", "marker": "v", "linestyle": (0, (3, 1, 1, 1, 1, 1))},
)
"""Markers and dashes of lines, which distinguish them without colours."""


@contextmanager
def drawing(width: float, height: float, columns: int = 1) -> Iterator[tuple[Any, Sequence[Any], list[str]]]:
    """A figure, its axes and a list; at the end of the context, the SVG text of the figure is appended to the list."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    text: list[str] = []
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        figure = Figure(figsize=(width, height))
        FigureCanvasSVG(figure)
        axes = figure.subplots(1, columns, squeeze=False)[0]
        yield figure, axes, text
        for ax in axes:
            for axis in (ax.xaxis, ax.yaxis):
                if axis.get_scale() == "log":
                    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
                    axis.set_minor_formatter(NullFormatter())
                    axis.set_major_locator(LogLocator(numticks=7))
        figure.tight_layout()
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": MARK})
        svg = buffer.getvalue()
        text.append(svg[svg.index("<svg") :])


@contextmanager
def rows_of_points(
    names: Sequence[str], label: str, columns: int = 2, **legend: Any
) -> Iterator[tuple[Any, Sequence[int], list[str]]]:
    """Axes with a row for each name, the first at the top, and the heights of rows; the SVG text is appended to the
    list."""
    with drawing(7.2, 0.9 + 0.36 * len(names)) as (_, (ax,), text):
        places = range(len(names))[::-1]
        yield ax, places, text
        ax.set_yticks(places, names)
        ax.set(ylim=(-0.6, len(names) - 0.4), xscale="log", xlabel=label)
        ax.grid(False, axis="y")
        ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=columns, borderaxespad=0, **legend)


@contextmanager
def under_the_roof(peaks: dict[str, float]) -> Iterator[tuple[Any, list[str]]]:
    """Axes with the peak performance of a core, for further points; appends the SVG text to the list."""
    with drawing(7.2, 3.6) as (_, (ax,), text):
        x = np.logspace(-2, 2, 200)
        for name, dashes in (("first cache", "-"), ("memory", (0, (5, 2)))):
            ax.plot(x, np.minimum(x * peaks[name], peaks["vectors"]) / 1e9, color="#000000", linewidth=1.2, linestyle=dashes,
                    label=f"{name}, {peaks[name] / 1e9:.0f} GB/s")  # fmt: skip
        ax.axhline(peaks["numbers"] / 1e9, color="#8a8a8a", linewidth=1, linestyle=(0, (1, 1.2)),
                   label=f"one number at a time, {peaks['numbers'] / 1e9:.1f} GFlop/s")  # fmt: skip
        yield ax, text
        ax.set(xscale="log", yscale="log", xlabel="operations per byte of arguments and results", ylabel="GFlop/s")
        ax.legend(loc="upper left", bbox_to_anchor=(1, 1), fontsize=8)
