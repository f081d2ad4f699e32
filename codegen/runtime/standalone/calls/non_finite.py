"""Warnings about results that are not finite, with the cause: a force, force element, body or output."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np

from ..arrays import Array, all_finite
from ..warning import warn
from .arguments import some
from .functions import STATE, Function
from .numpy_target import NumpyTarget
from .targets import Opened
from .task import Task

QUIET = ("closure", "conditions", "newton_step")
"""Functions whose results may be infinite without a warning; their callers test the results."""


def warn_of_infinite(opened: Opened, task: Task) -> None:
    """Warns of results that are not finite, with the cause."""
    f, batch = task.f, task.batch
    if f.name in QUIET:
        return
    weights = task.seeds.of.get("doutputs")
    weighted = (
        [] if weights is None else np.flatnonzero(np.any(weights != 0.0, axis=tuple(range(weights.ndim - 1)))).tolist()
    )
    for name, x, derived in zip(f.results, task.out, f.derived, strict=True):
        if x is None or all_finite(x) or (name == "outputs" and weights is not None and all_finite(x[..., weighted])):
            continue
        bad = np.argwhere(~np.isfinite(x.astype(float)))
        at = tuple(int(i) for i in bad[0][derived : derived + len(batch)])
        alone = {n: np.asarray(a, float)[()] for n, a in task.at(at).items()}
        along = bool(f.seeds) or f.name == "jacobians"
        reason = ""
        if "outputs" in (name, name[1:]):
            reason = outputs_without(opened, alone, sorted({int(i) for i in bad[:, -1]}), along=derived)
        elif weights is not None:
            reason = outputs_without(opened, alone, weighted, along=True)
        elif {"q", "u"} <= set(alone):
            reason = culprit(opened, alone, along, moved=not f.name.startswith("energ"))
        where = f" in state {list(at)} of the batch" if batch else ""
        name = name.removeprefix("dg") if f.name.endswith("hessian_products") else name
        warn(f"{opened.package['name']}: {name} of {f.name} is not finite{where}{reason and f': {reason}'}")
        return


def variables(package: Mapping[str, Any]) -> list[str]:
    """Names of all variables of differentiation, in the order of `units`."""
    names = [f"{x}.{n}" for x, key in (("q", "coordinate_names"), ("u", "speed_names")) for n in package[key]]
    return [*names, *package["parameter_names"], *package["input_names"], "t"]


def units(f: Function, package: Mapping[str, Any]) -> dict[str, Array]:
    """Seeds of a function: one unit direction for each of `variables`."""
    counts = [len(package[f"{n}_names"]) for n in ("coordinate", "speed", "parameter", "input")]
    every, start, found = np.eye(sum(counts) + 1), 0, {}
    for n, count in zip(STATE, (*counts, 1), strict=True):
        if f"d{n}" in f.seeds:
            found[f"d{n}"] = every[:, start] if n == "t" else every[:, start : start + count]
        start += count
    return found


def outputs_without(
    opened: Opened, arrays: Mapping[str, Any], among: Collection[int], along: bool, certain: bool = False
) -> str:
    """Names the outputs whose value or derivative is not finite in one state, and the variables of these derivatives;
    empty if all outputs are finite and `certain` is set."""
    package = opened.package
    names = package["output_names"]
    f = opened.functions.get("output_sensitivities")
    if f is None or not along:
        return some([names[i] for i in among])
    module = NumpyTarget(opened.folder, opened.manifest).module
    given = {n: arrays[n] for n in f.arguments}
    with np.errstate(all="ignore"):
        values, derivatives = module.output_sensitivities(*given.values(), *units(f, package).values())
    if without := [names[i] for i in among if not np.isfinite(values[..., i]).all()]:
        return f"the value of {some(without)}"
    of = variables(package)
    found = []
    for i in among:
        by = [of[j] for j in np.flatnonzero(~np.isfinite(derivatives[:, i]))]
        found += [f"the derivative of {names[i]} with respect to {some(by)}"] if by else []
    if found or certain:
        return some(found) if found else ""
    return some([names[i] for i in among])


def culprit(opened: Opened, arrays: Mapping[str, Any], along: bool, moved: bool = True, elements: bool = True) -> str:
    """The cause of infinite results in one state, found by repeating the forward dynamics in NumPy, sweep by sweep.

    Parameters
    ----------
    arrays : mapping
        q, u, p, inputs and t, without batch axes.
    along : bool
        Whether derivatives are requested as well.
    moved : bool
        Whether joint forces affect the results.
    elements : bool
        Whether to test force elements and the resulting motion as well.

    Returns
    -------
    str
        Empty if everything is finite.
    """
    names = ("sensitivities", "state_rate_sensitivities") if along else ("accelerations", "state_rates")
    f = next((opened.functions[n] for n in names if n in opened.functions), None)
    if f is None:
        return ""  # a package of selected functions may lack the dynamics
    call = Call(opened, f, arrays)
    return _first_infinite(opened.package, call, moved, elements) or (
        _first_infinite_along(opened.package, call.a) if along else ""
    )


class Call:
    """Runs a function of the NumPy module in one state, along all directions if it has seeds.

    Attributes
    ----------
    a : Any
        The call object of the module's function, with all intermediate results.
    moved_wrongly : list of int
        Links with motions that are not finite.
    """

    def __init__(self, opened: Opened, f: Function, arrays: Mapping[str, Any]):
        module = NumpyTarget(opened.folder, opened.manifest).module
        self.a: Any = None
        self.moved_wrongly: list[int] = []
        make, links = module.Call, len(opened.package["links"])
        move = getattr(module, "kinematics", lambda a: None)

        def kept(**given: Any) -> Any:
            self.a = make(**given)
            return self.a

        def watched(a: Any) -> None:
            move(a)
            self.moved_wrongly = _bad([_sum_of_sizes(r.values()) for r in a.records[:links]])

        module.Call, module.kinematics = kept, watched
        module.check_pivot = lambda *given: None  # zero pivots are irrelevant here
        given = {n: arrays[n] for n in f.arguments} | (units(f, opened.package) if f.seeds else {})
        with np.errstate(all="ignore"):
            getattr(module, f.name)(*given.values())


def _first_infinite(package: Mapping[str, Any], call: Call, moved: bool, elements: bool) -> str:
    """Names the first force, force element or body with numbers that are not finite."""
    links, speeds, a = package["links"], package["speed_names"], call.a
    for i in _bad(getattr(a, "prescribed", ())):
        name = package["prescribed_names"][i // 3]
        written = [
            line.strip() for line in package.get("description", ()) if line.strip().startswith(f"motion {name} =")
        ]
        quantity, said = ("position", "speed", "acceleration")[i % 3], "; ".join(written) or name
        return f"the prescribed {quantity} of {name} is not finite ({said})"
    for i in _bad(getattr(a, "tau", ())) if moved else ():
        return f"the force on joint {speeds[i].partition('.')[0]} is not finite ({_force_on(package, speeds[i])})"
    for array in ("coefficient", "drive"):
        for i in _bad(getattr(a, array, ())):
            return f"the coefficients of {_element(package, array, i)} are not finite"
    if not elements:
        return ""
    external = [[x for n, x in r.items() if n.startswith("external_")] for r in a.records[: len(links)]]
    for i in _bad(list(map(_sum_of_sizes, external))):
        return f"the force of {_elements_on(package, i)} is not finite"
    for i in call.moved_wrongly:
        return f"the motion of body {links[i].partition('.')[0]} is too large for floating-point numbers"
    for i in _bad(a.udot):
        return f"the acceleration of joint {speeds[i].partition('.')[0]} is too large for floating-point numbers"
    return ""


def _first_infinite_along(package: Mapping[str, Any], a: Any) -> str:
    """Names the first force or force element with derivatives that are not finite, and the variables."""
    speeds, of = package["speed_names"], variables(package)

    def by(values: Iterable[Any]) -> str:
        bad = {int(j) for x in values for j in np.argwhere(~np.isfinite(np.atleast_1d(x)))[:, 0]}
        return some([of[j] for j in sorted(bad)])

    for i in _bad(getattr(a, "dtau", ())):
        joint = speeds[i].partition(".")[0]
        force = _force_on(package, speeds[i])
        return f"the derivative of the force on joint {joint} with respect to {by([a.dtau[i]])} is not finite ({force})"
    for array in ("coefficient", "drive"):
        tangents = getattr(a, f"d{array}", ())
        for i in _bad(tangents):
            of_element = f"the derivatives of the coefficients of {_element(package, array, i)}"
            return f"{of_element} with respect to {by([tangents[i]])} are not finite"
    for i in range(len(package["links"])):
        external = [x for m in (a.slots[i], a.lanes[i]) for n, x in m.items() if n.startswith("external_")]
        if _bad(external):
            return f"the derivative of the force of {_elements_on(package, i)} with respect to {by(external)} is not finite"
    return ""


def _bad(values: Any) -> list[int]:
    return [i for i, x in enumerate(values) if not np.isfinite(x).all()]


def _forces(package: Mapping[str, Any]) -> list[str]:
    """The descriptions of the model's forces and force elements."""
    types = zip(package.get("element_types", ()), package.get("elements", ()), strict=True)
    starts = ("force ", *(f"{type_} {name}:" for type_, name in types))
    return [line.strip() for line in package.get("description", ()) if line.strip().startswith(starts)]


def _force_on(package: Mapping[str, Any], speed: str) -> str:
    joint = speed.partition(".")[0]
    return "; ".join(line for line in _forces(package) if f"on joint {joint}:" in line) or speed


def _element(package: Mapping[str, Any], array: str, i: int) -> str:
    """The force element to which a coefficient belongs."""
    ends = np.cumsum(package["element_coefficients"][array])
    k = int(np.searchsorted(ends, i, side="right"))
    return f"{package['element_types'][k]} {package['elements'][k]}"


def _elements_on(package: Mapping[str, Any], link: int) -> str:
    """The force elements whose descriptions contain the body of a link."""
    body = package["links"][link].partition(".")[0]
    naming = [
        line for line in _forces(package) if re.search(rf"\b{re.escape(body)}\b", line) and "on joint" not in line
    ]
    return f"force elements on body {body} ({'; '.join(naming)})" if naming else f"force elements on body {body}"


def _sum_of_sizes(numbers: Iterable[Any]) -> float:
    return float(sum(np.sum(np.abs(x)) for x in numbers))
