"""Style of the examples' figures, whose files are reproducible to the byte, and solvers of the examples' models."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import ordernm

HERE = Path(__file__).parent
FIGURES = HERE / "figures"

BLACK, BLUE, ORANGE, GREY, GREEN = "#000000", "#0072b2", "#d55e00", "#8a8a8a", "#009e73"
"""Colours that colour-blind readers can distinguish."""

SETTINGS = {"svg.hashsalt": "ordernm", "svg.fonttype": "path", "font.size": 9, "font.family": "DejaVu Sans", "axes.grid": True,
            "axes.axisbelow": True, "grid.linewidth": 0.4, "grid.color": "#d0d0d0",
            "axes.spines.top": False, "axes.spines.right": False, "lines.linewidth": 1.4,
            "legend.frameon": False, "savefig.dpi": 150}  # fmt: skip


def folder_asked(about: str) -> Path | None:
    """The folder for the figure from the command line; None for the default."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--folder", type=Path)
    folder: Path | None = parser.parse_args().folder
    return folder


def solver_of(name: str, folder: Path | None = None) -> Any:
    """Generate the solver of a model in this folder."""
    place = (folder or HERE.parent / "generated") / name
    ordernm.generate(HERE / f"{name}.yaml", place)
    return ordernm.load(place)


def figure(width: float, height: float, down: int = 1, across: int = 1, **more: Any) -> tuple[Any, Any]:
    """A figure of given size in inches with its panels, without windows and without a user's settings."""
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.rcdefaults()
    matplotlib.rcParams.update(SETTINGS)
    made = Figure(figsize=(width, height))
    return made, made.subplots(down, across, squeeze=False, **more)


def write(made: Any, name: str, folder: Path | None = None) -> Path:
    """Write a figure as SVG.

    It uses the tight layout: the constrained layout solves for positions in an order that varies between calls, and so does its
    rounding.
    """
    path = (folder or FIGURES) / f"{name}.svg"
    path.parent.mkdir(parents=True, exist_ok=True)
    made.tight_layout()
    made.savefig(path, format="svg", metadata={"Date": None})
    return path
