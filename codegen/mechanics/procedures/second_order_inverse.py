"""Products with second derivatives of the inverse dynamics of models with loops; see `codegen.mechanics.second_order`.

The results are the forces along independent speeds, if udot satisfies the conditions of the loops. The Lagrangian is that of
forward dynamics (`second_order_loops`) without ``w . udot``. The weights are the independent entries of z, and the given
accelerations those of udot. The dependent entries of both follow from the conditions, and the other multipliers as there.
"""

from __future__ import annotations

from collections.abc import Iterable

from ...program.procedure import (
    ADJOINT_TANGENTS,
    Array,
    Bind,
    Combine,
    Hold,
    Own,
    Prepare,
    Run,
    Single,
    Step,
    Zero,
    ZeroEntries,
)
from ..quantities import run
from ..sweeps import along_name
from .second_order_loops import WITH_WRENCHES, WithLoops, bar_of
from .shared import Shared, performed

GIVEN = run("given_accelerations")
"""The sweep that computes dependent accelerations from independent ones."""


class GivenAccelerations(WithLoops):
    """The steps of `inverse_dynamics_products` for loops; `all_steps` returns them in the order in which they run."""

    def __init__(self, w: Shared):
        formulas = [*w.motions, *w.forces, *w.coefficients]
        super().__init__(w, formulas, [bar_of(w, f) for f in formulas])
        self.gap = w.one("position").called("acceleration_gap")
        self.dependent_speeds = self._dependent()[1]
        """Indices of dependent speeds."""
        self.udot_gradient = self.udot_bar.tangent()

    def all_steps(self, weights: Array, gradient: dict[str, Array]) -> tuple[Step, ...]:
        """All steps of the function. `gradient`: the results, by the name of the argument that is differentiated."""
        w, negative = self.w, weights.called("negative_weights")
        self.by_udot = gradient["udot"]
        return (
            *w.begin,
            *w.forces,
            *w.applied,
            Own(negative),
            Combine(negative, (), (weights,)),
            *self._independent(negative),
            *self.adjoints(negative, self.udot.called("virtual_motion")),
            *self.along(tuple(a for n, a in gradient.items() if n != "udot")),
            *self._independent(self.udot_gradient),
        )

    def _independent(self, array: Array) -> list[Step]:
        """The step that sets the dependent entries of an array of speeds to zero."""
        return [ZeroEntries(array, self.dependent_speeds)] if self.dependent_speeds else []

    # -- values ----------------------------------------------------------------------------------------------------

    def values(self, first: Iterable[Step] = ()) -> list[Step]:
        """Steps for dependent accelerations; then for motions, forces and wrenches of the tree with the loops cut."""
        side, rates = self.gap.called("acceleration_gap_side"), self.udot.called("no_rates")
        change = self.udot.called("udot_change")
        return [
            Hold(self.udot, self.udot.called("given_udot")),
            *self._independent(self.udot),
            *map(Own, (self.gap, side, rates, change)),
            Zero(rates),
            performed(
                "gaps_of_given_accelerations",
                "Conditions of the loops in acceleration, with dependent accelerations of zero.",
                run("tree_outward", "acceleration_gaps"),
            ),
            Combine(side, (), (self.gap,)),
            Single(GIVEN, ((self.right, rates), (self.gap_right, side)), ((self.dudot, change),)),
            Combine(self.udot, (self.udot, change)),
            *super().values(first),
        ]

    def _virtual_motion(self, weights: Array, virtual: Array, solved: Array) -> list[Step]:
        """Steps for the virtual motion, whose independent entries are given, and for its multipliers."""
        gap_side, found = self.multiplier.called("no_gap"), ((self.dudot, virtual), (self.found, solved))
        right = ((self.right, weights), (self.gap_right, gap_side))
        return [Own(gap_side), Zero(gap_side), Single(self.solution, right, found)]

    # -- along directions ------------------------------------------------------------------------------------------

    @property
    def solution(self) -> tuple[Run, ...]:
        return (*GIVEN, *run("response_multipliers"))

    def _found_along(self, given: tuple[Array, ...]) -> list[Step]:
        """Steps for the tangents of all arguments of the inverse dynamics, dependent accelerations included."""
        w, found, change = self.w, self.dudot.called("found_dudot"), self.dudot.called("dudot_change")
        side, gap_side, dgap = self.side.tangent(), self.gap_right.called("dgap_side"), self.gap.tangent()
        sweeps = [*(s for s in self.of_values if s not in WITH_WRENCHES), "acceleration_gaps"]
        return [
            *w.along,
            *(f.tangents() for f in self.formulas if f not in w.motions),
            *map(Own, (found, change, side, gap_side, dgap)),
            Combine(found, (self.dudot,)),
            *self._independent(found),
            Bind(self.dudot, found),
            performed(
                "tangents_of_given_accelerations",
                "Tangents of the conditions in acceleration, with those of dependent accelerations zero.",
                (Prepare(ADJOINT_TANGENTS, True), *(Run(along_name(s), True) for s in sweeps)),
            ),
            Zero(side),
            Combine(gap_side, (), (dgap,)),
            Bind(self.right, side),
            Bind(self.gap_right, gap_side),
            Bind(self.dudot, change),
            *GIVEN,
            Combine(found, (found, change)),
            Bind(self.dudot, found),
        ]

    def _right_sides(self, given: tuple[Array, ...]) -> list[Step]:
        """The independent entries of the virtual motion do not change."""
        side = self.side.tangent()
        free = tuple(sorted({*range(side.size)}.difference(self.dependent_speeds)))
        return [*super()._right_sides(given), ZeroEntries(side, free)]

    def _no_gradient_along(self, gradient: tuple[Array, ...]) -> list[Step]:
        into: list[Step] = [Bind(self.udot_gradient, self.by_udot), Zero(self.udot_gradient)]
        return [*super()._no_gradient_along(gradient), *into]
