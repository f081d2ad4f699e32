"""Products of the Hessian of a weighted sum of udot with directions; see `codegen.mechanics.second_order`."""

from __future__ import annotations

from dataclasses import replace

from ...program.procedure import (
    ADJOINT_TANGENTS,
    ADJOINT_VALUES,
    GROUND_TWICE,
    Array,
    Bind,
    Combine,
    Formulas,
    Own,
    Prepare,
    Procedure,
    Run,
    Single,
    Step,
    Zero,
)
from ..sweeps import adjoint_name, along_name, mass_name
from .choice import UnknownFunctionError
from .mass import SOLVE
from .second_order_loops import WithLoops
from .shared import Shared, performed
from .words import OTHER_WIDTHS

HESSIAN_PRODUCTS = "hessian_products"
"""The function, which is included only on request."""


def hessian_products(w: Shared) -> Procedure:
    """The Hessian of ``weights . udot`` times directions: the change of its gradient along them.

    Raises
    ------
    UnknownFunctionError
        The model has no degree of freedom.
    """
    _check(w)
    dudot, weights, virtual, change = w.of("dudot", "b", "udot", "dudot")
    virtual, change = virtual.called("virtual_motion"), change.called("dudot_bar")
    right = weights.tangent("b")
    found, dforce = dudot.called("found_dudot"), dudot.called("dforce_bar")
    parts = _Parts(w)
    gradient = tuple(w.one(f"dg{n}") for n in w.state)
    steps: tuple[Step, ...]
    if w.loops:
        loops = WithLoops(w, parts.formulas, parts.bars)
        steps = (*w.solved, *loops.adjoints(weights, virtual), *loops.along(gradient))
    else:
        steps = (
            *w.solved,
            Own(virtual),
            Single(SOLVE, ((right, weights),), ((dudot, virtual),)),
            *parts.weights(virtual),
            Own(found),
            Bind(dudot, found),
            w.balance,
            Own(change),
            Zero(change),
            parts.tangents,
            Own(right),
            Combine(right, (), (change,)),
            Own(dforce),
            Bind(dudot, dforce),
            *SOLVE,
            Bind(dudot, found),
            *map(Zero, gradient),
            *parts.adjoint_tangents(),
        )
    return Procedure(
        HESSIAN_PRODUCTS,
        "Products of the Hessian of b . udot with directions: the change of its gradient along them (d Eqs. 9, 10).",
        (*w.of(*w.state), weights),
        gradient,
        steps,
        tuple(a.tangent() for a in w.of(*w.state)),
        OTHER_WIDTHS,
    )


def _check(w: Shared) -> None:
    """Raise the error of a model without such products."""
    if not w.system.model.nu:
        raise UnknownFunctionError(
            f"functions: {HESSIAN_PRODUCTS} needs a degree of freedom, and this model has none; leave it out"
        )


class _Parts:
    """The routines of `hessian_products`: adjoints, and tangents of both values and adjoints."""

    def __init__(self, w: Shared):
        self.w = w
        quaternions = any(link.joint.quaternion is not None for link in w.system.links)
        self.sweeps = [
            *(["rotations"] if quaternions else []),
            *(["pose", "velocities", "clear", "loads"] if w.elements else []),
            "found_motion",
            "missing_forces",
        ]
        self.formulas = [*w.motions, *w.forces, *w.coefficients]
        self.bars = [self._bar(f) for f in self.formulas]

    def _bar(self, formulas: Formulas) -> Array:
        """The array of the adjoints of some formulas."""
        (target,) = formulas.targets
        return Array(f"{target}_bar", (), self.w.system.arrays.get(target) or self.w.one(target).size)

    def weights(self, virtual: Array) -> list[Step]:
        """The adjoints of missing joint forces, and zeros to which blocks add adjoints of formulas."""
        bar = self.w.one("force").called("force_bar")
        return [
            Own(bar),
            Combine(bar, (), (virtual,)),
            *(step for a in self.bars for step in (Own(a), Zero(a))),
        ]

    @property
    def tangents(self) -> Step:
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
            performed("tangents_of_adjoints", "Tangents of the adjoints: the change of the gradient.", steps),
        ]
