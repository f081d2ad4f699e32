"""Writes ``NAME_motion.c``: the functions of a solver for the integrators in ``motion/``, all with the same signature."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ...model.model import Model
from ...model.steep import steep_functions
from ...model.switches import KINDS
from ...program.procedure import Procedure
from ...version import __version__
from ..function import called_with
from ..templates import render
from . import FLOAT64, C
from .functions import in_modes
from .libraries import FOUR, number_of

VALUES = ("state_rates", "closing_step", "completion", "outputs", "switches")
"""Functions without directions that integration calls, if the solver has them."""

ALONG = (
    "state_rate_sensitivities", "completion_sensitivities", "output_sensitivities", "sensitivities_transposed",
    "coordinate_rate_sensitivities_transposed", "completion_sensitivities_transposed", "output_sensitivities_transposed",
    "switch_sensitivities", "switch_sensitivities_transposed",
)  # fmt: skip
"""Functions over directions that integration calls."""

CURVED = (
    "gradient_tangents", "switch_hessian_products", "output_hessian_products", "coordinate_rate_hessian_products",
)  # fmt: skip
"""Functions over directions that Hessian products of motions call."""

WIDTHS = (1, 8)
"""Numbers of directions that the integrators compute together."""


COUNTERS = {
    "free_q": ("nfree_q", 1, True), "free_u": ("nfree_u", 1, True), "quaternion": ("nquaternions", 1, True),
    "kept": ("nkept", 1, True), "dropped": ("ndropped", 1, True), "moving": ("nmoving", 1, False),
    "switch_of_output": ("nswitch_outputs", 2, False),
}  # fmt: skip
"""For each table: the member that holds its length, the size of an entry, and whether an empty table is written."""

MEMBERS = (
    "nq", "nu", "np", "ninputs", "noutputs", "nclosure", "nloops", "plain_rates", "workspace", "nfree_q", "nfree_u", "free_q",
    "free_u", "nquaternions", "quaternion", "nkept", "kept", "ndropped", "dropped", "apart", "slack", "split", "nswitches",
    "switch_kind", "drives", "nswitch_outputs", "switch_of_output", "steep", "nmoving", "moving", "state_rates",
    "closing_step", "completion", "outputs", "switches", "state_rate_sensitivities", "completion_sensitivities",
    "output_sensitivities", "switch_sensitivities",
)  # fmt: skip
"""Members of ``ordernm_system`` in the order of its declaration, which C++ initialisers require."""


def has_motion(functions: Mapping[str, Any]) -> bool:
    """Whether a solver with these functions can be integrated over time."""
    return "state_rates" in functions


def by_name(procedures: Iterable[Procedure]) -> dict[str, dict[str, Any]]:
    """Functions for integration by name: arguments, seeds and results of each, and whether it takes modes."""
    return {
        p.name: {
            "arguments": [a.name for a in p.arguments], "seeds": [a.name for a in p.seeds],
            "results": [a.name for a in p.results], "modes": p.modes is not None,
        }
        for p in procedures
    }  # fmt: skip


def write_motion(model: Model, manifest: Mapping[str, Any], procedures: Iterable[Procedure], allowed: float) -> str:
    """The C text of ``NAME_motion.c``.

    Parameters
    ----------
    manifest : dict
        See `codegen.manifest.manifest`.
    procedures : iterable of Procedure
        All functions of the solver, including those that only integration calls.
    allowed : float
        Largest residual of a dropped loop condition during a motion.
    """
    name, functions = manifest["name"], by_name(procedures)
    tables = _tables(model, manifest, functions)
    first, second = number_of("motion"), number_of("gradients")
    parts: dict[int, list[tuple[str, str]]] = {first: [], second: []}
    backwards: dict[str, list[str]] = {}
    members = _sizes(model, manifest, tables, functions, allowed)
    for f in [f for f in VALUES if f in functions]:
        parts[first].append((f, _call(name, f, functions[f], "")))
        members[f] = f
    curved = CURVED[:-1] if model.coordinate_names == model.speed_names else CURVED
    for f in [f for f in (*ALONG, *curved) if f in functions]:
        symbols = [f"{f}_{w}" for w in WIDTHS]
        of = second if f.endswith("_transposed") or f in CURVED else first
        parts[of] += [(f"{f}_{w}", _call(name, f, functions[f], f"_{w}")) for w in WIDTHS]
        if of == second:
            backwards[f] = symbols
        else:
            members[f] = f"{{{', '.join(symbols)}}}"
    return render(
        "c/motion.c.jinja",
        {
            "name": name,
            "version": __version__,
            "parts": [(library, of) for library, of in parts.items() if of],
            "first": first,
            "backwards": [(second, list(backwards.items()))] if backwards else [],
            "tables": [(table, numbers) for table, numbers in tables.items() if numbers],
            "members": [f".{m} = {members[m]}," for m in MEMBERS if m in members],
        },
    )


def scalar_header() -> str:
    """The text of ``motion/scalar.h``: the scalar type of the integrators, the only type in which motions run."""
    (scalar,) = (s for s in C.scalars if s.moves)
    return render("c/scalar.h.jinja", {"word": scalar.word, "epsilon": scalar.literal(repr(scalar.limits.epsilon))})


def _tables(model: Model, manifest: Mapping[str, Any], functions: Mapping[str, Any]) -> dict[str, list[int]]:
    """Tables in an ``ordernm_system``, by the name of the member."""
    dropped = set(manifest.get("dropped", ()))
    tables = {
        "free_q": [model.coordinate_names.index(n) for n in manifest["independent_names"]],
        "free_u": [model.speed_names.index(n) for n in manifest["independent_speed_names"]],
        "quaternion": manifest["quaternions"],
        "kept": [k for k in range(len(model.closure_names)) if k not in dropped],
        "moving": [model.inputs.index(n) for n in model.moving_inputs],
        "dropped": sorted(dropped),
    }
    if "switches" in functions:
        found = model.switches.found
        tables["switch_kind"] = [KINDS.index(s.kind) for s in found]
        tables["drives"] = [int(s.drives) + int(s.moves) for s in found]
        tables["switch_of_output"] = [n for s in found for output in sorted(s.outputs) for n in (s.number, output)]
    return tables


def _sizes(
    model: Model, manifest: Mapping[str, Any], tables: Mapping[str, Sequence[int]], functions: Mapping[str, Any], allowed: float
) -> dict[str, Any]:  # fmt: skip
    """Members of an ``ordernm_system`` that are numbers or tables."""
    free_u = set(tables["free_u"])
    shared = {n.partition(".")[0] for i, n in enumerate(model.speed_names) if i not in free_u}
    split = any(model.coordinate_names[i].partition(".")[0] in shared for i in tables["free_q"])
    found = {
        "nq": model.nq, "nu": model.nu, "np": len(model.parameters), "ninputs": len(model.inputs), "noutputs": len(model.outputs),
        "nclosure": len(model.closure_names), "nloops": len(model.loops),
        "plain_rates": int(model.coordinate_names == model.speed_names), "workspace": manifest["workspace"],
        "split": int(split),
    }  # fmt: skip
    for table, numbers in tables.items():
        counter, entries, always = COUNTERS.get(table, ("", 1, False))
        if counter and (numbers or always):
            found[counter] = len(numbers) // entries
        if numbers:
            found[table] = table
    if "switches" in functions:
        found["nswitches"] = len(tables["drives"])
    if steep := steep_functions(model):
        found["steep"] = steep
    if tables["dropped"]:
        found["apart"] = repr(allowed)
    if manifest.get("redundant"):
        found["slack"] = repr(allowed)
    return found


OWN = ("sin", "cos")
"""Functions that ``NAME_precise.c`` defines itself."""


def write_precise(
    model: Model, manifest: Mapping[str, Any], procedures: Iterable[Procedure], library: Sequence[str]
) -> str:
    """The C text of closure, rates and outputs in long double, with derivatives and transposes, for a model with loops."""
    name, functions = manifest["name"], by_name(procedures)
    sizes = {
        "q": model.nq, "u": model.nu, "p": len(model.parameters), "inputs": len(model.inputs), "qdot": model.nq, "udot": model.nu,
        "outputs": len(model.outputs), "full_q": model.nq, "full_u": model.nu, "t": 1,
        **({"switches": len(model.switches.found)} if "switches" in functions else {}),
    }  # fmt: skip

    def function(f: str, lanes: int, width: int) -> dict[str, Any]:
        """Data for the call of a function with `lanes` directions by a function that computes `width` directions; both are
        0 for a function without directions."""
        seeds, results = (functions[f].get(key, ()) for key in ("seeds", "results"))
        along = [r for r in results if r.removeprefix("d") in sizes and r not in sizes]
        return {
            "symbol": f"precise_{f}_{lanes}" if lanes else f"precise_{f}",
            "call": _call(name, f, functions[f], f"_{width}" if width else "", "x."),
            "lanes": lanes,
            "width": width,
            "seeds": [(a, sizes[a[1:]]) for a in seeds],
            "values": [(r, sizes[r]) for r in results if r not in along],
            "along": [(r, sizes[r[1:]]) for r in along],
        }

    members, called = [".closing_step = precise_closing_step"], []
    for f in VALUES:
        if f in functions and f != "closing_step":
            called.append(function(f, 0, 0))
            members.append(f".{f} = precise_{f}")
    for f in ALONG:
        if f in functions:
            # four directions use the functions over eight, since long double is rarely needed
            widths = [(w, w) for w in WIDTHS] + ([] if f.endswith("_transposed") else [(4, 8)])
            called += [function(f, lanes, width) for lanes, width in widths]
            members.append(f".{f} = {{{', '.join(f'precise_{f}_{lanes}' for lanes, _ in widths)}}}")
    return render(
        "c/precise.c.jinja",
        {
            "name": name,
            "NAME": name.upper(),
            "version": __version__,
            "library": " || ".join(f"(library) == {number_of(x)}" for x in ("motion", "gradients")),
            "scalar": FLOAT64,
            "renamed": [*(f for f in library if f not in OWN), "floor"],
            "nq": model.nq,
            "given": [(a, sizes[a]) for a in ("q", "u", "p", "inputs")],
            "modes": [sizes["switches"]] if "switches" in functions else [],
            "nclosure": len(model.closure_names),
            "nloops": len(model.loops),
            "closing_step": _call(name, "closing_step", functions["closing_step"], "", "x->"),
            "functions": called,
            "members": members,
        },
    )


def write_four(manifest: Mapping[str, Any], procedures: Iterable[Procedure]) -> str:
    """The C text of the functions for integration with four directions at once."""
    name, functions = manifest["name"], by_name(p for p in procedures if 4 in p.apart)
    found = [f for f in ALONG if f in functions]
    return render(
        "c/four.c.jinja",
        {
            "name": name,
            "version": __version__,
            "library": number_of(FOUR),
            "scalar": FLOAT64,
            "functions": [(f"motion_{f}", _call(name, f, functions[f], "_4")) for f in found],
            "members": [(f, f"motion_{f}") for f in found],
        },
    )


def _call(model: str, name: str, function: Mapping[str, Any], width: str, of: str = "c->") -> str:
    modes = ["modes"] if function["modes"] else []
    arguments = [*function["arguments"], *function["seeds"], *function["results"], *modes, "work"]
    return called_with(f"{model}_{in_modes(name) if modes else name}{width}(", [f"{of}{a}" for a in arguments])


__all__ = ["has_motion", "write_four", "write_motion", "write_precise"]
