"""Writes ``NAME_calls.c``: the functions of the header, each with one signature, as the run time calls them from Python."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...version import __version__
from ..templates import render
from . import FLOAT64, C
from .libraries import LIBRARIES, few_of, guard_of_library, number_of
from .vectors import words

ARGUMENTS = ("q", "u", "p", "inputs", "udot", "b")
SEEDS = ("dq", "du", "dp", "dinputs", "dudot", "db", "dt", "dqdot", "denergy", "doutputs", "dfull_q", "dfull_u")
"""Arguments and seeds, `t` apart, in the order of their pointers; `codegen.runtime.standalone.calls.functions` has the same."""

INTERNAL = ("closure", "conditions", "newton_step")
"""What these return may be infinite and is looked at elsewhere."""

_WITH_DEFAULT = ("p", "inputs")


def write_calls(manifest: Mapping[str, Any], sizes: Mapping[str, int]) -> str:
    """The C of the calls.

    Parameters
    ----------
    manifest : dict
        See `codegen.manifest.manifest`.
    sizes : dict of str to int
        Numbers of entries of arguments and results.
    """
    name, scalar = manifest["name"], C.scalar(manifest.get("scalar", FLOAT64.name))
    functions = manifest["functions"].items()
    along = [_along(name, n, f, sizes, scalar.word) for n, f in functions if f.get("seeds")]
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
            "quaternions": manifest["quaternions"],
            "unfit_parts": ["c/calls_quaternions.c.jinja"] if manifest["quaternions"] else [],
            "lane_parts": ["c/calls_lanes.c.jinja"] if along else [],
            "values": [_value(name, n, f, sizes, scalar.word) for n, f in functions if not f.get("seeds")],
            "along": along,
            "point_parts": ["c/calls_points.c.jinja"] if points else [],
            "points": points,
            "acceleration_parts": ["c/calls_point_accelerations.c.jinja"] if accelerated else [],
            "accelerated": accelerated,
            "bodies": len(manifest.get("bodies", ())),
            "model_points": len(manifest.get("points", ())),
            "few": _few([symbol for f in along for symbol in f["few"]]),
        },
    )


def _given(f: Mapping[str, Any]) -> list[str]:
    return [a if a == "t" or a in _WITH_DEFAULT else f"x[{a.upper()}]" for a in f["arguments"]]


def _defaults(f: Mapping[str, Any], real: str) -> list[str]:
    """Lines that choose between what is given and the default."""
    names = [(a, a.upper()) for a in f["arguments"] if a in _WITH_DEFAULT]
    return [f"const {real} *const {a} = given >> {slot} & 1 ? x[{slot}] : x[DEFAULT_{slot}];" for a, slot in names]


def _value(model: str, name: str, f: Mapping[str, Any], sizes: Mapping[str, int], real: str) -> dict[str, Any]:
    results = [f"x[RESULTS + {i}]" for i in range(len(f["results"]))]
    finite = [f"all_finite({r}, {sizes[n]}L)" for r, n in zip(results, f["results"], strict=True)]
    if name == "jacobians":  # some may not be asked for
        finite = [finite[0], *(f"(!{r} || {line})" for r, line in zip(results[1:], finite[1:], strict=True))]
    call = f"{model}_{name}({', '.join([*_given(f), *results, 'x[WORK]'])})"
    return {
        "name": name,
        "given": _defaults(f, real),
        "call": call,
        "finite": [] if name in INTERNAL else finite,
        "guard": guard_of_library(name),
    }


def _points(model: str, functions: Mapping[str, Any], real: str) -> list[dict[str, Any]]:
    """The functions over points of bodies that `Solver.points` calls, of a package with the frames of these; lines compute the
    places of the model's points, where these depend on parameters."""
    found = []
    for name, frames, places, given, parts in (
        ("points", "frames", "point_places", "given & 1L << P", 1),
        ("point_sensitivities", "frame_sensitivities", "point_place_sensitivities", "given & (1L << P | 1L << DP)", 2),
    ):
        if frames not in functions:
            continue
        lines = [
            f"{real} *y[RESULTS + m];",
            "memcpy(y, x, RESULTS*sizeof *y);",
            "for (int i = 0; i < m; ++i) y[RESULTS + i] = x[RESULTS + m + i];",
            f"if (!status) status = {model}_call_{places}(y, {given}, t, k);",
        ]  # fmt: skip
        guard = guard_of_library(frames)
        known = lines if places in functions else []
        found.append({"name": name, "frames": frames, "guard": guard, "parts": parts, "places": known})
    return found


def _accelerated(functions: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The same with accelerations."""
    of = (
        ("point_accelerations", "points", "frames", "frame_accelerations", 1),
        ("point_acceleration_sensitivities", "point_sensitivities", "frame_sensitivities", "frame_acceleration_sensitivities", 2),
    )  # fmt: skip
    return [
        {"name": name, "points": points, "frames": accelerations, "guard": guard_of_library(frames), "parts": parts}
        for name, points, frames, accelerations, parts in of
        if frames in functions and accelerations in functions
    ]


FIRST = f"ORDERNM_LIBRARY == {number_of(LIBRARIES[0])}"
"""That the first library is compiled."""


def _few(symbols: list[str]) -> list[str]:
    """Lines for functions over few directions, which are in another library than those that call them."""
    if not symbols:
        return []
    return [
        f"#if {FIRST}",
        "/* Over few directions they are in another library, which is opened when FEW_LACK is returned. x[FEW] points to whether",
        " * they cannot be had, when as many directions as may be are computed instead, and behind that to them. */",
        *(f"#define {symbol} ((__typeof__({symbol}) *)few[{i}])" for i, symbol in enumerate(symbols, 1)),
        "#endif",
        "",
    ]


def _along(model: str, name: str, f: Mapping[str, Any], sizes: Mapping[str, int], real: str) -> dict[str, Any]:
    """A function over directions: seeds and derivatives lie in lanes one after the other."""
    at = 0
    seeds, derived, finite, passed = [], [], [], []
    for seed in f["seeds"]:
        seeds.append((seed.upper(), at))
        passed.append(f"lanes + width*{at}L")
        at += sizes[seed[1:]]
    for i, result in enumerate(f["results"]):
        place = f"x[RESULTS + {i}]"
        if result.startswith("d"):
            n = sizes[result[1:]]
            derived.append((i, at, n))
            passed.append(f"lanes + width*{at}L")
            finite.append(f"all_finite({place}, k*{n}L)")
            at += n
        else:
            passed.append(place)
            finite.append(f"all_finite({place}, {sizes[result]}L)")
    widths = sorted(f["widths"])
    # without directions there are values still, by the function that is there at first
    width = "".join(f"rest {'== 1' if w == 1 else f'&& rest <= {w}'} ? {w} : " for w in widths[:-1]) + str(widths[-1])
    few = [f"{model}_{name}_{w}" for w in few_of(name, widths)]
    given = ", ".join([*_given(f), *passed, "x[WORK]"])
    return {
        "name": name, "given": _defaults(f, real), "seeds": seeds, "derived": derived, "finite": finite, "width": width,
        "calls": [(w, f"{model}_{name}_{w}({given})") for w in widths], "guard": guard_of_library(name),
        "few": few,
        "asks": [
            f"#if {FIRST}",
            "        void *const *const few = (void *const *)x[FEW];",
            f"        if (few[0]) width = {widths[-1]};",
            f"        else if (width < {widths[-1]} && !few[1]) return FEW_LACK;",
            "#endif",
        ] if few else [],
    }  # fmt: skip


__all__ = ["write_calls"]
