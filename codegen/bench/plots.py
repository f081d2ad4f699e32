"""Pictures of benchmark results as SVG, readable in black and white: times over sizes, a roofline, and robots."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ..folders import FolderError
from ..measure.clock import exponent
from ..measure.drawing import STYLES, drawing, rows_of_points, under_the_roof
from ..own_files import refuse_foreign_file

PICTURES = ("time_by_size", "roofline", "robots")


def refuse_foreign(folder: Path, force: bool) -> None:
    """Raise `FolderError` if a picture cannot be written, or would replace a file that ordernm did not write."""
    if os.path.lexists(folder) and not folder.is_dir():
        raise FolderError(f"{folder} is a file; give a folder for the pictures")
    for name in PICTURES if folder.is_dir() else ():
        refuse_foreign_file(folder / f"{name}.svg", force)


def write_plots(pictures: dict[str, str], folder: Path) -> None:
    """Write the pictures of `plots` into a folder, which is created if needed."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, svg in pictures.items():
        (folder / f"{name}.svg").write_text(svg, encoding="utf-8")


def plots(results: dict[str, Any]) -> dict[str, str]:
    """Pictures of the results as SVG text, by name."""
    problems = results["problems"]
    families = {n: r for n, r in problems.items() if r["kind"] == "family" and len(r["sizes"]) > 1}
    found = {"time_by_size": time_by_size(families)} if families else {}
    if "peaks" in results and any("roofline" in row for r in families.values() for row in r["sizes"]):
        found["roofline"] = roofline(families, results["peaks"])
    for r in problems.values():
        if r["kind"] == "robots" and r["rows"]:
            found["robots"] = robots(r["rows"])
    return found


def time_by_size(families: dict[str, Any]) -> str:
    """Time of an evaluation in microseconds over the number of coordinates, with its exponent, by family."""
    functions = list(next(iter(families.values()))["sizes"][0]["seconds"])
    with drawing(7.2, 3.8, len(functions)) as (_, axes, text):
        for ax, function in zip(axes, functions, strict=True):
            for (name, r), style in zip(families.items(), STYLES, strict=False):
                sizes = [row["bodies"] for row in r["sizes"]]
                seconds = [row["seconds"][function] for row in r["sizes"]]
                label = f"{name}, exponent {exponent(sizes, seconds):.2f}"
                ax.plot(sizes, [1e6 * s for s in seconds], label=label, markersize=4, linewidth=1, **style)
            ax.set(xscale="log", yscale="log", xlabel="coordinates")
            ax.set_title(f"{function} directions" if "+" in function else function, fontsize=9)
            ax.legend(loc="upper left", fontsize=7)
        axes[0].set_ylabel("microseconds, in C")
    return text[0]


def roofline(families: dict[str, Any], peaks: dict[str, float]) -> str:
    """Operations per second in C, below the limits of the core: hollow marks for udot, filled marks with directions."""
    with under_the_roof(peaks) as (ax, text):
        for (name, r), style in zip(families.items(), STYLES, strict=False):
            points = [row["roofline"] for row in r["sizes"] if "roofline" in row]
            for function, face in zip(zip(*points, strict=True), ("none", style["color"]), strict=True):
                ax.plot([p["per_byte"] for p in function], [p["per_second"] / 1e9 for p in function], linestyle="none",
                        marker=style["marker"], color=style["color"], markerfacecolor=face, markersize=4,
                        label=f"{name}, {function[0]['name']}")  # fmt: skip
    return text[0]


def robots(rows: list[dict[str, Any]]) -> str:
    """For each robot and function: the time of ordernm divided by that of Pinocchio."""
    functions = list(rows[0]["seconds"])
    label = "time over Pinocchio's, both from Python (dashed: equal); beside names the number of speeds"
    names = [f"{row['model']}, {row['speeds']}" for row in rows]
    with rows_of_points(names, label, len(functions), fontsize=8) as (ax, places, text):
        for function, style in zip(functions, STYLES, strict=False):
            ratios = [row["seconds"][function] / row["theirs"][function] for row in rows]
            ax.plot(ratios, places, linestyle="none", markersize=5, label=function, marker=style["marker"], color=style["color"],
                    markerfacecolor="none")  # fmt: skip
        ax.axvline(1.0, color="#000000", linewidth=0.8, linestyle=(0, (5, 2)))
    return text[0]
