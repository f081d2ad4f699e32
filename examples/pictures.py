"""How figures of examples look, in files that are the same bytes every time; and solvers of the examples' models."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import ordernm

HERE = Path(__file__).parent
FIGURES = HERE / "figures"

BLACK, BLUE, ORANGE, GREY, GREEN = "#000000", "#0072b2", "#d55e00", "#8a8a8a", "#009e73"
"""Told apart by colour-blind readers too."""

SETTINGS = {"svg.hashsalt": "ordernm", "svg.fonttype": "path", "font.size": 9, "font.family": "DejaVu Sans", "axes.grid": True,
            "axes.axisbelow": True, "grid.linewidth": 0.4, "grid.color": "#d0d0d0",
            "axes.spines.top": False, "axes.spines.right": False, "lines.linewidth": 1.4,
            "legend.frameon": False, "savefig.dpi": 150}  # fmt: skip


def folder_asked(about: str) -> Path | None:
    """Where the command line wants the figure; None for its place."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--folder", type=Path)
    folder: Path | None = parser.parse_args().folder
    return folder


def solver_of(name: str, folder: Path | None = None) -> Any:
    """The solver of a model of this folder, generated anew."""
    place = (folder or HERE.parent / "generated") / name
    ordernm.generate(HERE / f"{name}.yaml", place)
    return ordernm.load(place)


def figure(width: float, height: float, down: int = 1, across: int = 1, **more: Any) -> tuple[Any, Any]:
    """A figure of so many inches with its panels, without windows and without a user's settings."""
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.rcdefaults()
    matplotlib.rcParams.update(SETTINGS)
    made = Figure(figsize=(width, height))
    return made, made.subplots(down, across, squeeze=False, **more)


def write(made: Any, name: str, folder: Path | None = None) -> Path:
    """Write a figure as SVG.

    The layout is the tight one: the constrained one solves for places in an order that differs from call to call, and rounds so.
    """
    path = (folder or FIGURES) / f"{name}.svg"
    path.parent.mkdir(parents=True, exist_ok=True)
    made.tight_layout()
    made.savefig(path, format="svg", metadata={"Date": None})
    return path
