"""Results that are not finite, told with what made them so: the force, force element, body or output."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from .arguments import some
from .arrays import Array, Shape, all_finite, of_state
from .functions import Function
from .numpy_target import NumpyTarget
from .targets import Opened
from .warning import warn

QUIET = ("closure", "conditions", "newton_step")
"""What these return may be infinite; who calls them looks at it."""


def tell_infinite(
    opened: Opened,
    f: Function,
    results: Sequence[Array],
    arrays: Mapping[str, Any],
    batch: Shape,
    seeds: Mapping[str, Array],
    k: int,
) -> None:
    """Warn of results that are not finite, with what made them so; `seeds` are k directions, if there are any."""
    if f.name in QUIET:
        return
    for name, x, derived in zip(f.results, results, f.derived, strict=True):
        if x is None or all_finite(x):
            continue
        state = np.argwhere(~np.isfinite(x))[0][derived : derived + len(batch)]
        at = tuple(int(i) for i in state)
        alone = {
            n: of_state(a, batch, at, 0) if n != "t" else float(np.broadcast_to(a, batch)[at])
            for n, a in arrays.items()
        }
        along = {s: of_state(a, batch, at, 1) for s, a in seeds.items()}
        reason = ""
        if "outputs" in (name, name[1:]):
            bad = sorted({int(i) for i in np.argwhere(~np.isfinite(x))[:, -1]})
            reason = f": {some([opened.package['output_names'][i] for i in bad])}"
        elif {"q", "u"} <= set(arrays):
            reason = _inquire(opened, f.name, alone, along, k)
        where = f" in state {list(at)} of the batch" if batch else ""
        warn(f"{opened.package['name']}: {name} of {f.name} is not finite{where}{reason}")
        return


def _inquire(opened: Opened, name: str, arrays: Mapping[str, Any], seeds: Mapping[str, Array], k: int) -> str:
    """What makes the results of one state infinite: the NumPy module does the forward dynamics again, sweep by sweep."""
    module = NumpyTarget(opened.folder, opened.manifest).module
    if not {"accelerations", "sensitivities"} <= opened.functions.keys():
        return ""  # of what is not there nothing can be done again
    given = {n: arrays[n] for n in opened.functions["accelerations"].arguments}
    for s, n in opened.functions["sensitivities"].seeds.items() if seeds else ():
        given[s] = seeds[s] if s in seeds else np.zeros((k, n))
        given[s] = given[s][..., 0] if s == "dt" else given[s]
    with np.errstate(all="ignore"), contextlib.suppress(Exception):
        a = module.Call(**given)
        module.start(a)
        return _first_infinite(opened.package, module, a, moved=not name.startswith("energ"), along=bool(seeds))
    return ""


def _first_infinite(package: Mapping[str, Any], module: Any, a: Any, moved: bool, along: bool) -> str:
    """The first force, force element or body whose numbers are not finite, in words."""
    links, speeds = package["links"], package["speed_names"]

    def bad(values: Any) -> list[int]:
        return [i for i, x in enumerate(values) if not np.isfinite(x).all()]

    def force(i: int, what: str) -> str:
        joint = speeds[i].partition(".")[0]
        lines = [line.strip() for line in package.get("description", ())]
        told = [line for line in lines if line.startswith("force ") and f"on joint {joint}:" in line]
        return f": {what} on joint {joint} is not ({'; '.join(told) or speeds[i]})"

    def element(array: str, i: int, what: str) -> str:
        ends = np.cumsum(package["element_coefficients"][array])
        k = int(np.searchsorted(ends, i, side="right"))
        return f": {what} of {package['element_types'][k]} {package['elements'][k]} are not"

    if hasattr(module, "joint_forces"):
        module.joint_forces(a)
    for i in bad(getattr(a, "tau", ())) if moved else ():
        return force(i, "the force")
    if hasattr(module, "applied_forces"):
        module.applied_forces(a)
    for array in ("coefficient", "drive"):
        for i in bad(getattr(a, array, ())):
            return element(array, i, "the coefficients")
    records = a.records[: len(links)]
    for i in bad([_sum_of_sizes(x for n, x in r.items() if n.startswith("external_")) for r in records]):
        return f": the force of force elements on body {links[i].partition('.')[0]} is too large for floating-point numbers"
    module.kinematics(a)
    for i in bad([_sum_of_sizes(r.values()) for r in records]):
        return f": the motion of body {links[i].partition('.')[0]} is too large for floating-point numbers"
    module.forward(a)
    for i in bad(a.udot):
        return f": the acceleration of joint {speeds[i].partition('.')[0]} is too large for floating-point numbers"
    if along and hasattr(module, "joint_forces_tangents"):
        module.joint_forces_tangents(a)
        for i in bad(getattr(a, "dtau", ())):
            return force(i, "the derivative of the force")
    if along and hasattr(module, "applied_force_tangents"):
        with contextlib.suppress(Exception):
            module.applied_force_tangents(a)
        for array in ("coefficient", "drive"):
            for i in bad(getattr(a, f"d{array}", ())):
                return element(array, i, "the derivatives of the coefficients")
    return ""


def _sum_of_sizes(numbers: Iterable[Any]) -> float:
    return float(sum(np.sum(np.abs(x)) for x in numbers))
