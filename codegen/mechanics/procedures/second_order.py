"""Products of the Hessian of a weighted sum of udot with directions; see `codegen.mechanics.second_order`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

from ...program.procedure import (
    ADJOINT_TANGENTS,
    ADJOINT_VALUES,
    GROUND_TWICE,
    Array,
    Bind,
    Combine,
    Own,
    Prepare,
    Procedure,
    Run,
    Single,
    Step,
    Zero,
)
from ..quantities import run
from ..sweeps import adjoint_name, along_name, mass_name
from .choice import UnknownFunctionError
from .mass import SOLVE
from .second_order_loops import WithLoops, bar_of, ground_gradient, transposed
from .second_order_measures import (
    ASSEMBLY_PRODUCTS,
    ENERGY_PRODUCTS,
    OUTPUT_PRODUCTS,
    RATE_PRODUCTS,
    assembly_products,
    energy_products,
    lacking,
    output_products,
    rate_products,
)
from .shared import Shared, performed
from .words import OTHER_WIDTHS

HESSIAN_PRODUCTS = "hessian_products"
INVERSE_DYNAMICS_PRODUCTS = "inverse_dynamics_hessian_products"
"""The functions, which are included only on request."""
GRADIENT_TANGENTS = "gradient_tangents"
"""The function that motions call instead of `HESSIAN_PRODUCTS`: weights have tangents, the tangents of udot are given,
and results include the gradient."""


def hessian_products(w: Shared, motion: bool = False) -> Procedure:
    """The Hessian of ``weights . udot`` times directions: the change of its gradient along them.

    `motion`: the function `GRADIENT_TANGENTS`.
    """
    dudot, weights, virtual, change = w.of("dudot", "b", "udot", "dudot")
    virtual, change = virtual.called("virtual_motion"), change.called("dudot_bar")
    right = weights.tangent("b")
    found, dforce = dudot.called("found_dudot"), dudot.called("dforce_bar")
    parts = _Parts(w)
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
            *parts.adjoint_tangents(),
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
    """The given functions, and `GRADIENT_TANGENTS` if motions have Hessian products."""
    if not {HESSIAN_PRODUCTS, "state_rates"} <= {p.name for p in found}:
        return found
    stored = [w.one(f"g{n}") for n in w.state]  # by sweeps that all these functions run
    places = tuple(step for a in stored for step in (Own(a), Zero(a)))
    kept = tuple(replace(p, steps=(*places, *p.steps)) if p.name in SECOND_ORDER else p for p in found)
    return (*kept, hessian_products(w, True))


def inverse_dynamics_products(w: Shared) -> Procedure:
    """The Hessian of ``weights . force`` of the inverse dynamics times directions: the change of its gradient along them."""
    weights, force, dudot = w.of("force_weights", "force", "dudot")
    parts = _Parts(w, "tree_motion", "_at_udot")
    change = dudot.called("dforce_bar")
    gradient = tuple(w.one(f"dg{n}") for n in ("q", "u", "udot", *w.rest))
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
        *parts.adjoint_tangents(),
    )
    return Procedure(
        INVERSE_DYNAMICS_PRODUCTS,
        "Products of the Hessian of force_weights . force of the inverse dynamics with directions: the change of its gradient.",
        (*w.of("q", "u", "udot", *w.rest), weights),
        gradient,
        steps,
        tuple(a.tangent() for a in w.of("q", "u", "udot", *w.rest)),
        OTHER_WIDTHS,
    )


class _Parts:
    """Routines for trees: adjoints of the inverse dynamics, and tangents of both values and adjoints.

    Parameters
    ----------
    w : Shared
    motion : str
        The sweep that computes accelerations, by forward dynamics or from given udot.
    of : str
        Appended to the names of the routines.
    """

    def __init__(self, w: Shared, motion: str = "found_motion", of: str = ""):
        self.w, self.of = w, of
        quaternions = any(link.joint.quaternion is not None for link in w.system.links)
        self.sweeps = [
            *(["rotations"] if quaternions else []),
            *(["pose", "velocities", "clear", "loads"] if w.elements else []),
            motion,
            "missing_forces",
        ]
        self.formulas = [*w.motions, *w.forces, *w.coefficients]
        self.bars = [bar_of(w, f) for f in self.formulas]

    def weights(self, plus: tuple[Array, ...], minus: tuple[Array, ...] = ()) -> list[Step]:
        """The adjoints of the missing joint forces of the inverse dynamics, and zeros to which blocks add adjoints of
        formulas."""
        bar = self.w.one("force").called("force_bar")
        return [
            Own(bar),
            Combine(bar, plus, minus),
            *(step for a in self.bars for step in (Own(a), Zero(a))),
        ]

    @property
    def adjoints(self) -> Step:
        """Adjoints of the inverse dynamics."""
        back = (Run(adjoint_name(s)) for s in reversed(self.sweeps))
        return performed(f"adjoints{self.of}", "Adjoints of the inverse dynamics.", (Prepare(ADJOINT_VALUES), *back))

    @property
    def tangents(self) -> Step:
        """Tangents of the inverse dynamics."""
        along = (Run(along_name(s), True) for s in self.sweeps)
        steps: tuple[Step, ...] = (Prepare(ADJOINT_TANGENTS, True), *along)
        return performed(f"tangents{self.of}", "Tangents of the inverse dynamics.", steps)

    @property
    def mass_tangents(self) -> Step:
        """Tangents of the inverse dynamics, its adjoints, and tangents of ``M z`` at fixed z.

        The balance has stored the values of the inverse dynamics.
        """
        steps: tuple[Step, ...] = (
            Prepare(ADJOINT_VALUES, True),
            Prepare(ADJOINT_TANGENTS, True),
            *(Run(along_name(s), True) for s in self.sweeps),
            *(Run(mass_name(s), True) for s in reversed(self.sweeps)),
        )
        return performed("tangents_of_values", "Tangents of the inverse dynamics, adjoints, tangents of M z.", steps)

    def gradients(self, into: tuple[Array, ...]) -> list[Step]:
        """Add the contributions of formulas and of gravity to the gradient; blocks have stored all other
        contributions."""
        return [*transposed(self.w, self.formulas, self.bars, into), *ground_gradient(self.w)]

    def adjoint_tangents(self) -> list[Step]:
        """Tangents of the adjoints, which add up to the change of the gradient."""
        steps: tuple[Step, ...] = (
            *(Run(along_name(adjoint_name(s)), True) for s in reversed(self.sweeps)),
            Prepare(GROUND_TWICE, True),
            *(replace(f, lanes=True, twice=True) for f in self.formulas),
        )
        zero = [step for a in self.bars for step in (Own(a.tangent()), Zero(a.tangent()))]
        return [
            *zero,
            performed(f"tangents_of_adjoints{self.of}", "Tangents of the adjoints: the change of the gradient.", steps),
        ]


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


def _tree(w: Shared) -> str:
    return "a model without loops, and this model has loops" if w.loops else _freedom(w)


SECOND_ORDER: Mapping[str, tuple[Callable[[Shared], str], Callable[[Shared], Procedure]]] = {
    HESSIAN_PRODUCTS: (_freedom, hessian_products),
    INVERSE_DYNAMICS_PRODUCTS: (_tree, inverse_dynamics_products),
    ENERGY_PRODUCTS: (lambda w: "", energy_products),
    OUTPUT_PRODUCTS: (lacking, output_products),
    RATE_PRODUCTS: (lambda w: "", rate_products),
    ASSEMBLY_PRODUCTS: (lambda w: "" if w.loops else "loops, and this model has none", assembly_products),
}
"""For each function: what a model lacks for it, or "", and the procedure."""
