"""Steps of products with second derivatives for trees; see `codegen.mechanics.second_order`."""

from __future__ import annotations

from dataclasses import replace

from ...program.procedure import (
    ADJOINT_TANGENTS,
    ADJOINT_VALUES,
    GROUND_TWICE,
    Array,
    Combine,
    Own,
    Prepare,
    Run,
    Step,
    Zero,
)
from ..sweeps import adjoint_name, along_name, mass_name
from .second_order_loops import bar_of, ground_gradient, transposed
from .shared import Shared, performed


class TreeSteps:
    """Routines for trees: adjoints of the inverse dynamics, and tangents of both values and adjoints.

    Parameters
    ----------
    w : Shared
    motion : str
        The sweep that computes accelerations, by forward dynamics or from given udot.
    of : str
        Suffix of the names of the routines.
    driving : bool
        Whether forces of prescribed motion have weights.
    """

    def __init__(self, w: Shared, motion: str = "found_motion", of: str = "", driving: bool = False):
        self.w, self.of = w, of
        quaternions = any(link.joint.quaternion is not None for link in w.system.links)
        self.sweeps = [
            *(["rotations"] if quaternions else []),
            *(["pose", "velocities", "clear", "loads"] if w.elements else []),
            motion,
            "missing_forces",
            *(["driving"] if driving else []),
        ]
        self.formulas = [*w.motions, *w.forces, *w.coefficients, *(w.held if driving else ())]
        self.bars = [bar_of(w, f) for f in self.formulas]

    def weights(self, plus: tuple[Array, ...], minus: tuple[Array, ...] = ()) -> list[Step]:
        """Steps that set the adjoints of the missing joint forces to the given arrays, and the adjoints of formulas to
        zero before blocks add to them."""
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
        return performed(
            f"tangents_of_values{self.of}", "Tangents of the inverse dynamics, adjoints, tangents of M z.", steps
        )

    def gradients(self, into: tuple[Array, ...]) -> list[Step]:
        """Add the contributions of formulas and of gravity to the gradient; blocks have stored all other
        contributions."""
        return [*transposed(self.w, self.formulas, self.bars, into), *ground_gradient(self.w)]

    @property
    def adjoint_tangents(self) -> Step:
        """Tangents of the adjoints, which add up to the change of the gradient."""
        steps: tuple[Step, ...] = (
            *(Run(along_name(adjoint_name(s)), True) for s in reversed(self.sweeps)),
            Prepare(GROUND_TWICE, True),
            *(replace(f, lanes=True, twice=True) for f in self.formulas),
        )
        doc = "Tangents of the adjoints: the change of the gradient."
        return performed(f"tangents_of_adjoints{self.of}", doc, steps)

    @property
    def zero(self) -> list[Step]:
        """Steps that set tangents of the adjoints of formulas to zero before blocks add to them."""
        return [step for a in self.bars for step in (Own(a.tangent()), Zero(a.tangent()))]
