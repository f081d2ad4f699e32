"""Frames per second of the playback of pages in a headless Chromium.

A page of `trajectory.html` plays in the browser. ``requestAnimationFrame`` counts the frames that the browser draws within some
seconds. The browser draws by software (SwiftShader), so a graphics card can only be faster.

    pip install playwright viser
    python benchmarks/playback.py [--seconds 5] [--size 420x320]
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import codegen
from codegen.measure.models import sized

EXAMPLES = Path(__file__).parents[1] / "examples"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
NO_GRAPHICS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")

COUNTED = """(seconds) => new Promise(done => {
    let frames = 0
    const begin = performance.now()
    const next = now => {
        ++frames
        if (now - begin < 1000*seconds) requestAnimationFrame(next)
        else done(1000*frames/(now - begin))
    }
    requestAnimationFrame(next)
})"""
"""Frames per second, by the browser's own calls before each frame."""


def solver_of(name: str, loops: int, folder: Path) -> Any:
    """A shipped model, or a ladder with a number of loops."""
    model = sized(name.upper(), loops).model if loops else codegen.load_model(EXAMPLES / f"{name}.yaml")
    codegen.generate(model, folder / name, functions=("motion", "frames", "energies"), frames=True, check=False)
    return codegen.load(folder / name)


def measured(page: Any, trajectory: Any, path: Path, seconds: float) -> tuple[float, float]:
    """Frames per second of a page that plays, and its size in bytes."""
    trajectory.html(path)
    page.goto(f"file://{path}")
    page.wait_for_selector("canvas")
    page.wait_for_timeout(4000)
    return page.evaluate(COUNTED, seconds), path.stat().st_size


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--size", default="420x320")
    given = parser.parse_args()
    from playwright.sync_api import sync_playwright

    width, height = map(int, given.size.split("x"))
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        folder = Path(scratch)
        browser = playwright.chromium.launch(executable_path=found, args=list(NO_GRAPHICS))
        page = browser.new_page(viewport={"width": width, "height": height})
        for name, loops in (("quadruped", 0), ("ladder", 100)):
            solver = solver_of(name, loops, folder)
            run = solver.simulate(np.linspace(0.0, 1.0, 61))
            rate, size = measured(page, run, folder / f"{name}.html", given.seconds)
            print(f"{name} {loops or ''}: {rate:.1f} frames per second at {given.size}, page of {size / 1e6:.2f} MB")
        browser.close()


if __name__ == "__main__":
    main()
