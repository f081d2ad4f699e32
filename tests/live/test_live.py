"""The page that computes in the browser: its numbers against native code, its size, and its behaviour."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
import time
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import codegen
from codegen.runtime.standalone.display.scene import scene_of

ROOT = Path(__file__).parents[2]
LIVE = ROOT / "docs" / "live"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
NO_GRAPHICS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")
LARGEST_PAGE = 1.5e6
FRAME = 16.0
"""Bytes of a page, and milliseconds of a motion of the four-bar with its gradient."""

spec = importlib.util.spec_from_file_location("live_build", LIVE / "build.py")
assert spec and spec.loader
build = importlib.util.module_from_spec(spec)
spec.loader.exec_module(build)

WANTED = {Path(m["model"]).stem: m for m in yaml.safe_load((LIVE / "models.yaml").read_text())}
models = pytest.mark.parametrize("name", WANTED)


@pytest.fixture(scope="module")
def content():
    """The data of a model on the page, by its name."""
    if missing := build.missing_tools():
        pytest.skip(f"needs {missing}")
    made: dict[str, Any] = {}

    def of(name: str) -> dict[str, Any]:
        if name not in made:
            made[name] = build.content(WANTED[name], build.CACHE)
        return made[name]

    return of


def in_node(model: dict[str, Any], **jobs: Any) -> dict[str, Any]:
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs Node.js 20 or later: https://nodejs.org")
    job = json.dumps({"live": str(LIVE), "model": model, **jobs})
    script = str(Path(__file__).with_name("evaluate.mjs"))
    done = subprocess.run([node, "--no-warnings", script], input=job, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def designs(model: dict[str, Any], n: int, seed: int) -> list[tuple[list[float], list[float]]]:
    """Random values of the sliders, as parameters and inputs; the first design is the default one."""
    rng, found = np.random.default_rng(seed), []
    for k in range(n):
        p, inputs = list(model["parameters"]), [0.0] * model["signals"]
        for s in model["sliders"]:
            end = s["min"] if rng.random() < 0.5 else s["max"]
            value = s["value"] + (0.3 * rng.random() * (end - s["value"]) if k else 0.0)
            (p if s["of"] == "p" else inputs)[s["at"]] = value
        found.append((p, inputs))
    return found


def error(found: Any, expected: Any) -> float:
    """The largest difference, relative to the largest number or 1."""
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    assert found.shape == expected.shape and np.isfinite(expected).all()
    return float(np.abs(found - expected).max(initial=0.0) / max(1.0, np.abs(expected).max(initial=0.0)))


@pytest.mark.campaign  # compiles for WebAssembly
@models
def test_functions_equal_the_native_ones(name, content):
    """Values and derivatives along eight random directions, at random closed states of random designs: to 1e-13."""
    model, solver = content(name), codegen.load(build.CACHE / name)
    rng = np.random.default_rng(1)
    calls, expected = [], []
    for p, inputs in designs(model, 12, 2):
        q, u = solver.initial_state(p)
        for names, x in ((solver.independent_names, q), (solver.independent_speed_names, u)):
            known = solver.coordinate_names if x is q else solver.speed_names
            x[[known.index(n) for n in names]] += 0.05 * rng.uniform(-1.0, 1.0, len(names))
        state = (*solver.assemble(q, u, p, inputs), np.array(p), np.array(inputs))
        along = [rng.normal(size=(8, len(x))) for x in state]
        seeds = dict(zip(("dq", "du", "dp", "dinputs"), along, strict=True))
        given = {n: x.tolist() for n, x in zip(("q", "u", "p", "inputs"), state, strict=True)}
        given |= {n: x.T.ravel().tolist() for n, x in seeds.items() if n in model["sizes"]}
        frames = solver.frames(*state)
        pieces = (frames.rotation.reshape(-1, 9), frames.position, frames.angular_velocity, frames.velocity)
        results = {
            "accelerations": {"udot": solver.accelerations(*state)},
            "sensitivities": dict(zip(("udot", "dudot"), solver.sensitivities(*state, **seeds), strict=True)),
            "outputs": {"outputs": solver.outputs(*state)},
            "output_sensitivities": dict(
                zip(("outputs", "doutputs"), solver.output_sensitivities(*state, **seeds), strict=True)
            ),
            "frames": {"frames": np.concatenate(pieces, axis=1)},
        }
        if solver.closure_names:
            results["closure"] = dict(zip(("position", "velocity"), solver.closure(*state), strict=True))
        for function, arrays in results.items():
            calls.append({"name": function, "given": given, "wanted": list(arrays)})
            expected.append(arrays)
    worst = 0.0
    for found, arrays in zip(in_node(model, calls=calls)["calls"], expected, strict=True):
        assert found["status"] == 0
        for array, numbers in arrays.items():
            worst = max(worst, error(found[array], (numbers.T if array in ("dudot", "doutputs") else numbers).ravel()))
    assert worst <= 1e-13


@pytest.mark.campaign
@models
@pytest.mark.parametrize("step", [1e-3, 0.0])
def test_motions_equal_those_of_the_solver(name, step, content):
    """Outputs and derivatives of motions from the closed initial states of random designs.

    To 1e-13 with constant steps. Adaptive steps follow rounding errors, so motions agree to their tolerance, 1e-9 in a step.
    """
    model, solver = content(name), codegen.load(build.CACHE / name)
    end, count = (0.2, 20) if step else (model["time"], 60)
    names = [f"inputs.{s['name']}" if s["of"] == "inputs" else s["name"] for s in model["sliders"]]
    given = [
        {"p": p, "inputs": inputs, "time": end, "count": count, "along": model["sliders"], "step": step}
        for p, inputs in designs(model, 4, 3)
    ]
    method = {"method": "rk4", "step": step} if step else {}
    allowed, allowed_along = (1e-13, 1e-13) if step else (1e-7, 1e-6)
    for job, found in zip(given, in_node(model, motions=given)["motions"], strict=True):
        times = [end * i / count for i in range(count)] + [end]
        native = solver.simulate(times, p=job["p"], inputs=job["inputs"] or None, sensitivities=names, **method)
        assert found["rows"] == count + 1 and found["end"] == ""
        assert error(found["q"], native.q) <= allowed
        assert error(found["outputs"], native.outputs) <= allowed
        assert error(found["doutputs"], native.doutputs) <= allowed_along
        assert np.abs(native.doutputs).max() > 0.0


@pytest.mark.campaign
def test_designs_that_do_not_close_have_a_message(content):
    """A crank longer than the other bars can reach: no motion, and the next design has one."""
    model = content("four_bar")
    p, _ = designs(model, 1, 0)[0]
    motion = {"inputs": [0.0], "time": 0.1, "count": 2, "along": []}
    found = in_node(model, motions=[{**motion, "p": [5.0, *p[1:]]}, {**motion, "p": p}])["motions"]
    assert found[0] == {"error": "the loops do not close in this design"} and found[1]["rows"] == 3


@models
def test_scenes_are_those_of_the_package(name):
    """Solids, lines and points at random parameters, in JavaScript and in Python."""
    from codegen.display import display

    model = codegen.load_model(ROOT / WANTED[name]["model"])
    manifest = {
        "display": json.loads(json.dumps(display(model))), "parameter_names": [p.name for p in model.parameters],
        "bodies": [b.name for b in model.bodies],
    }  # fmt: skip
    rng = np.random.default_rng(5)
    p = np.array([x.value for x in model.parameters]) * rng.uniform(0.9, 1.1, len(model.parameters))
    found, expected = in_node(manifest, scenes=[p.tolist()])["scenes"][0], scene_of(manifest, p)
    assert [(s["body"], s["type"], s["color"]) for s in found["solids"]] == [
        (s.body, s.type, s.color) for s in expected.solids
    ]
    for js, py in zip(found["solids"], expected.solids, strict=True):
        assert max(error(js[key], getattr(py, key)) for key in ("sizes", "rotation", "at")) <= 1e-15
    for kind in ("sticks", "rails", "elements"):
        assert [tuple(x["bodies"]) for x in found[kind]] == [x.bodies for x in expected.lines(kind)]
        assert error([x["ends"] for x in found[kind]], [x.ends for x in expected.lines(kind)]) <= 1e-15
    for kind in ("joints", "loops", "points"):
        assert [x["body"] for x in found[kind]] == [x.body for x in expected.marks(kind)]
        assert error([x["at"] for x in found[kind]], [x.at for x in expected.marks(kind)]) <= 1e-15


@pytest.mark.parametrize(("change", "message"), [
    ({"output": "height"}, "four_bar has no output 'height'; its outputs: trace_x, trace_z, swing"),
    ({"sliders": ["length"]}, "four_bar has no parameter or input 'length'; it has crank_length, coupler_length"),
])  # fmt: skip
def test_pages_that_cannot_be_are_refused(change, message, tmp_path):
    with pytest.raises(build.PageError, match=message):
        build.content({**WANTED["four_bar"], **change}, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_model_without_outputs_has_no_page(tmp_path):
    file = tmp_path / "bare.yaml"
    body = "{parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {yy: 1}}"
    file.write_text(f"model: bare\nparameters: {{k: 1}}\nbodies:\n  arm: {body}\n")
    with pytest.raises(build.PageError, match="bare has no outputs, and a page plots one"):
        build.content({"model": str(file)}, tmp_path)


@pytest.mark.campaign
def test_initial_values_may_depend_on_parameters(tmp_path):
    """A four-bar whose crank starts by its length, and a free body that turns: the motion of the solver, to 1e-13."""
    if missing := build.missing_tools():
        pytest.skip(f"needs {missing}")
    text = (ROOT / "examples" / "four_bar.yaml").read_text()
    stone = "  stone: {parent: ground, joint: {type: free}, shape: {type: box, size: [0.1, 0.2, 0.3], mass: base}}\n"
    text = text.replace("bodies:\n", f"bodies:\n{stone}").replace("model: four_bar", "model: started")
    text = text.replace("crank: 0.8", "crank: 2*crank_length").replace(
        "{crank: 3.0}", "{crank: 3*base, stone: [1, 2, base, 0, 0, 1]}"
    )
    file = tmp_path / "started.yaml"
    file.write_text(text + "  height: {position: stone, axis: z}\n")
    model = build.content({"model": str(file), "time": 0.2}, tmp_path / "made")
    solver = codegen.load(tmp_path / "made" / "started")
    names = [f"inputs.{s['name']}" if s["of"] == "inputs" else s["name"] for s in model["sliders"]]
    p = [1.1 * x for x in model["parameters"]]
    job = {"p": p, "inputs": [0.5], "time": 0.2, "count": 10, "along": model["sliders"], "step": 1e-3}
    (found,) = in_node(model, motions=[job])["motions"]
    times = [0.2 * i / 10 for i in range(10)] + [0.2]
    native = solver.simulate(times, p=p, inputs=[0.5], sensitivities=names, method="rk4", step=1e-3)
    assert error(found["q"], native.q) <= 1e-13 and error(found["outputs"], native.outputs) <= 1e-13
    assert error(found["doutputs"], native.doutputs) <= 1e-13
    assert np.abs(native.dq[names.index("crank_length"), 0]).max() >= 2.0  # the initial state moves with the parameter


@pytest.mark.campaign
def test_the_command_writes_a_page_of_one_model(tmp_path):
    if missing := build.missing_tools():
        pytest.skip(f"needs {missing}")
    command, out = [sys.executable, str(LIVE / "build.py")], tmp_path / "page.html"
    done = subprocess.run(
        [*command, "examples/satellite.yaml", "-o", out, "-t", "2"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert out.stat().st_size < LARGEST_PAGE
    done = subprocess.run([*command, tmp_path / "no.yaml"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "no.yaml" in done.stderr and "Traceback" not in done.stderr


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The documentation's page in a browser, with lists of its errors and requests."""
    api = pytest.importorskip("playwright.sync_api", reason="drives a browser: pip install playwright")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip("no Chromium on the PATH; install one")
    if missing := build.missing_tools():
        pytest.skip(f"needs {missing}")
    file = tmp_path_factory.mktemp("page") / "page.html"
    file.write_text(build.documentation_page())
    assert file.stat().st_size < LARGEST_PAGE
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=list(NO_GRAPHICS))
        page = browser.new_page(viewport={"width": 1000, "height": 680})
        page.set_default_timeout(180_000)
        page.errors, page.requests, page.file = [], [], file
        page.on("pageerror", lambda e: page.errors.append(str(e)))
        page.on("console", lambda m: page.errors.append(m.text) if m.type in ("error", "warning") else None)
        page.on("request", lambda r: page.requests.append(r.url))
        yield page
        browser.close()


def picture(page) -> np.ndarray:
    from PIL import Image

    shot = page.locator("#stage").screenshot(timeout=180_000)
    return np.asarray(Image.open(BytesIO(shot)).convert("RGB"), dtype=float)


@pytest.mark.campaign
@models
def test_in_a_browser_a_slider_changes_the_motion_and_its_gradient(name, page):
    page.goto("about:blank")  # a change of the hash alone would not load the page anew
    page.goto(f"{page.file.as_uri()}#{name}")
    page.wait_for_function(f"window.live?.motion && live.solver.model.name === '{name}'")
    time.sleep(1.0)
    first = picture(page)
    page.wait_for_function("t => Math.abs(live.time - t) > 0.3", arg=page.evaluate("live.time"))
    assert np.abs(picture(page) - first).max() > 50.0  # it moves
    page.click("#play")
    still = "live.time = live.solver.model.time / 2"
    page.evaluate(still)
    time.sleep(0.5)
    before = picture(page)
    state = (
        "[...[100, 200].map((n) => live.motion.output(n, live.output)), live.motion.derivative(200, live.output, 1)]"
    )
    numbers = page.evaluate(state)
    slider = page.locator(".slider input").nth(1)
    place = slider.bounding_box()
    page.mouse.move(place["x"] + 0.5 * place["width"], place["y"] + place["height"] / 2)
    page.mouse.down()
    times = []
    for part in np.linspace(0.5, 0.75, 12):
        page.mouse.move(place["x"] + part * place["width"], place["y"] + place["height"] / 2)
        page.wait_for_function("!live.changed")
        times.append(page.evaluate("live.milliseconds"))
    page.mouse.up()
    page.evaluate(still)
    time.sleep(0.5)
    assert page.evaluate("live.active") == 1
    assert (
        page.evaluate("live.values[1]")
        == float(slider.input_value())
        != page.evaluate("live.solver.model.sliders[1].value")
    )
    changed = np.array(page.evaluate(state)) - numbers
    assert np.isfinite(changed).all() and (changed != 0.0).all()
    assert np.abs(picture(page) - before).max() > 50.0
    assert "ms" in page.text_content("#cost") and page.text_content("#note") == ""
    assert page.errors == [] and set(map(str, page.requests)) <= {page.file.as_uri(), f"{page.file.as_uri()}#{name}"}
    if name == "four_bar":
        assert min(times) < FRAME  # the machine may be busy with other work
    page.evaluate("document.getElementById('reset').click()")
    page.wait_for_function("live.values[1] === live.solver.model.sliders[1].value && live.motion")
