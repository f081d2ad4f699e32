"""Products of the Hessian of a weighted sum of udot with directions; see `codegen.mechanics.second_order`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

from ...program.procedure import (
    Array,
    Bind,
    Combine,
    Own,
    Procedure,
    Single,
    Step,
    Zero,
)
from ..quantities import run
from .choice import UnknownFunctionError
from .mass import SOLVE
from .second_order_inverse import GivenAccelerations
from .second_order_loops import WithLoops
from .second_order_measures import (
    ASSEMBLY_PRODUCTS,
    ENERGY_PRODUCTS,
    OUTPUT_PRODUCTS,
    RATE_PRODUCTS,
    SWITCH_PRODUCTS,
    assembly_products,
    energy_products,
    rate_products,
    switch_products,
)
from .second_order_outputs import driving_entries, lacking, output_products, solution_bars
from .second_order_trees import TreeSteps
from .shared import Shared
from .words import OTHER_WIDTHS

HESSIAN_PRODUCTS = "hessian_products"
INVERSE_DYNAMICS_PRODUCTS = "inverse_dynamics_hessian_products"
"""The functions of this file; they are included only on request."""
GRADIENT_TANGENTS = "gradient_tangents"
"""The function that motions call instead of `HESSIAN_PRODUCTS`. Tangents of the weights and of udot are arguments, and
the gradient is a result."""


def hessian_products(w: Shared, motion: bool = False) -> Procedure:
    """The Hessian of ``weights . udot`` times directions: the change of its gradient along them.

    `motion`: the function `GRADIENT_TANGENTS`.
    """
    dudot, weights, virtual, change = w.of("dudot", "b", "udot", "dudot")
    virtual, change = virtual.called("virtual_motion"), change.called("dudot_bar")
    right = weights.tangent("b")
    found, dforce = dudot.called("found_dudot"), dudot.called("dforce_bar")
    parts = TreeSteps(w)
    gradient = tuple(w.one(f"dg{n}") for n in w.state)
    values = tuple(w.one(f"g{n}") for n in w.state) if motion else ()
    ends = tuple(w.one(f"g{n}").called(f"gradient_{n}") for n in w.state) if motion else ()
    known = (weights.tangent(), found) if motion else ()
    solved: tuple[Step, ...] = (Own(found), Bind(dudot, found), w.balance)
    if motion:  # instead of the balance, which would also store the values of the inverse dynamics
        solved = (Own(w.one("force")), *run("found_motion", "missing_forces"), Bind(dudot, found), w.seeded)
    steps: tuple[Step, ...]
    if w.loops:
        loops = WithLoops(w, parts.formulas, parts.bars, ends)
        steps = (*w.solved, *loops.adjoints(weights, virtual), *loops.along(gradient, known))
    else:
        steps = (
            *w.solved,
            Own(virtual),
            Single(SOLVE, ((right, weights),), ((dudot, virtual),)),
            *parts.weights((), (virtual,)),
            *map(Bind, values, ends),
            *map(Zero, values),
            *solved,
            Own(change),
            Zero(change),
            parts.mass_tangents,
            *(parts.gradients(values) if motion else ()),
            Own(right),
            Combine(right, (), (change, *known[:1])),
            Own(dforce),
            Bind(dudot, dforce),
            *SOLVE,
            Bind(dudot, found),
            *map(Zero, gradient),
            *parts.zero,
            parts.adjoint_tangents,
        )
    doc = "Products of the Hessian of b . udot with directions: the change of its gradient along them (d Eqs. 9, 10)."
    return Procedure(
        GRADIENT_TANGENTS if motion else HESSIAN_PRODUCTS,
        "The gradient of b . udot, and its tangents along directions of all arguments and of b." if motion else doc,
        (*w.of(*w.state), weights),
        (*gradient, *ends),
        steps,
        (*(a.tangent() for a in w.of(*w.state)), *known),
        OTHER_WIDTHS,
        internal=motion,
    )


def of_motions(w: Shared, found: tuple[Procedure, ...]) -> tuple[Procedure, ...]:
    """The given functions, and others that Hessian products of motions call."""
    names = {p.name for p in found}
    if {HESSIAN_PRODUCTS, "state_rates"} <= names:
        stored = [w.one(f"g{n}") for n in w.state]  # by sweeps that all these functions run
        found += (switch_products(w),) if w.system.model.switches.have_modes else ()
        found = with_arrays(found, stored, {*SECOND_ORDER, SWITCH_PRODUCTS})
        found = (*found, hessian_products(w, True))
    if OUTPUT_PRODUCTS in names and driving_entries(w):  # sweeps store these adjoints in all functions
        found = with_arrays(
            found, solution_bars(w), {*SECOND_ORDER, SWITCH_PRODUCTS, GRADIENT_TANGENTS} - {OUTPUT_PRODUCTS}
        )
    return found


def with_arrays(found: tuple[Procedure, ...], arrays: list[Array], names: set[str]) -> tuple[Procedure, ...]:
    """The given functions; those with one of the `names` also get the `arrays`, which are set to zero."""
    places = tuple(step for a in arrays for step in (Own(a), Zero(a)))
    return tuple(replace(p, steps=(*places, *p.steps)) if p.name in names else p for p in found)


def inverse_dynamics_products(w: Shared) -> Procedure:
    """The Hessian of ``weights . force`` of the inverse dynamics times directions: the change of its gradient along them."""
    names = ("q", "u", "udot", *w.rest)
    weights, force, dudot = w.of("force_weights", "force", "dudot")
    parts = TreeSteps(w, "tree_motion", "_at_udot")
    change = dudot.called("dforce_bar")
    gradient = tuple(w.one(f"dg{n}") for n in names)
    into = dudot.called("dudot_bar")
    steps: tuple[Step, ...] = (
        w.start,
        *w.forces,
        *w.applied,
        Own(force),
        *run("tree_motion", "missing_forces"),
        *parts.weights((weights,)),
        parts.adjoints,
        *(f.tangents() for f in parts.formulas),
        Own(change),
        Zero(change),
        parts.tangents,
        Bind(into, w.one("dgudot")),
        *map(Zero, (*(g for g in gradient if g.name != "dgudot"), into)),
        *parts.zero,
        parts.adjoint_tangents,
    )
    if w.loops:
        steps = GivenAccelerations(w).all_steps(weights, dict(zip(names, gradient, strict=True)))
    return Procedure(
        INVERSE_DYNAMICS_PRODUCTS,
        "Products of the Hessian of force_weights . force of the inverse dynamics with directions: the change of its gradient.",
        (*w.of("q", "u", "udot", *w.rest), weights),
        gradient,
        steps,
        tuple(a.tangent() for a in w.of("q", "u", "udot", *w.rest)),
        OTHER_WIDTHS,
    )


def second_order(w: Shared, asked: Collection[str]) -> tuple[Procedure, ...]:
    """The functions of this file that the model can have; these are included only on request.

    Raises
    ------
    UnknownFunctionError
        A function is in `asked` that the model cannot have.
    """
    found = []
    for name, (needs, make) in SECOND_ORDER.items():
        missing = needs(w)
        if missing and name in asked:
            raise UnknownFunctionError(f"functions: {name} needs {missing}; leave it out", name)
        if not missing:
            found.append(make(w))
    return tuple(found)


def _freedom(w: Shared) -> str:
    return "" if w.system.model.nu else "a degree of freedom, and this model has none"


SECOND_ORDER: Mapping[str, tuple[Callable[[Shared], str], Callable[[Shared], Procedure]]] = {
    HESSIAN_PRODUCTS: (_freedom, hessian_products),
    INVERSE_DYNAMICS_PRODUCTS: (_freedom, inverse_dynamics_products),
    ENERGY_PRODUCTS: (lambda w: "", energy_products),
    OUTPUT_PRODUCTS: (lacking, output_products),
    RATE_PRODUCTS: (lambda w: "", rate_products),
    ASSEMBLY_PRODUCTS: (lambda w: "" if w.loops else "loops, and this model has none", assembly_products),
}
"""For each function: a callable that returns what the model lacks for it, or "", and one that makes the procedure."""
