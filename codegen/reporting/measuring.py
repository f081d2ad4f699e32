"""Contents of a report, and the order of measurements."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..generation import generate
from ..measure.core import FIXED_WORK, Core, Turn
from ..measure.machine import machine
from ..measure.operations import point
from ..model import Model, load_model
from ..runtime import load
from ..runtime.standalone.files.build import Build, build_apart, builds, first_build
from ..runtime.standalone.files.manifest import read_manifest
from ..terminal import with_status
from ..version import __version__
from . import differences, errors, generated, motions, pages, processes
from .skipped import Skipped
from .states import State, states

if TYPE_CHECKING:
    from ..runtime import Solver

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Request:
    """The extent of the measurements of a report.

    Attributes
    ----------
    end : float
        Final time of the motions, s.
    timing : float
        Approximate seconds for timing each function.
    reference : float
        Approximate CPU seconds for the reference in extended precision.
    """

    end: float = motions.END
    timing: float = 0.1
    reference: float = 6.0


@with_status()
def report(
    model: Model | str | Path, folder: str | Path = "report", *, request: Request | None = None,
    progress: Progress = lambda stage, done, of: None, force: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Measure a model and write a report of its cost and accuracy.

    The folder gets ``index.html``, ``report.md``, ``report.json`` and ``figures/``.

    Parameters
    ----------
    model : Model or path
        The model, or its file.
    folder : path, optional
        The folder of the report. An earlier report in it is replaced; other files are refused.
    request : Request, optional
        What to measure. Default: everything, with a motion of 5 s.
    progress : callable, optional
        Called as ``progress(stage, done, of)``.
    force : bool, optional
        Also replace files of these names that no report wrote. Others in the folder stay.

    Returns
    -------
    dict
        The contents of ``report.json``.

    Raises
    ------
    ModelError
        If the model is wrong.
    FolderError
        If the folder cannot be written, or holds other files.
    CompileError
        If the compiler fails.
    NoCompilerError
        If there is no C compiler.
    ImportError
        If matplotlib is not installed (extra ``plot``).

    Examples
    --------
    >>> import ordernm
    >>> found = ordernm.report("examples/pendulum.yaml", "report")  # doctest: +SKIP
    """
    pages.need()
    target = Path(folder)
    pages.refuse_foreign(target, force)
    reading = time.perf_counter()
    if not isinstance(model, Model):
        progress("reading", 0, 0)
        model = load_model(model)
    reading = time.perf_counter() - reading
    data = measure(model, request or Request(), progress)
    data["generated"]["seconds"]["read"] = reading
    progress("drawing", 0, 0)
    pages.write(data, target, force)
    return data


def measure(model: Model, request: Request, progress: Progress) -> dict[str, Any]:
    """All contents of a report, as numbers and text for JSON."""
    skipped: list[Skipped] = []
    begin, cpu = time.perf_counter(), _cpu_seconds()
    with tempfile.TemporaryDirectory() as scratch:
        made = generate(model, Path(scratch) / model.name, compile=False, check=False, progress=progress)
        progress("compiling", 0, 0)
        made.seconds["compile all functions"] = _compile(
            made.folder, "states", *(["four"] if len(motions.sensitivities(model)) > 1 else [])
        )
        solver = load(made.folder)
        core = Core.compiled(Path(scratch))
        data: dict[str, Any] = {
            "model": model.name,
            "ordernm": __version__,
            "date": time.strftime("%Y-%m-%d"),
            "machine": machine(),
            "generated": generated.generated(model, made, solver),
        }
        apart = build_apart(made.folder, model.name, "precise")
        with ThreadPoolExecutor(1) as meanwhile:
            # a motion with loops may need the code in long double; it is compiled here, because one core is idle
            precise = meanwhile.submit(apart.library) if model.loops and apart.exists() else None
            found = _at_states(model, solver, request, data, skipped, progress)
        if precise:
            precise.result()
        progress("integrating", 0, 0)
        packages = [made.folder]

        def remade(partitions: int) -> Solver:
            folder = Path(scratch) / f"{model.name}_{partitions}"
            packages.append(folder)
            generate(model, folder, compile=False, check=False, progress=progress, partitions=partitions)
            for library in Path(scratch).glob("*/*.so"):  # packages with fewer partitions use the same libraries
                if library.parent != folder:
                    shutil.copy(library, folder)
            _compile(folder, "precise")
            return load(folder)

        data["motions"] = motions.motions(model, solver, request.end, skipped, remade, core)
        progress("timing", 0, 0)
        data |= _times(core, solver, packages, found, data["motions"], request, progress)
    data["skipped"] = [{"what": s.what, "why": s.why, "seconds": s.seconds, "text": str(s)} for s in skipped]
    data["seconds"] = time.perf_counter() - begin
    data["cpu_seconds"] = _cpu_seconds() - cpu
    return data


def _at_states(
    model: Model, solver: Solver, request: Request, data: dict[str, Any], skipped: list[Skipped], progress: Progress
) -> State | None:
    """Adds ``states``, ``errors`` and ``differences`` to a report, and returns the first state."""
    progress("drawing states", 0, 0)
    found = states(model, solver, lambda s: _condition(solver, s))
    if not found:
        why = "no random state close to the initial one closes the loops and has finite accelerations"
        skipped.append(Skipped("times and errors", why))
        return None
    data["states"] = [_state(solver, s) for s in found]
    progress("comparing with the reference in extended precision", 0, 0)
    data["errors"], exact = errors.errors(model, solver, found, request.reference, skipped)
    progress("finite differences", 0, 0)
    data["differences"] = differences.differences(model, solver, found[0], exact, skipped)
    return found[0]


def _times(
    core: Core, solver: Solver, packages: Sequence[Path], state: State | None, moved: dict[str, Any] | None, request: Request,
    progress: Progress,
) -> dict[str, Any]:  # fmt: skip
    """Return ``times`` and ``roofline`` if there is a state; write the times of motions into the points in `moved`.

    Parameters
    ----------
    packages : sequence of Path
        The first is used for functions, the last for motions.
    moved : dict, optional
        See `motions.motions`.
    """
    points = motions.settings(moved) if moved else []
    taken = [(setting, Turn(p["seconds"], p["core"], p["cache"])) for p, setting in points]
    functions, records, peaks = processes.timed(
        core, packages[0], state, request.timing, packages[-1], taken,
        lambda done, of: progress("timing", done, of),
    )  # fmt: skip
    for (entry, _), x in zip(points, records, strict=True):
        entry |= {"seconds": x["least"], "seconds_high": x["high"], "core": x["core"], "cache": x["cache"]}
    if not functions:
        return {}
    return {
        "times": functions,
        "roofline": {
            "peaks": {name: 1 / x["least"] for name, x in peaks.items()},
            "peaks_low": {name: 1 / x["high"] for name, x in peaks.items()},
            **{work: {name: x[work] for name, x in peaks.items()} for work in FIXED_WORK},
            "points": _points(solver, functions["functions"]),
        },
    }


def _points(solver: Solver, times: dict[str, Any]) -> list[dict[str, Any]]:
    """Points of a roofline for udot and sensitivities, from their least times in C."""
    of = (
        ("udot", "accelerations", 0),
        ("udot + 1 direction", "sensitivities", 1),
        ("udot + 8 directions", "sensitivities", 8),
    )
    return [point(solver, name, function, k, times[name]["compiled"]["least"]) for name, function, k in of]


def _compile(folder: Path, *apart: str) -> float:
    """Compile all partitions of a package, in parallel with separately compiled files; return the seconds of the first partition.

    The first partition has all functions in one library: a report calls nearly all functions, and these share most of
    the code. The other partitions are used only for motions.
    """
    manifest = read_manifest(folder)
    parts = [manifest, *manifest.get("others", [])]
    wanted = [builds(folder, manifest)[""]]
    # separately compiled files come early, since each is long and has one compile unit
    wanted += [build_apart(folder, part["name"], name) for part in parts for name in apart]
    wanted += [first_build(folder, other, further=True) for other in parts[1:]]

    def seconds(build: Build) -> float:
        begin = time.perf_counter()
        build.library()
        return time.perf_counter() - begin

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        first, *_ = pool.map(seconds, [build for build in wanted if build.exists()])
        return first


def _cpu_seconds() -> float:
    """CPU seconds of this process and of its compilers that have ended."""
    x = os.times()
    return x.user + x.system + x.children_user + x.children_system


def _condition(solver: Solver, state: State) -> float:
    """Worst condition of the closures, or condition of the mass matrix of a tree."""
    if solver.nu > motions.LARGEST_MATRIX:
        return 1.0
    found = solver.diagnose(state.q, state.u, None, state.inputs, state.t, derivatives=False)
    if solver.closure_names:
        return max((c.condition for c in found.closures), default=1.0)
    return found.mass.condition if found.mass is not None else 1.0


def _state(solver: Solver, state: State) -> dict[str, Any]:
    return {"name": state.name, "q": state.q.tolist(), "u": state.u.tolist(), "inputs": state.inputs.tolist(), "t": state.t,
            "condition": _condition(solver, state)}  # fmt: skip
