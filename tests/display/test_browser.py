"""Views and pages in a browser: they load without errors, equal their reference pictures, move, and react to their sliders."""

import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

import ordernm

pytestmark = pytest.mark.campaign

EXAMPLES = Path(__file__).parents[2] / "examples"
MODELS = ("four_bar", "slider_crank", "double_wishbone", "stewart")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
REFERENCES = Path(__file__).parent / "references"
"""Screenshots of the initial states, written by ``ORDERNM_UPDATE_GOLDEN=1``; each was looked at."""

SMALL, TOLERANCE = 12, 0.3
"""Differences of grey levels, 0 to 255, that count as none, and the largest mean difference of a view and its reference."""

ONLY_THE_SCENE = "body * { visibility: hidden } canvas { visibility: visible !important }"
NO_GRAPHICS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")


@pytest.fixture(scope="module")
def page():
    api = pytest.importorskip("playwright.sync_api", reason="drives a browser: pip install playwright")
    pytest.importorskip("viser", reason="serves views: pip install viser")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip("no Chromium on the PATH; install one")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=list(NO_GRAPHICS))
        page = browser.new_page(viewport={"width": 420, "height": 320})
        page.set_default_timeout(180_000)
        yield page
        browser.close()


@pytest.fixture(scope="module")
def solvers(tmp_path_factory):
    made = {}
    for name in MODELS:
        folder = tmp_path_factory.mktemp("shown") / name
        ordernm.generate(str(EXAMPLES / f"{name}.yaml"), folder, frames=True, check=False)
        made[name] = ordernm.load(folder)
    return made


def picture(page) -> np.ndarray:
    from io import BytesIO

    from PIL import Image

    return np.asarray(Image.open(BytesIO(page.screenshot(timeout=180_000))).convert("RGB"), dtype=float)


def opened(page, url):
    """Open a page; returns the list of its errors, to which later errors are added."""
    errors = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.goto(url)
    page.wait_for_selector("canvas")
    time.sleep(3.0)
    return errors


@pytest.mark.parametrize("name", MODELS)
def test_a_page_plays_without_a_server(page, solvers, name, tmp_path):
    solvers[name].simulate(2.0).html(tmp_path / "run.html")
    errors = opened(page, f"file://{tmp_path / 'run.html'}")
    before = picture(page)
    time.sleep(0.7)
    assert np.abs(picture(page) - before).max() > 30, "nothing moves"
    assert before.std() > 5, "nothing is shown"
    ticks = page.evaluate("new Promise(r => { let n = 0; setInterval(() => ++n, 1); setTimeout(() => r(n), 1000) })")
    assert ticks <= 31, "the page asks for frames more often than the poses change"
    assert errors == []


@pytest.mark.parametrize("name", MODELS)
def test_a_slider_moves_the_mechanism(page, solvers, name):
    view = solvers[name].view()
    try:
        errors = opened(page, view.url)
        before, q = picture(page), view.poses.position.copy()
        box = page.locator("input[type=text], input[type=number]").first
        box.fill(str(float(box.input_value()) + 0.1))
        box.press("Enter")
        page.wait_for_timeout(3000)
        assert np.abs(view.poses.position - q).max() > 1e-4, "the slider changed nothing"
        assert np.abs(picture(page) - before).max() > 30, "nothing moves"
        assert errors == []
    finally:
        view.close()


def settled(page) -> np.ndarray:
    """Grey levels of the scene at half the size, once it no longer changes."""
    before, end = picture(page), time.monotonic() + 120
    while time.monotonic() < end:
        time.sleep(2.0)
        now = picture(page)
        if now.std() > 5 and np.array_equal(now, before):
            break
        before = now
    return before.mean(axis=2).reshape(before.shape[0] // 2, 2, before.shape[1] // 2, 2).mean(axis=(1, 3))


def difference(seen, name) -> float:
    from PIL import Image

    reference = np.asarray(Image.open(REFERENCES / f"{name}.png").convert("L"), dtype=float)
    apart = np.abs(seen - reference)
    return float(np.where(apart > SMALL, apart, 0.0).mean())


@pytest.mark.parametrize("name", MODELS)
def test_a_view_looks_like_its_reference_and_another_pose_does_not(page, solvers, name):
    from PIL import Image

    solver = solvers[name]
    view = solver.view()
    try:
        opened(page, view.url)
        page.add_style_tag(content=ONLY_THE_SCENE)
        seen = settled(page)
        if os.environ.get("ORDERNM_UPDATE_GOLDEN"):
            REFERENCES.mkdir(exist_ok=True)
            image = Image.fromarray(seen.round().astype(np.uint8)).quantize(64)
            image.save(REFERENCES / f"{name}.png", optimize=True)
        assert (REFERENCES / f"{name}.png").stat().st_size < 20_000
        right = difference(seen, name)
        assert right < TOLERANCE
        q, u = solver.initial
        q = q.copy()
        free = solver.coordinate_names.index(solver.independent_names[0])
        q[free] += 0.2 if solver._manifest["coordinate_units"][free] == "rad" else 0.1
        q, u = solver.assemble(q, u)
        inputs = np.zeros(solver.ninputs)
        view.move(solver._views._poses(q[None], u[None], np.array(solver.parameters), inputs, np.zeros(1)))
        wrong = difference(settled(page), name)
        print(f"{name}: {right:.2f} at its pose, {wrong:.2f} at another")
        assert wrong > 2 * TOLERANCE
    finally:
        view.close()
