"""Writes ``NAME_calls.c``: the functions of the header, all with the same signature, for calls from Python."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from typing import Any

from ...version import __version__
from ..function import called_with
from ..templates import render
from . import FLOAT64, C
from .libraries import LIBRARIES, few_of, guard_of_library, number_of
from .vectors import words

ARGUMENTS = (
    "q", "u", "p", "inputs", "udot", "b", "force_weights", "energy_weights", "output_weights", "rate_weights", "q_weights",
    "u_weights",
)  # fmt: skip
SEEDS = ("dq", "du", "dp", "dinputs", "dudot", "db", "dt", "dqdot", "denergy", "doutputs", "dfull_q", "dfull_u")
"""Arguments and seeds, except `t`, in the order of their pointers; `codegen.runtime.standalone.calls.functions` has the same
list."""

INTERNAL = ("closure", "conditions", "newton_step")
"""Functions whose results may be infinite or NaN, so that the caller checks them."""

_WITH_DEFAULT = ("p", "inputs")
"""Arguments with default values, which callers may omit."""


def write_calls(manifest: Mapping[str, Any], sizes: Mapping[str, int]) -> str:
    """The C text of ``NAME_calls.c``."""
    name, scalar = manifest["name"], C.scalar(manifest.get("scalar", FLOAT64.name))
    functions = [_function(name, n, f, sizes) for n, f in manifest["functions"].items()]
    functions.sort(key=lambda f: f["guard"])
    few = [symbol for f in functions for symbol in f["few"]]
    points = _points(name, manifest["functions"], scalar.word)
    accelerated = _accelerated(manifest["functions"])
    counted = ("coordinate_names", "speed_names", "parameter_names", "input_names", "output_names")
    return render(
        "c/calls.c.jinja",
        {
            **words(scalar),
            "name": name,
            "version": __version__,
            "slots": [n.upper() for n in (*ARGUMENTS, *SEEDS)],
            "first_seed": len(ARGUMENTS),
            "sizes": [*(sizes[n] for n in ARGUMENTS), *(sizes.get(s[1:], 0) for s in SEEDS)],
            "checked": [*(len(manifest[n]) for n in counted), manifest["workspace"]],
            "quaternion_lines": [f"#define QUATERNIONS {', '.join(map(str, q))}"]
            if (q := manifest["quaternions"])
            else [],
            "most_widths": 1 + max(len(f["widths"]) for f in functions),
            "most_seeds": 1 + max(len(f["seeds"]) for f in functions),
            "most_results": max(len(f["entries"]) for f in functions) or 1,
            "guarded": [(guard, [*of]) for guard, of in groupby(functions, lambda f: f["guard"])],
            "point_parts": ["c/calls_points.c.jinja"] if points else [],
            "points": points,
            "acceleration_parts": ["c/calls_point_accelerations.c.jinja"] if accelerated else [],
            "accelerated": accelerated,
            "bodies": len(manifest.get("bodies", ())),
            "model_points": len(manifest.get("points", ())),
            "few": few,
            "few_parts": ["c/calls_few.c.jinja"] if few else [],
            "first": f"ORDERNM_LIBRARY == {number_of(LIBRARIES[0])}",
        },
    )


def _function(model: str, name: str, f: Mapping[str, Any], sizes: Mapping[str, int]) -> dict[str, Any]:
    """The template data for the call of one header function. In the array of lanes, derivatives follow the seeds.
    ``entries`` lists the sizes of results, with a minus sign for derivatives."""
    at = 0
    passed = [f"c->{a}" if a == "t" or a in _WITH_DEFAULT else f"X({a.upper()})" for a in f["arguments"]]
    entries = []
    for seed in f.get("seeds", ()):
        passed.append(f"ALONG({at})")
        at += sizes[seed[1:]]
    for i, result in enumerate(f["results"]):
        if result.startswith("d") and f.get("seeds"):
            entries.append(-sizes[result[1:]])
            passed.append(f"ALONG({at})")
            at += sizes[result[1:]]
        else:
            entries.append(sizes[result])
            passed.append(f"X(RESULTS + {i})")
    widths = sorted(f["widths"]) if f.get("seeds") else []
    lines = []
    for w in widths[:-1]:
        lines += [f"if (c->width == {w})", *(f"    {line}" for line in _call(f"return {model}_{name}_{w}(", passed))]
    lines += _call(f"return {model}_{name}{f'_{widths[-1]}' if widths else ''}(", passed)
    return {
        "name": name, "lines": lines, "widths": widths, "seeds": [s.upper() for s in f.get("seeds", ())],
        "entries": [] if name in INTERNAL else entries, "guard": guard_of_library(name),
        "few": [f"{model}_{name}_{w}" for w in few_of(name, widths)],
    }  # fmt: skip


def _call(start: str, passed: list[str]) -> list[str]:
    return called_with(start, [*passed, "X(WORK)"], ");").split("\n")


def _points(model: str, functions: Mapping[str, Any], real: str) -> list[dict[str, Any]]:
    """The template data of the functions for points of bodies that `Solver.points` calls, if the package has frames. If
    positions of the model's points depend on parameters, these functions compute the positions too."""
    found = []
    for name, frames, places, given, parts in (
        ("points", "frames", "point_places", "given & 1L << P", 1),
        ("point_sensitivities", "frame_sensitivities", "point_place_sensitivities", "given & (1L << P | 1L << DP)", 2),
    ):
        if frames not in functions:
            continue
        lines = [
            f"{real} *y[RESULTS + m];",
            "long steps[RESULTS + m];",
            "take_part(x, y, steps, m, m);",
            f"if (!status) status = {model}_call_{places}(y, {given}, t, k);",
        ]  # fmt: skip
        guard = guard_of_library(frames)
        known = lines if places in functions else []
        found.append({"name": name, "frames": frames, "guard": guard, "parts": parts, "places": known})
    return found


def _accelerated(functions: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The C functions for points of bodies that also return accelerations."""
    of = (
        ("point_accelerations", "points", "frames", "frame_accelerations", 1),
        ("point_acceleration_sensitivities", "point_sensitivities", "frame_sensitivities", "frame_acceleration_sensitivities", 2),
    )  # fmt: skip
    return [
        {"name": name, "points": points, "frames": accelerations, "guard": guard_of_library(frames), "parts": parts}
        for name, points, frames, accelerations, parts in of
        if frames in functions and accelerations in functions
    ]


__all__ = ["write_calls"]
