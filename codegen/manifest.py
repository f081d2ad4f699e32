"""The content of `model.json` for the run time: names, functions, operations."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from .display import display, numbers
from .emit.c.functions import batch_arrays
from .emit.c.libraries import FRAMES as FRAMES_LIBRARY
from .emit.c.libraries import libraries, library_of
from .jumps import switched
from .mechanics.expansion import Program
from .mechanics.outputs.outputs import pivoted_outputs
from .mechanics.structure.system import System
from .mechanics.sweeps import SWEEP, Sweep
from .model.checks import check_inertia
from .model.expressions import Expression
from .model.model import Model, closure_row_names
from .program.counting import counted
from .program.operations import Operations, count
from .program.plan import Plan
from .program.procedure import WIDTHS, Array, Formulas, Procedure, Run, Single, walk

OUTSIDE = "start"
"""Name of the stage of constants, sines and cosines, which is listed like a sweep."""


def operations(program: Program, plan: Plan, procedures: tuple[Procedure, ...]) -> dict[str, Any]:
    """Operations per call of every sweep and of the model's own formulas: once, and per direction.

    A sweep over directions that is run for values, such as ``solve_in_1``, has one direction in its operations per call. If C
    runs a sweep as one function, its operations are counted; NumPy's functions for single links have a few more.
    """
    result: dict[str, Any] = {}
    steps = [s for p in procedures for s in walk(p.steps)]
    single = {s.sweep for step in steps if isinstance(step, Single) for s in step.steps if isinstance(s, Run)}
    for sweep in SWEEP.values():
        if not program.blocks.get(sweep.name):
            continue
        merged = plan.sweeps[sweep.name].merged
        if merged is not None:
            once, each = count(merged.block)
        else:
            once, each = _of_kinds(program, sweep)
        result[sweep.name] = _both(once, each)
        if sweep.name in single:
            result[f"{sweep.name}_1"] = _both(once + each, Operations())
    for name, targets in dict.fromkeys((s.name, s.targets) for s in steps if isinstance(s, Formulas)):
        of_targets = [f for f in plan.formulas if f.target in targets]
        once, each = Operations(), Operations()
        for f in of_targets:
            once = once + count(f.value)[0] * len(f.rows)
            each = each + sum(count(f.tangent), Operations()) * len(f.rows)
        if of_targets:
            result[name] = _both(once, each)
    constants = Operations()
    for c in program.system.constants:
        constants = constants + count(c.shape.block)[0]
    angles = sum(link.joint.angle is not None for link in program.system.links)
    added = sum(link.turned != 0 for link in program.system.links)
    result[OUTSIDE] = _both(constants + Operations(additions=added, functions=2 * angles), Operations())
    return result


def _of_kinds(program: Program, sweep: Sweep) -> tuple[Operations, Operations]:
    """Numbers of operations in a sweep's blocks of all members: those done once, and those per direction."""
    once, each = Operations(), Operations()
    for kind in sweep.kinds(program.system):
        block = program.blocks[sweep.name][kind.index]
        calls = len(kind.members) if sweep.element else len(kind.units if sweep.units else kind.members)
        once, each = (sum_ + of * calls for sum_, of in zip((once, each), count(block), strict=True))
    return once, each


def _both(once: Operations, each: Operations) -> dict[str, dict[str, int]]:
    return {"per_call": dataclasses.asdict(once), "per_direction": dataclasses.asdict(each)}


def manifest(
    system: System,
    procedures: tuple[Procedure, ...],
    workspace: int,
    operations: Mapping[str, Any],
    assembled: tuple[float, ...] = (),
    divided: bool = False,
    scalar: str = "float64",
) -> dict[str, Any]:
    """The content of ``model.json`` for the run time; `divided`: some sweeps are split into parts, see `libraries`."""
    model = system.model
    functions = _functions(procedures, operations)
    independent_q, independent_u = system.independent
    q0, u0 = _initial(model)
    q_assembled = _of_free(system, assembled) or q0
    return {
        "name": model.name,
        "coordinate_names": list(model.coordinate_names),
        "speed_names": list(model.speed_names),
        "parameter_names": list(model.parameter_names),
        "parameters": [p.value for p in model.parameters],
        "coordinate_units": list(model.coordinate_units),
        "speed_units": list(model.speed_units),
        **_switches(model, procedures),
        "parameter_units": [p.unit for p in model.parameters],
        "input_names": list(model.inputs),
        **({"moving_inputs": list(model.moving_inputs)} if model.moving_inputs else {}),
        **_branching_motion(model),
        "output_names": [o.name for o in model.outputs],
        "output_units": list(model.output_units),
        "closure_names": list(model.closure_names),
        "independent_names": [model.coordinate_names[i] for i in independent_q],
        "independent_speed_names": [model.speed_names[i] for i in independent_u],
        "prescribed_names": list(model.prescribed_names),
        "initial": {"q": q_assembled, "u": u0},
        **_moved_initial(model, independent_q, q0, q_assembled),
        **({"initial_at_rest": True} if model.initial_at_rest else {}),
        "quaternions": [i for i, name in enumerate(model.coordinate_names) if name.endswith(".qw")],
        "links": [link.name for link in system.links],
        "loops": [loop.name for loop in model.loops],
        **_masses(model),
        **_couplings(model),
        **_elements(system),
        **_singular_outputs(system),
        **_bodies(model, functions),
        "joint_links": [_joint_link(system, k) for k in range(len(model.bodies))],
        **({"scalar": scalar} if scalar != "float64" else {}),
        "workspace": workspace,
        "widths": list(WIDTHS),
        "functions": functions,
        "libraries": libraries(functions, divided),
        "batch": list(itertools.chain.from_iterable(batch_arrays(p for p in procedures if not p.internal))),
        "operations": operations,
        **_closures(system),
        **_redundancy(system),
    }


def _initial(model: Model) -> tuple[list[float], list[float]]:
    """Initial values of all coordinates and speeds at the default parameters."""

    def value(given: Expression | None, otherwise: float) -> float:
        return otherwise if given is None else float(given.evaluate(model.defaults))

    q = [value(model.initial_q.get(n), float(n.endswith(".qw"))) for n in model.coordinate_names]
    return q, [value(model.initial_u.get(n), 0.0) for n in model.speed_names]


def _moved_initial(model: Model, independent: Sequence[int], q0: list[float], assembled: list[float]) -> dict[str, Any]:
    """The initial values of independent coordinates that the model specifies and assembly has changed, because the loops
    cannot be closed with them."""
    names = model.coordinate_names
    moved = {
        names[i]: q0[i]
        for i in independent
        if names[i] in model.initial_q
        and names[i][-3:] not in (".qw", ".qx", ".qy", ".qz")  # these may have been normalised
        and abs(assembled[i] - q0[i]) > 1e-9 * max(1.0, abs(q0[i]))
    }
    return {"moved_initial": moved} if moved and not model.initial_at_rest else {}


def _functions(procedures: tuple[Procedure, ...], operations: Mapping[str, Any]) -> dict[str, Any]:
    """Functions for users: arguments, results and sweeps; for functions along seeds also seeds and widths."""
    functions: dict[str, Any] = {}
    for f in procedures:
        if f.internal:
            continue
        sweeps = [s for s in counted(f, OUTSIDE) if s in operations]
        functions[f.name] = {"arguments": _names(f.arguments), "results": _names(f.results), "sweeps": sweeps}
        if f.member:
            functions[f.name]["member"] = f.member
        if f.widths:
            functions[f.name] |= {"seeds": _names(f.seeds), "widths": list(f.widths)}
    return functions


def _names(arrays: tuple[Array, ...]) -> list[str]:
    return [a.name for a in arrays]


def _switches(model: Model, procedures: tuple[Procedure, ...]) -> dict[str, Any]:
    """Descriptions of switches of forces and outputs, if the package integrates motions."""
    found = model.switches.found
    if not any(p.name == "switches" for p in procedures):
        return {}
    return {"switches": [{"changes": s.words, "places": s.places} for s in found]}


def _branching_motion(model: Model) -> dict[str, Any]:
    """Prescribed motion with branches, as expression trees: its velocity may jump with other values of the parameters."""
    moving = {"t", *model.inputs}
    found = [
        {"name": x.name, "names": sorted(x.value.names), "tree": x.value.tree}
        for x in model.prescribed
        if any(not Expression(s).names.isdisjoint(moving) for _, s in switched(x.value.tree))
    ]
    return {"branching_motion": found} if found else {}


def _masses(model: Model) -> dict[str, Any]:
    """Masses, inertias and armatures that depend on parameters, as expression trees: parameters may make them negative.

    Bodies with equal expressions have one entry. Inertias that are impossible at the default parameters, which the model
    tolerates, are left out. An entry is simple if the quantity is positive for positive parameters.
    """
    found: dict[tuple[Expression, ...], str] = {}
    default = model.defaults
    impossible = {
        i for i, path, _, _ in check_inertia(model.bodies, lambda e: float(e.evaluate(default))) if path == ("inertia",)
    }
    for i, body in enumerate(model.bodies):
        several: list[tuple[str, tuple[Expression, ...]]] = [(f"the mass of {body.name!r}", (body.mass,))]
        several += [(f"the armature of {body.name!r}", (e,)) for e in body.joint.armature]
        if i not in impossible:
            several.append((f"the smallest principal moment of {body.name!r}", body.inertia))
        for what, values in several:
            diagonal = all(e.is_number and e.value == 0 for e in values[3:])
            never = diagonal and all(_is_never_negative(e.tree, body.mass.tree, len(values) > 1) for e in values)
            if any(e.names for e in values) and not never:
                found.setdefault(values, what)
    entries = []
    for values, what in found.items():
        names = sorted(set().union(*(e.names for e in values)))
        simple = all(default[n] > 0 for n in names) and all(
            (e.is_number and e.value == 0) or (k < 3 and _is_positive(e.tree)) for k, e in enumerate(values)
        )
        entries.append({"what": what, "names": names, "simple": simple, "values": numbers(values)})
    return {"masses": entries} if entries else {}


def _is_never_negative(tree: Sequence[Any], mass: Sequence[Any], has_mass: bool) -> bool:
    """Whether an expression consists of squares, numbers from 0, and, with `has_mass`, the body's mass, whose sign is tested
    by itself."""
    kind, *of = tree
    match kind:
        case "number":
            return float(of[0]) >= 0
        case "*" if of[0] == of[1]:
            return True
        case "**" if of[1][0] == "number" and float(of[1][1]) % 2 == 0:
            return True
        case "+" | "*" | "/":
            return all(_is_never_negative(x, mass, has_mass) or (has_mass and x == mass) for x in of)
    return has_mass and tree == mass


def _is_positive(tree: Sequence[Any]) -> bool:
    """Whether an expression consists of sums, products and powers that are positive for positive values of all names."""
    kind, *of = tree
    match kind:
        case "name":
            return True
        case "number":
            return float(of[0]) > 0
        case "+" | "*" | "/":
            return all(map(_is_positive, of))
        case "**":
            return _is_positive(of[0])
    return False


def _couplings(model: Model) -> dict[str, list[str]]:
    """Names of loops that are couplings, if there are any."""
    names = [loop.name for loop in model.loops if loop.is_coupling]
    return {"couplings": names} if names else {}


def _elements(system: System) -> dict[str, Any]:
    """Force elements on bodies, if there are any: names, types, numbers of coefficients by array, and messages about undefined
    directions."""
    if not system.elements:
        return {}
    return {
        "elements": [e.element.name for e in system.elements],
        "element_types": [e.element.type for e in system.elements],
        "element_coefficients": {
            name: [len(e.parts) * (e.element.has_energy == has_energy) for e in system.elements]
            for name, has_energy in (("coefficient", True), ("drive", False))
        },
        "singular_elements": {e.element.type: e.element.singular for e in system.elements if e.element.singular},
    }


def _singular_outputs(system: System) -> dict[str, Any]:
    """Outputs that may have a value but no derivative, such as distances of coincident points, if there are any."""
    found = pivoted_outputs(system.model)
    return {"singular_outputs": found} if found else {}


def _of_free(system: System, q: tuple[float, ...]) -> list[float]:
    """Values of the coordinates that are not prescribed, from the values q of all coordinates."""
    model = system.model
    return [x for x, name in zip(q, model.released.coordinate_names, strict=False) if name not in model.motion]


def _closures(system: System) -> dict[str, Any]:
    """Groups of loops that are closed together, with the dependent speeds and the characteristic length (m) of each
    group."""
    if system.partition is None:
        return {}
    ears = system.partition.ears
    place = {link.speed + j: link.u + j for link in system.links for j in range(link.joint.freedoms)}
    return {
        "closures": [
            {"loops": e.loops, "dependent": tuple(place[i] for i in e.dependent), "length": e.length} for e in ears
        ]
    }


def _redundancy(system: System) -> dict[str, Any]:
    """Loop conditions that were dropped as redundant, retained redundant conditions, and the parameters by which a
    redundant condition may be violated; empty if there are none."""
    chosen, model = system.partition, system.model
    if chosen is None:
        return {}
    dropped, opening = list(chosen.dropped_conditions(model)), list(chosen.opening)
    loops = {i for e in chosen.ears if e.rows - len(e.dropped) > e.rank for i in e.loops} if opening else set()
    names = {name for i in loops for name in closure_row_names(model.loops[i])}
    redundant = [k for k, name in enumerate(model.closure_names) if name in names and k not in dropped]
    tables = {"dropped": dropped, "redundant": redundant, "opening": opening}
    tolerance = {"loop_tolerance": model.loop_tolerance} if dropped or redundant else {}
    return tolerance | {name: table for name, table in tables.items() if table}


def _bodies(model: Model, functions: Mapping[str, Any]) -> dict[str, Any]:
    """Names of bodies, points with their bodies (-1 is the ground) and default places, and data for views. Empty for
    packages without functions for frames."""
    if FRAMES_LIBRARY not in map(library_of, functions):
        return {}
    points = [
        {"name": p.name, "body": p.body, "at": [float(e.evaluate(model.defaults)) for e in p.at]} for p in model.points
    ]
    names = {"bodies": [b.name for b in model.bodies]}
    return {**names, **({"points": points} if points else {}), "display": display(model)}


def _joint_link(system: System, body: int) -> int:
    """The link whose joint carries a body; -1 for a body that is fixed to its parent."""
    link, steps = system.carriers[body]
    return -1 if steps else int(link)
