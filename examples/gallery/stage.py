"""Solvers, figures and animations of the gallery's scripts.

With ``ORDERNM_GALLERY=short`` in the environment the scripts take fewer steps and write no animations, as the tests do.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from PIL import Image, ImageSequence

import ordernm

HERE = Path(__file__).parent
GENERATED = HERE.parents[1] / "generated"
ANIMATIONS = HERE.parents[1] / "build" / "animations"

SHORT = os.environ.get("ORDERNM_GALLERY") == "short"
"""Whether the scripts run in their short form."""

BLACK, BLUE, ORANGE, GREY, GREEN = "#000000", "#0072b2", "#d55e00", "#8a8a8a", "#009e73"
"""Colours that colour-blind readers can distinguish."""

STYLE = {"axes.grid": True, "axes.axisbelow": True, "grid.linewidth": 0.4, "grid.color": "#d0d0d0", "font.size": 9,
         "axes.spines.top": False, "axes.spines.right": False, "axes.titlesize": 10, "axes.titlelocation": "left",
         "lines.linewidth": 1.4, "legend.frameon": False, "legend.fontsize": 8, "figure.dpi": 120}  # fmt: skip

_written: list[Path] = []


def solver(model: Any, **options: Any) -> Any:
    """The solver of a model of this folder or of `examples`, or of a `Model`, with the options of `ordernm.generate`."""
    if isinstance(model, str):
        model = next(p for p in (HERE / model, HERE.parent / model) if p.is_file())
    name = model.stem if isinstance(model, Path) else model.name
    ordernm.generate(model, GENERATED / f"gallery_{name}", **options)
    return ordernm.load(GENERATED / f"gallery_{name}")


def figure(width: float, height: float, down: int = 1, across: int = 1, **more: Any) -> tuple[Any, Any]:
    """A figure of given size in inches, and its panels."""
    plt.rcParams.update(STYLE)
    return plt.subplots(down, across, figsize=(width, height), layout="constrained", **more)


def animate(run: Any, name: str, **more: Any) -> None:
    """Write the animation of a trajectory to ``build/animations``, with 16 colours and 400 pixels wide; nothing in the short
    form."""
    if SHORT:
        return
    path = ANIMATIONS / f"{name}.gif"
    ANIMATIONS.mkdir(parents=True, exist_ok=True)
    run.animate(path, **more)
    with Image.open(path) as film:
        pause = film.info["duration"]
        small = [
            frame.convert("RGB").resize((400, 400 * film.height // film.width))
            for frame in ImageSequence.Iterator(film)
        ]
    colours = small[0].quantize(16, dither=Image.Dither.NONE)
    frames = [frame.quantize(16, palette=colours, dither=Image.Dither.NONE) for frame in small]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=pause, loop=0, optimize=True)
    _written.append(path)


def scraper(block: Any, variables: dict[str, Any], settings: dict[str, Any]) -> str:
    """Animations that a block of a script wrote, as images of its page; sphinx-gallery calls this."""
    from sphinx_gallery.scrapers import figure_rst

    places = []
    while _written:
        place = Path(next(variables["image_path_iterator"])).with_suffix(".gif")
        shutil.copy(_written.pop(0), place)
        places.append(place)
    return figure_rst(places, settings["src_dir"]) if places else ""
