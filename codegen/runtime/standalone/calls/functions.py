"""The generated functions of a package, as the manifest describes them: arguments, seeds, results and their shapes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..arrays import Array, Shape

ARGUMENTS = (
    "q", "u", "p", "inputs", "udot", "b", "force_weights", "energy_weights", "output_weights", "rate_weights", "q_weights",
    "u_weights",
)  # fmt: skip
SEEDS = ("dq", "du", "dp", "dinputs", "dudot", "db", "dt", "dqdot", "denergy", "doutputs", "dfull_q", "dfull_u")
"""Arguments and seeds, in the order of their pointers in ``NAME_calls.c``; `t` is passed by value."""

STATE = ("q", "u", "p", "inputs", "t")
"""Arguments of solver methods that take a state, in order."""

ALONG = ("dq", "du", "dp", "dinputs", "dt")
"""Seeds of the arguments of a state, in order."""

TAKES = {
    "mass_matrix": ("q", "p", "inputs", "t"),
    "inverse_mass_matrix": ("q", "p", "inputs", "t"),
    "solve_mass": ("q", "p", "inputs", "t", "b"),
    "inverse_dynamics": (*STATE, "udot"),
    "hessian_products": (*STATE, "b"),
    "inverse_dynamics_hessian_products": (*STATE, "udot", "force_weights"),
    "energy_hessian_products": (*STATE, "energy_weights"),
    "output_hessian_products": (*STATE, "output_weights"),
    "coordinate_rate_hessian_products": (*STATE, "rate_weights"),
    "assemble_hessian_products": (*STATE, "q_weights", "u_weights"),
    "initial": ("p",),
    "point_place": ("p",),
    "newton_step": ("q", "p", "inputs", "t"),
    "condition": ("q", "p", "inputs", "t"),
}
"""Arguments of functions that do not take a whole state; with seeds, these functions have the same arguments."""

WEIGHTED = {
    "sensitivities_transposed": ("dudot",),
    "output_sensitivities_transposed": ("doutputs",),
    "energy_sensitivities_transposed": ("denergy",),
    "coordinate_rate_sensitivities_transposed": ("dqdot",),
    "completion_sensitivities_transposed": ("dfull_q", "dfull_u"),
}
"""Seeds of transposed functions: weights of sums of results."""

WEIGHTS = {
    "dudot": "weights", "doutputs": "weights", "denergy": "weights", "dqdot": "weights", "dfull_q": "weights_q",
    "dfull_u": "weights_u",
}  # fmt: skip
"""Names of the seeds of transposed functions in solver methods."""

CURVING = ("b", *(n for n in ARGUMENTS if n.endswith("weights")))
"""Arguments that hold weights of results; Hessian products have no directions for them."""

BESIDE = {
    "points": "frames", "point_sensitivities": "frame_sensitivities", "point_accelerations": "frames",
    "point_acceleration_sensitivities": "frame_sensitivities",
}  # fmt: skip
"""Functions for selected points, each with the function whose library contains it."""

SELECTIVE = ("jacobians",)
"""Functions that skip results that are not requested, but always compute the first one."""

MEMBERS = {
    "sensitivities_transposed": "gradients", "output_sensitivities_transposed": "output_gradients",
    "energy_sensitivities_transposed": "energy_gradients", "completion_sensitivities_transposed": "assemble_gradients",
    "coordinate_rate_sensitivities_transposed": "coordinate_rate_gradients", "bias_force": "inverse_dynamics",
    "bias_force_sensitivities": "inverse_dynamics_sensitivities", "completion_sensitivities": "assemble_sensitivities",
}  # fmt: skip
"""Methods that call a generated function with another name; `--functions` and messages use the method's name."""

WITHOUT_ENTRIES: Mapping[str, Mapping[str, Any]] = {
    "accelerations": {"results": ("udot",)},
    "sensitivities": {"seeds": ALONG, "results": ("udot", "dudot")},
    "jacobians": {"arguments": STATE, "results": ("udot", "J_q", "J_u", "J_p", "J_inputs", "J_t")},
    "coordinate_rates": {"results": ("qdot",)},
    "coordinate_rate_sensitivities": {"seeds": ALONG, "results": ("qdot", "dqdot")},
    "outputs": {"results": ("outputs",)},
    "output_sensitivities": {"seeds": ALONG, "results": ("outputs", "doutputs")},
    "output_sensitivities_transposed": {"seeds": ("doutputs",), "results": ("doutputs",)},
    "closure": {"results": ("position", "velocity")},
    "closure_sensitivities": {"seeds": ALONG, "results": ("position", "dposition")},
}
"""Functions that are generated only if their results have entries; models may lack outputs, loops or degrees of
freedom."""

CLOSING = ("closure", "closing_step", "newton_step", "completion")
"""Functions that close loops."""

COMPOSED = ("mass_matrix", "mass_matrix_sensitivities", "inverse_dynamics", "inverse_dynamics_sensitivities")
OF_COMPOSED = ("energy_sensitivities", "accelerations", "sensitivities")
"""Mass matrix and inverse dynamics, and the functions from which they are composed in mechanisms with loops."""

TREES = ("assemble_gradients", "assemble_hessian_products")
"""Methods in `SOMETIMES` that need no generated function if a model has no loops."""

MADE_OF = {
    **dict.fromkeys(("equilibrium", "linearize", "ode"), (
        "accelerations", "sensitivities", "coordinate_rates", "coordinate_rate_sensitivities", "assemble_sensitivities",
    )),
    "simulate": ("state_rates", "closing_step"), "judge": ("state_rates", "closing_step", "outputs"),
    **dict.fromkeys(("assemble", "initial_state", "assemble_sensitivities", "assemble_gradients"), CLOSING),
    **dict.fromkeys(("frame_jacobians", "point_sensitivities", "point_jacobians"), ("frame_sensitivities",)),
    **dict.fromkeys(("points", "picture", "view"), ("frames",)), "diagnose": ("accelerations",), "condition": ("conditions",),
    "bias_force": ("inverse_dynamics",), "bias_force_sensitivities": ("inverse_dynamics_sensitivities",),
    "initial_sensitivities": ("assemble_sensitivities", *CLOSING),
    "hessians": (
        "hessian_products", "output_hessian_products", "energy_hessian_products", "coordinate_rate_hessian_products",
    ),
    "assemble_hessian_products": ("assemble_hessian_products", *CLOSING),
    "equilibrium_hessian_products": (
        "hessian_products", "gradients", "accelerations", "sensitivities", "coordinate_rates", "coordinate_rate_sensitivities",
    ),
}  # fmt: skip
"""Methods, each with the generated functions of other names that it calls."""

SOMETIMES = (
    "energies", "energy_sensitivities", "mass_matrix", "mass_matrix_sensitivities", "inverse_mass_matrix", "solve_mass",
    "solve_mass_sensitivities",
    "inverse_dynamics", "inverse_dynamics_sensitivities", "bias_force", "bias_force_sensitivities", "reactions",
    "reaction_sensitivities", "driving_forces", "driving_force_sensitivities", "outputs",
    "output_sensitivities", "gradients", "coordinate_rate_gradients", "energy_gradients", "output_gradients",
    "assemble_gradients", "hessian_products", "hessians", "inverse_dynamics_hessian_products",
    "output_hessian_products", "energy_hessian_products", "coordinate_rate_hessian_products", "assemble_hessian_products",
    "equilibrium", "linearize", "ode", "equilibrium_hessian_products", "simulate", "judge", "diagnose",
    "frames", "frame_sensitivities", "frame_jacobians", "points", "point_sensitivities", "point_jacobians", "picture", "view",
)  # fmt: skip
"""Methods of the solver that a package may lack."""


@dataclass(frozen=True, slots=True)
class Function:
    """A generated function of a package.

    Attributes
    ----------
    arguments, results : tuple of str
        In the order of the generated code.
    seeds : dict of str to int
        Seeds with their numbers of entries, in the order of the generated code.
    takes : frozenset of str
        Arguments of the solver method, including those on which the function does not depend.
    order : tuple of str
        Order of arguments in calls: those of `STATE`, then accelerations or forces if the function takes any. None is passed for
        arguments that it does not take.
    directions : tuple of str
        Seeds in the same order.
    shapes : tuple of tuple of int
        Shapes of the results, after batch axes.
    derived : tuple of bool
        Whether a result is a derivative along the seeds.
    widths : tuple of int
        Numbers of directions that the C code computes at once; empty for a function without seeds.
    """

    name: str
    arguments: tuple[str, ...]
    seeds: dict[str, int]
    results: tuple[str, ...]
    shapes: tuple[Shape, ...]
    derived: tuple[bool, ...]
    widths: tuple[int, ...]
    takes: frozenset[str]
    order: tuple[str, ...]
    directions: tuple[str, ...]

    def named(self, given: Sequence[Any]) -> dict[str, Any]:
        """The arguments by name, from those in order."""
        return {n: x for n, x in zip(self.order, given, strict=True) if n in self.takes}

    def whole_shapes(self, batch: Shape, k: int = 0) -> list[Shape]:
        """Shapes of the results of a call with k directions: (*batch, ...), or (k, *batch, ...) for derivatives."""
        return [((k,) if d else ()) + batch + s for s, d in zip(self.shapes, self.derived, strict=True)]

    @property
    def per_direction(self) -> int:
        """Number of entries of seeds and derivatives per direction."""
        return sum(self.seeds.values()) + sum(math.prod(s) for s, d in zip(self.shapes, self.derived, strict=True) if d)

    def has_entries(self) -> bool:
        """Whether any result has entries."""
        return any(map(math.prod, self.shapes))


class Wanted:
    """A selection of the results of a function; results that it does not compute are zero. A plain name selects all results.

    Parameters
    ----------
    name : str
        Name of the function.
    returned : sequence of str
    function : Function, optional
        A function that the manifest does not list; see `over_points`.
    table : array, optional
        Bodies and places of selected points, as the C code reads them.
    """

    __slots__ = ("function", "name", "returned", "table")

    def __init__(
        self, name: str, returned: Sequence[str], function: Function | None = None, table: Array | None = None
    ):
        self.name, self.returned, self.function, self.table = name, tuple(returned), function, table


def over_points(f: Function, accelerations: Function | None, places: Shape, shape: Shape) -> Function:
    """The function of ``NAME_calls.c`` for the motion of points, from the functions for frames and frame
    accelerations."""
    names: tuple[str, ...] = ("frames", "point_places", "position", "velocity")
    shapes: tuple[Shape, ...] = (f.shapes[0], places, shape, shape)
    name = "points" if accelerations is None else "point_accelerations"
    if accelerations is not None:
        names, shapes = (*names, "acceleration", "frame_accelerations"), (*shapes, shape, accelerations.shapes[0])
    if not f.seeds:
        return replace(f, name=name, results=names, shapes=shapes, derived=(False,) * len(names))
    both = tuple(n for result in names for n in (result, f"d{result}"))
    twice = tuple(s for s in shapes for _ in range(2))
    widths = f.widths if accelerations is None else (*f.widths, *accelerations.widths)
    name = f"{name.removesuffix('s')}_sensitivities"
    return replace(f, name=name, results=both, shapes=twice, derived=(False, True) * len(names), widths=widths)


def shapes_of(manifest: Mapping[str, Any]) -> dict[str, Shape]:
    """Shapes of all arguments and results, after batch axes."""
    nq, nu, n_p, ninputs, noutputs, nclosure = (
        len(manifest[f"{n}_names"]) for n in ("coordinate", "speed", "parameter", "input", "output", "closure")
    )
    nloops, nbodies = len(manifest.get("loops", ())), len(manifest.get("joint_links", ()))
    return {
        "q": (nq,), "u": (nu,), "p": (n_p,), "inputs": (ninputs,), "t": (), "udot": (nu,), "b": (nu,), "weights": (nu,),
        "force_weights": (nu,), "energy_weights": (2,), "output_weights": (noutputs,), "rate_weights": (nq,),
        "q_weights": (nq,), "u_weights": (nu,),
        "gq": (nq,), "gu": (nu,), "gudot": (nu,), "gp": (n_p,), "ginputs": (ninputs,), "gt": (),
        "qdot": (nq,), "x": (nu,), "force": (nu,), "energy": (2,), "outputs": (noutputs,), "M": (nu, nu),
        "inverse_M": (nu, nu),
        "J_q": (nu, nq), "J_u": (nu, nu), "J_p": (nu, n_p), "J_inputs": (nu, ninputs), "J_t": (nu,),
        "position": (nclosure,), "velocity": (nclosure,), "step": (nq,), "condition": (nloops,),
        "actuation": (len(manifest["prescribed_names"]),),
        "full_q": (nq,), "full_u": (nu,), "reaction": (len(manifest["links"]), 6), "loop_reaction": (nloops, 6),
        "frames": (nbodies, 18), "frame_accelerations": (nbodies, 6), "point_places": (len(manifest.get("points", ())), 3),
    }  # fmt: skip


def names_of(manifest: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Names of the entries of arguments and results that may be given by name."""
    q, u, p, inputs = (tuple(manifest[f"{n}_names"]) for n in ("coordinate", "speed", "parameter", "input"))
    return {
        "q": q, "u": u, "udot": u, "b": u, "weights": u, "force_weights": u, "output_weights": tuple(manifest["output_names"]),
        "energy_weights": ("kinetic", "potential"), "rate_weights": q, "q_weights": q, "u_weights": u, "p": p,
        "inputs": inputs, "qdot": q, "full_q": q, "full_u": u,
        "outputs": tuple(manifest["output_names"]), "energy": ("kinetic", "potential"),
    }  # fmt: skip


def functions_of(manifest: Mapping[str, Any], shapes: Mapping[str, Shape]) -> dict[str, Function]:
    """The generated functions of a package, by name."""
    return {name: function(name, entry, shapes) for name, entry in manifest["functions"].items()}


def function(name: str, entry: Mapping[str, Any], shapes: Mapping[str, Shape]) -> Function:
    """The generated function that an entry of the manifest describes."""
    seeds = {s: math.prod(shapes[s[1:]]) for s in entry.get("seeds", ())}
    results = tuple(entry["results"])
    derived = tuple(bool(seeds) and r.startswith("d") for r in results)
    of_results = tuple(shapes[r[1:] if d else r] for r, d in zip(results, derived, strict=True))
    arguments, widths = tuple(entry.get("arguments", ())), tuple(entry.get("widths", ()))
    of = name.removesuffix("_transposed").removesuffix("_sensitivities")
    takes = TAKES.get(of) or TAKES.get(of.removesuffix("s"), STATE)
    order = (*STATE, *(n for n in takes if n not in STATE))
    of_seeds = [n for n in order if n not in CURVING] if name.endswith("hessian_products") else order
    directions = WEIGHTED.get(name) or tuple(f"d{n}" for n in of_seeds if seeds)
    return Function(
        name, arguments, seeds, results, of_results, derived, widths, frozenset(takes), order, directions
    )  # fmt: skip


def made_of(manifest: Mapping[str, Any], member: str) -> set[str]:
    """A method, and the functions and methods that it uses."""
    names = {member, *MADE_OF.get(member, ())}
    return names | {*OF_COMPOSED} if manifest["closure_names"] and not names.isdisjoint(COMPOSED) else names


def lacks(manifest: Mapping[str, Any], member: str) -> bool:
    """Whether a solver method is not available in this package."""
    names = made_of(manifest, member)
    left_out, functions = manifest.get("left_out", ()), manifest["functions"]
    # assembly uses whichever closing functions the package has
    if member in left_out or any(MEMBERS.get(n, n) in left_out for n in names.difference(functions, CLOSING)):
        return True
    nothing = {
        *WITHOUT_ENTRIES,
        *(MEMBERS.get(n) for n in WITHOUT_ENTRIES),
        *([] if manifest["closure_names"] else TREES),
    }
    return (
        member in SOMETIMES
        and member not in nothing
        and names.isdisjoint({name for f in functions for name in (f, MEMBERS.get(f))})
    )
