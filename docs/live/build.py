"""Builds a page that computes motions in the browser: generated C as WebAssembly, drawn with three.js.

``python docs/live/build.py MODEL.yaml -o page.html`` writes the page of your model. Without a model it writes that of the
documentation. It needs ziglang (``pip install ziglang``), and three.js and esbuild (``npm install --prefix docs``).
"""

from __future__ import annotations

import argparse
import base64
import gzip
import importlib.util
import json
import math
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

import codegen
from codegen.mechanics.procedures.choice import UnknownFunctionError
from codegen.runtime.standalone.calls.functions import Function, functions_of, shapes_of

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
CACHE = ROOT / "build" / "live"
ESBUILD = HERE.parent / "node_modules" / ".bin" / "esbuild"

FUNCTIONS = ("accelerations", "sensitivities", "simulate", "frames")
"""Functions of the generated package; ``simulate`` is a group, with outputs and with all that closes loops."""

CALLED = ("accelerations", "sensitivities", "closure", "outputs", "output_sensitivities", "frames")
"""Functions that JavaScript may call, if the model has them."""

WIDE = 8
"""Number of directions of functions along seeds."""

FLAGS = ("-target", "wasm32-wasi", "-mexec-model=reactor", "-O3", "-msimd128", "-Wno-unused-function")

NOT_ON_PAGES = {
    "initial_at_rest": "its initial state is an equilibrium, which Python computes",
    "branching_motion": "its prescribed motion may have kinks, at which Python ends a motion",
}
"""Entries of the manifest of models whose motions need Python, with the reason."""

MOST_SLIDERS = 8


class PageError(Exception):
    """A page cannot be built: a missing tool, or a model or option that it does not support."""


# -- WebAssembly -------------------------------------------------------------------------------------------------------


def missing_tools() -> str:
    """Names the tools that are missing, and their installation; empty if none is."""
    missing = []
    if importlib.util.find_spec("ziglang") is None:
        missing.append("a compiler for WebAssembly (pip install ziglang)")
    if not ESBUILD.exists():
        missing.append("three.js and esbuild (npm install --prefix docs)")
    return " and ".join(missing)


def interface(manifest: Mapping[str, Any]) -> tuple[str, dict[str, int]]:
    """The text of live_model.h, and the sizes of its arrays ``at_NAME``.

    Parameters
    ----------
    manifest : mapping
        Content of the package's model.json.
    """
    name, shapes = manifest["name"], shapes_of(manifest)
    functions = functions_of(manifest, shapes)
    called = [functions[f] for f in CALLED if f in functions]
    sizes = {array: math.prod(shapes[array]) for array in ("q", "u", "p", "inputs", "t")}
    for f in called:
        sizes.update({s: n * WIDE for s, n in f.seeds.items()})
        results = zip(f.results, f.shapes, f.derived, strict=True)
        sizes.update({r: math.prod(shape) * (WIDE if along else 1) for r, shape, along in results})
    numbers = {
        "NQ": sizes["q"], "NU": sizes["u"], "NP": sizes["p"], "NINPUTS": sizes["inputs"], "NSIGNALS": len(_signals(manifest)),
        "NCLOSURE": math.prod(shapes["position"]), "NLOOPS": math.prod(shapes["condition"]),
        "NFRAMES": sizes["frames"], "MOST": sizes["p"] + len(_signals(manifest)),
    }  # fmt: skip
    first = manifest["initial"]
    initial = {"default_p": manifest["parameters"], "initial_q": first["q"], "initial_u": first["u"]}
    lines = [
        f"/* {name} for live.c. */",
        f'#include "../{name}/{name}.h"',
        f'#include "../{name}/motion/motion.h"',
        f"extern const ordernm_system {name}_system;",
        f"#define LIVE_SYSTEM {name}_system",
        f"enum {{ {', '.join(f'LIVE_{key} = {n}' for key, n in numbers.items())} }};",
        *(f"static const double live_{key}[] = {{{', '.join(map(repr, [*x, 0.0]))}}};" for key, x in initial.items()),
        *(f"double at_{array}[{n} + 1];" for array, n in sizes.items()),
        f"double at_work[{name.upper()}_WORKSPACE];",
        *(f"int run_{f.name}(void) {{ return {_call(name, f)}; }}" for f in called),
    ]
    if "initial" in functions:
        f = functions["initial"]
        lines.append(f"#define LIVE_INITIAL(c, q, u) {_initial(name, f)}")
        f = functions["initial_sensitivities"]
        lines.append(f"#define LIVE_INITIAL_ALONG(c, q, u, dq, du) {_initial(name, f)}")
    return "\n".join(lines) + "\n", sizes


def _call(name: str, f: Function) -> str:
    """A call of a generated function with the arrays of the page."""
    given = ["at_t[0]" if a == "t" else f"at_{a}" for a in f.arguments]
    return f"{_name(name, f)}({', '.join([*given, *(f'at_{a}' for a in (*f.seeds, *f.results)), 'at_work'])})"


def _initial(name: str, f: Function) -> str:
    """A call of the function that evaluates the initial values, or their derivatives, for an ``ordernm_call``."""
    given = ["(c)->p", *(f"(c)->{s}" for s in f.seeds), *("q", "u", "dq", "du")[: len(f.results)]]
    return f"{_name(name, f)}({', '.join([*given, 'at_work'])})"


def _name(name: str, f: Function) -> str:
    return f"{name}_{f.name}_{WIDE}" if f.seeds else f"{name}_{f.name}"


def compiled(package: Path, manifest: Mapping[str, Any]) -> tuple[bytes, dict[str, int]]:
    """The WebAssembly module of a generated package, and the sizes of its arrays.

    Raises
    ------
    PageError
        If the model's motions need Python, or the compiler fails.
    """
    for key, reason in NOT_ON_PAGES.items():
        if key in manifest:
            raise PageError(f"{manifest['name']}: {reason}; a page cannot show this model")
    name, folder = manifest["name"], package.parent
    text, sizes = interface(manifest)
    shim = folder / f"{name}_live"
    shim.mkdir(exist_ok=True)
    (shim / "live_model.h").write_text(text)
    shutil.copy(HERE / "live.c", shim)
    shutil.copytree(package / "motion", folder / "motion", dirs_exist_ok=True)  # in one place: zig compiles it once
    symbol = re.compile(r"^(?:int|double)\s\*?((?:run|at|along|live)_\w+)", re.MULTILINE)
    sources = [f"{name}_live/live.c", f"{name}/{name}.c", f"{name}/{name}_motion.c"]
    sources += sorted(f"motion/{f.name}" for f in (package / "motion").glob("*.c"))
    exported = symbol.findall(text + (HERE / "live.c").read_text())
    link = [*(f"-Wl,--export={name}" for name in exported), "-Wl,--strip-all"]
    command = [sys.executable, "-m", "ziglang", "cc", *FLAGS, *link, *sources, "-o", f"{name}_live/live.wasm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PageError(f"{name}: the compiler for WebAssembly failed:\n{done.stderr.strip()}")
    return (shim / "live.wasm").read_bytes(), sizes


# -- the content of a page ---------------------------------------------------------------------------------------------


def content(wanted: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The data of one model for the page: names, sliders, display and the module.

    Parameters
    ----------
    wanted : mapping
        An entry of models.yaml: ``model``, a path from the repository, and choices.
    folder : path
        Where the package is generated.

    Raises
    ------
    PageError, ModelError
    """
    file = Path(wanted["model"])
    model = codegen.load_model(file if file.is_absolute() else ROOT / file)
    outputs = [x.name for x in model.outputs]
    if not outputs:
        raise PageError(f"{model.name} has no outputs, and a page plots one; add an entry to its section outputs")
    output = wanted.get("output", outputs[0])
    if output not in outputs:
        raise PageError(f"{model.name} has no output {output!r}; its outputs: {', '.join(outputs)}")
    sliders = list(_sliders(model, wanted))
    package = folder / model.name
    folder.mkdir(parents=True, exist_ok=True)
    try:
        codegen.generate(model, package, functions=FUNCTIONS, frames=True, compile=False)
    except UnknownFunctionError as error:
        raise PageError(f"{model.name} has no motion to compute: {error}") from error
    manifest = json.loads((package / "model.json").read_text())
    module, sizes = compiled(package, manifest)
    kept = (
        "name", "parameter_names", "parameters", "coordinate_names", "speed_names", "output_names", "output_units", "bodies",
        "display",
    )  # fmt: skip
    return {
        **{key: manifest[key] for key in kept},
        "title": wanted.get("title", model.name), "text": wanted.get("text", ""), "time": wanted.get("time", 5.0),
        "camera": wanted.get("camera", [0.4, -1.0, 0.3]), "output": manifest["output_names"].index(output),
        "sliders": sliders, "signals": len(_signals(manifest)), "sizes": sizes,
        "module": base64.b64encode(gzip.compress(module, 9, mtime=0)).decode(),
    }  # fmt: skip


def _signals(manifest: Mapping[str, Any]) -> list[str]:
    """Names of the inputs without rates and accelerations of prescribed motion."""
    names: list[str] = manifest["input_names"]
    return names[: len(names) - 2 * len(manifest.get("moving_inputs", ()))]


def _sliders(model: Any, wanted: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Sliders for parameters and inputs: place, unit, value and range."""
    parameters, signals = {p.name: p for p in model.parameters}, model.signals
    known = [*parameters, *signals]
    if not known:
        raise PageError(f"{model.name} has no parameters and no inputs, so a page would have no sliders")
    for name in wanted.get("sliders", known[:MOST_SLIDERS]):
        if name in parameters:
            p = parameters[name]
            spread = 0.5 * abs(p.value) or 1.0
            low = p.value - spread if p.min is None else max(p.min, p.value - spread)
            high = p.value + spread if p.max is None else min(p.max, p.value + spread)
            place = {"of": "p", "at": list(parameters).index(name), "unit": p.unit, "value": p.value}
        elif name in signals:
            value = wanted.get("inputs", {}).get(name, 0.0)
            low, high = value - 1.0, value + 1.0
            place = {"of": "inputs", "at": signals.index(name), "unit": "", "value": value}
        else:
            raise PageError(f"{model.name} has no parameter or input {name!r}; it has {', '.join(known)}")
        low, high = wanted.get("ranges", {}).get(name, (low, high))
        yield {"name": name, **place, "min": low, "max": high}


def script() -> str:
    """The page's script with three.js, in one file."""
    options = ("--bundle", "--minify", "--format=esm", "--log-level=warning")
    done = subprocess.run([ESBUILD, "page.js", *options], cwd=HERE, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PageError(f"esbuild failed:\n{done.stderr.strip()}")
    return done.stdout


def page(models: Sequence[Mapping[str, Any]], folder: Path = CACHE) -> str:
    """The text of a page with one model or several; it needs no other file and no network.

    Raises
    ------
    PageError, ModelError
    """
    missing = missing_tools()
    if missing:
        raise PageError(f"a page that computes needs {missing}")
    data = json.dumps([content(m, folder) for m in models], separators=(",", ":")).replace("</", "<\\/")
    text = (HERE / "page.html").read_text()
    return text.replace("/*SCRIPT*/", script().replace("</script", "<\\/script")).replace("/*MODELS*/", data)


def documentation_page() -> str:
    """The documentation's page."""
    return page(yaml.safe_load((HERE / "models.yaml").read_text()))


def main() -> int:
    parser = argparse.ArgumentParser(description="Write a page that computes the motions of a model in the browser.")
    parser.add_argument("model", nargs="?", help="model file (default: those of the documentation)")
    parser.add_argument("-o", "--out", default="live.html", help="the page (default: live.html)")
    parser.add_argument("-t", "--time", type=float, default=5.0, help="duration of the motion, s (default: 5)")
    parser.add_argument("--output", help="the output that is plotted first (default: the first one)")
    parser.add_argument("--sliders", help=f"parameters and inputs, with commas (default: the first {MOST_SLIDERS})")
    options = parser.parse_args()
    wanted: dict[str, Any] = {"model": str(Path(options.model or "").resolve()), "time": options.time}
    if options.output:
        wanted["output"] = options.output
    if options.sliders:
        wanted["sliders"] = [name.strip() for name in options.sliders.split(",")]
    if not 0.0 < options.time < 1000.0:
        parser.error(f"--time is {options.time:g}; more than 0 s and less than 1000 s are allowed")
    try:
        text = page([wanted]) if options.model else documentation_page()
        Path(options.out).write_text(text)
    except (PageError, codegen.ModelError, OSError) as error:
        print(f"build.py: {error}", file=sys.stderr)
        return 1
    print(f"wrote {options.out}, {len(text) / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
