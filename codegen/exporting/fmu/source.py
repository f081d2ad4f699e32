"""The C files of an FMU: the solver, the integrator, the functions of the standard, and a file with the model's contents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...emit.templates import render
from ...model.model import Model
from ...runtime.sections import motion_files
from ...runtime.standalone.motion.settings import METHODS
from ...runtime.standalone.motion.switches import switch_words
from ...version import __version__
from .events import indicators, scheduled
from .variables import Variable

LEFT_OUT = (
    "curvature.c",
    "explicit_curvature.c",
    "radau_curvature.c",
    "switches_curvature.c",
    "gradient_tangents.c",
    "backwards.c",
    "transposes.c",
    "explicit_backwards.c",
    "radau_backwards.c",
    "radau_transposed.c",
    "switches_backwards.c",
)
"""Files of the integrator for Hessians and adjoints of motions, which no function of the standard needs."""

OF_VERSION = {"3.0": "fmi3.c", "2.0": "fmi2.c"}


def sources(
    model: Model, manifest: Mapping[str, Any], files: Mapping[str, str], found: Sequence[Variable], *,
    version: str, method: str, rtol: float, initial: Mapping[str, Sequence[float]],
) -> dict[str, str]:  # fmt: skip
    """The texts of all files of the folder ``sources``, with `TOKEN` in place of the token."""
    name = model.name
    own = {
        file: files[file]
        for file in (f"{name}.c", f"{name}.h", f"{name}_directions.h", f"{name}_motion.c")
        if file in files
    }
    motion = {file: text for file, text in motion_files().items() if file.rpartition("/")[2] not in LEFT_OUT}
    here = Path(__file__).parent
    wanted = ("unit.c", "unit.h", "fmi.h", "unit_state.c", "unit_saved.c", "unit_derivatives.c", OF_VERSION[version])
    of_unit = {f"unit/{file}": (here / file).read_text(encoding="utf-8") for file in wanted}
    return own | motion | of_unit | {f"{name}_fmu.c": _contents(model, manifest, found, method, rtol, initial)}


def with_token(texts: Mapping[str, str], name: str, token: str) -> dict[str, str]:
    """The files with the token that identifies the FMU."""
    file = f"{name}_fmu.c"
    return {**texts, file: texts[file].replace(TOKEN, token)}


INITIAL = (
    "int {}_initial(const double *p, double *q, double *u, double *work);",
    "int {}_initial_sensitivities_1(const double *p, const double *dp, double *q, double *u, double *dq, double *du,",
    "    double *work);",
)  # fmt: skip
"""Declarations of the functions of initial values that are expressions of parameters."""

TOKEN = "TOKEN"
"""Placeholder for the token, which is a digest of all files."""


def _contents(
    model: Model, manifest: Mapping[str, Any], found: Sequence[Variable], method: str, rtol: float,
    initial: Mapping[str, Sequence[float]],
) -> str:  # fmt: skip
    singular = [
        *(f"link {x}" for x in manifest["links"]), *(f"loop {x}" for x in manifest["loops"]),
        *(f"force element {x}" for x in manifest.get("elements", ())),
    ]  # fmt: skip
    has_switches = bool(manifest.get("switches"))
    switches = [switch_words(manifest, k) for k in range(len(model.switches.found))] if has_switches else []
    of_state, of_time = indicators(model, manifest), scheduled(model, manifest)
    tables = [
        _numbers("initial_q", initial["q"]), _numbers("initial_u", initial["u"]),
        _numbers("parameters", [p.value for p in model.parameters]), _texts("variables", [x.name for x in found]),
        _texts("singular", singular), _texts("switches", switches),
        _numbers("indicators", of_state, "int"), _numbers("scheduled", of_time, "int"),
    ]  # fmt: skip
    computed = "initial" in manifest["functions"]
    members = {
        "token": f'"{TOKEN}"', "system": f"&{model.name}_system", "q": "initial_q", "u": "initial_u", "p": "parameters",
        "initial": f"{model.name}_initial" if computed else "0",
        "initial_along": f"{model.name}_initial_sensitivities_1" if computed else "0",
        "at_rest": str(int(model.initial_at_rest)), "variables": "variables", "singular": "singular",
        "switches": "switches", "indicators": "indicators", "nindicators": str(len(of_state)), "scheduled": "scheduled",
        "nscheduled": str(len(of_time)), "method": str(METHODS.index(method)),
        "moved": str(int("t" in manifest["functions"].get("closing_step", {"arguments": ()})["arguments"])), "rtol": repr(rtol),
    }  # fmt: skip
    context = {
        "name": model.name, "version": __version__, "tables": tables,
        "declarations": [line.format(model.name) for line in INITIAL * computed],
        "members": [f".{member} = {value}" for member, value in members.items()],
    }  # fmt: skip
    return render("export/fmu.c.jinja", context)


def _numbers(name: str, values: Sequence[float], kind: str = "scalar") -> list[str]:
    """A table of numbers; C has no empty ones."""
    listed = map(float if kind == "scalar" else int, values or [0])
    return [f"static const {kind} {name}[] = {{", *(f"    {x!r}," for x in listed), "};"]


def _texts(name: str, values: Sequence[str]) -> list[str]:
    """A table of texts, with a null pointer at its end."""
    return [f"static const char *const {name}[] = {{", *(f"    {_quoted(x)}," for x in values), "    0,", "};"]


def _quoted(text: str) -> str:
    """A text as a C string of ASCII characters."""
    plain = text.encode("ascii", "replace").decode()
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ").replace("?", "\\?") + '"'
