"""Products with second derivatives of outputs and energies, for trees and loops; see `codegen.mechanics.second_order`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from ...program.procedure import (
    ADJOINT_TANGENTS,
    ADJOINT_VALUES,
    NO_TANGENTS,
    Array,
    Bind,
    Check,
    Combine,
    Formulas,
    Own,
    Perform,
    Prepare,
    Procedure,
    Run,
    Step,
    Zero,
    ZeroEntries,
)
from ..quantities import ENERGIES, RATES, Quantity, measured, run
from ..sweeps import DIFFERENTIATED_TWICE, adjoint_name, along_name
from .measures import energies, switch_quantities
from .second_order_loops import MULTIPLIERS, POSES, WithLoops, bar_of, changed, run_along
from .shared import Shared, performed
from .words import OTHER_WIDTHS, OUTPUTS, SWITCHES

ENERGY_PRODUCTS, OUTPUT_PRODUCTS = "energy_hessian_products", "output_hessian_products"
RATE_PRODUCTS, ASSEMBLY_PRODUCTS = "coordinate_rate_hessian_products", "assemble_hessian_products"
SWITCH_PRODUCTS = "switch_hessian_products"


def energy_products(w: Shared) -> Procedure:
    """The function that multiplies the Hessian of a weighted sum of both energies by directions."""
    bar = w.one("energy").called("energy_bar")
    weights = w.one("energy_weights")
    made = Measures(w, "energy", measured(w.system, (), range(len(ENERGIES))), ())
    begin: tuple[Step, ...] = (Combine(bar, (weights,)),)
    return made.procedure(ENERGY_PRODUCTS, energies(w)[0].arguments, (weights,), begin)


def rate_products(w: Shared) -> Procedure:
    """The function that multiplies the Hessian of a weighted sum of the rates of coordinates by directions."""
    bar, weights = w.one("qdot").called("qdot_bar"), w.one("rate_weights")
    made = Measures(w, "coordinate_rate", [RATES], (), of_state=False)
    begin: tuple[Step, ...] = (Own(bar), Combine(bar, (weights,)))
    return made.procedure(RATE_PRODUCTS, w.of("q", "u", *(w.p if w.loops else ())), (weights,), begin)


def assembly_products(w: Shared) -> Procedure:
    """The function that multiplies the Hessian of a weighted sum of assembled coordinates and speeds by directions."""
    made, weights = Measures(w, "assembly", [], (), of_state=False), w.of("q_weights", "u_weights")
    begin: tuple[Step, ...] = tuple(Combine(a, (of,)) for a, of in zip(made.zero, weights, strict=True))
    return made.procedure(ASSEMBLY_PRODUCTS, w.of("q", "u", *w.p), weights, begin)


def switch_products(w: Shared) -> Procedure:
    """The function that multiplies the Hessian of a weighted sum of switching functions by directions, for motions."""
    bar, weights = w.one("switches").called("switches_bar"), w.one("switch_weights")
    made = Measures(w, "switch", switch_quantities(w), (SWITCHES,))
    begin: tuple[Step, ...] = (Own(bar), Combine(bar, (weights,)))
    return replace(made.procedure(SWITCH_PRODUCTS, w.of(*w.state), (weights,), begin, [bar]), internal=True)


class Measures(WithLoops):
    """The steps for second derivatives of quantities of a state, for a tree or for loops.

    Parameters
    ----------
    w : Shared
    of : str
        Beginning of the names of the routines.
    quantities : list of Quantity
        In the order of computation.
    formulas : tuple of Formulas
        Formulas that read the quantities.
    of_state : bool
        Whether the quantities depend on gravity or on constants of a tree.
    """

    def __init__(
        self, w: Shared, of: str, quantities: list[Quantity], formulas: tuple[Formulas, ...], of_state: bool = True
    ):
        steps = [s for q in quantities for s in q.values]
        coefficients = [s for s in w.coefficients if s in steps]
        inner = [*(w.motions if of_state or w.loops else ()), *coefficients]
        super().__init__(w, inner, [bar_of(w, f) for f in inner])
        self.of, self.quantities, self.coefficients = of, quantities, coefficients
        self.over = (*formulas, *(s for s in steps if isinstance(s, Formulas) and s not in coefficients))
        measures = {s.sweep for s in steps if isinstance(s, Run)}
        of_pose = {"rotations", *(("pose", "velocities", "rate_gaps", "gaps") if w.loops else ())}
        quaternions = any(link.joint.quaternion is not None for link in w.system.links)
        self.sweeps = [s for s in DIFFERENTIATED_TWICE if s in measures | of_pose and (quaternions or s != "rotations")]
        self.of_values = [s for s in self.sweeps if s not in ("rates", "rate_gaps", "gaps")]
        """The sweeps that compute the quantities, and whose tangents are needed."""
        self.start = w.begin if of_state or w.loops else run("rotations")
        self.clear = ADJOINT_TANGENTS if of_state else NO_TANGENTS
        self.sums = [w.one(n) for q in quantities for n in q.sums]
        self.energies = [w.one("energy")] if any(q.energy for q in quantities) else []
        self.sum_bars = [a.called(f"{a.name}_bar") for a in (*self.sums, *self.energies)]
        self.zero = [self.gq, self.gu] if w.loops else []

    def procedure(
        self,
        name: str,
        given: tuple[Array, ...],
        weights: tuple[Array, ...],
        begin: tuple[Step, ...],
        bars: Iterable[Array] = (),
    ) -> Procedure:
        """The function `name`; the steps `begin` set the adjoints of results, `bars`, to the weights."""
        gradient = tuple(self.w.one(f"dg{a.name}") for a in given)
        self.begin, self.given_bars = begin, [*self.sum_bars, *bars]
        weighted = " + ".join(f"{a.name} . {a.name.removesuffix('_weights')}" for a in weights)
        return Procedure(
            name,
            f"Products of the Hessian of {weighted} with directions.",
            (*given, *weights),
            gradient,
            self.steps(gradient),
            tuple(a.tangent() for a in given),
            OTHER_WIDTHS,
        )

    def steps(self, gradient: tuple[Array, ...]) -> tuple[Step, ...]:
        """The steps of the function."""
        checks = (Check(True),) if self.w.formula_pivots and OUTPUTS in self.over else ()
        return (
            *self.start,
            *self.no_sums(),
            *self.coefficients,
            *run(*self.of_values),
            *self._adjoints(),
            *self._along(gradient),
            *checks,
        )

    def no_sums(self) -> tuple[Step, ...]:
        """Steps that set quantities to zero before sweeps add to them."""
        return tuple(step for a in (*self.sums, *self.energies) for step in (Own(a), Zero(a)))

    # -- values ----------------------------------------------------------------------------------------------------

    def _adjoints(self) -> list[Step]:
        """Steps for the adjoints of one vector of weights, and for the multipliers of the loops' conditions."""
        owned = [*self.sum_bars, *self.bars, *self.zero]
        found: list[Step] = [Own(a) for a in owned]
        if not self.w.loops:
            return [*found, self._all_back("", self.sweeps)]
        _, rate_gap, gap = self.gaps
        return [
            *found,
            *(Own(a) for a in (self.side, self.along_coordinates)),
            *map(Own, (rate_gap, gap)),
            *run("multiplier_gains"),
            self._all_back("speeds", [s for s in self.sweeps if s not in ("rate_gaps", "gaps")]),
            *self._single(self.gu, rate_gap),
            self._all_back("coordinates", [s for s in self.sweeps if s != "gaps"]),
            *run("coordinate_forces"),
            *self._single(self.along_coordinates, gap),
            self._all_back("", self.sweeps),
        ]

    def _all_back(self, which: str, sweeps: Iterable[str]) -> Perform:
        chosen = set(sweeps)
        steps: tuple[Step, ...] = (
            *(Zero(a) for a in (*self.zero, *self.bars, *self.sum_bars)),
            *self.begin,
            Prepare(ADJOINT_VALUES),
            *(f.adjoint() for f in self.over),
            *(Run(adjoint_name(s)) for s in reversed(self.sweeps) if s in chosen),
        )
        doc = f"Adjoints of the quantities and of the loops' conditions{which and f', up to {which}'}."
        return performed(f"{self.of}_adjoints_of_{which or 'values'}", doc, steps)

    # -- along directions ------------------------------------------------------------------------------------------

    def _along(self, gradient: tuple[Array, ...]) -> list[Step]:
        """Steps for tangents of the quantities, of their adjoints and of the multipliers: the change of the gradient."""
        w, loops = self.w, self.w.loops
        dgaps = [a.tangent() for a in self.gaps[1:]] if loops else []
        along = [a.tangent() for a in self.sums]
        dbars = [a.tangent() for a in (*self.bars, *self.given_bars)]
        begin: tuple[Step, ...] = w.along if loops else tuple(f.tangents() for f in w.motions if f in self.formulas)
        found: list[Step] = [
            *begin,
            *(f.tangents() for f in self.coefficients),
            *(step for a in (*along, *dbars) for step in (Own(a), Zero(a))),
            *map(Own, dgaps),
            performed(
                f"{self.of}_tangents",
                "Tangents of the quantities.",
                (Prepare(self.clear, True), *(Run(along_name(s), True) for s in self.of_values)),
            ),
            *map(Zero, gradient),
            performed(
                f"{self.of}_tangents_of_adjoints",
                "Tangents of the adjoints, with the multipliers of the conditions held: the change of the gradient.",
                (
                    *(replace(f, lanes=True, twice=True) for f in self.over),
                    *(
                        Run(along_name(adjoint_name(s)), True)
                        for s in reversed(self.sweeps)
                        if not loops or s not in POSES
                    ),
                ),
            ),
        ]
        if loops:
            found += self._loops_along(gradient, dgaps)
        found += [replace(f, lanes=True, twice=True) for f in self.formulas]
        if loops:
            found += [
                *run_along("tangential_gradients"),
                *(ZeroEntries(a, e) for a, e in zip(gradient[:2], self._dependent(), strict=True) if e),
            ]
        return found

    def _solved(self, of: Array, to: Array) -> list[Step]:
        side = self.side.tangent()
        return [Combine(side, (), (of,)), Bind(self.right, side), Bind(self.found, to), *MULTIPLIERS]

    def _loops_along(self, gradient: tuple[Array, ...], dgaps: list[Array]) -> list[Step]:
        side, coordinates = self.side.tangent(), self.along_coordinates.tangent()
        poses = [s for s in reversed(POSES) if s in self.sweeps]
        return [
            *(Own(a) for a in (side, coordinates)),
            *self._solved(gradient[1], dgaps[0]),
            changed("velocities", "rate_gaps", "velocities"),
            performed(
                f"{self.of}_tangents_of_poses",
                "Tangents of the adjoints of poses.",
                tuple(Run(along_name(adjoint_name(s)), True) for s in poses),
            ),
            *run_along("coordinate_forces"),
            *self._solved(coordinates, dgaps[1]),
            changed("positions", "gaps", *poses),
        ]
