"""Products with second derivatives of outputs, for trees and loops; see `codegen.mechanics.second_order`."""

from __future__ import annotations

from dataclasses import replace

from ...program.procedure import (
    ADJOINT_VALUES,
    AddEntry,
    Array,
    Bind,
    Check,
    Combine,
    Own,
    Prepare,
    Procedure,
    Run,
    Single,
    Step,
    Zero,
)
from ..outputs import DrivingMeasure, EnergyMeasure, RecordMeasure
from ..quantities import Quantity, measured, run
from ..sweeps import adjoint_name, along_name
from .mass import SOLVE
from .second_order_loops import WITH_WRENCHES, WithLoops
from .second_order_measures import OUTPUT_PRODUCTS, Measures
from .second_order_trees import TreeSteps
from .shared import Shared, performed
from .words import OUTPUTS


def lacking(w: Shared) -> str:
    """What a model lacks for second derivatives of outputs; "" if nothing."""
    return "" if w.system.model.outputs else "outputs, and this model has none"


def driving_entries(w: Shared) -> dict[int, int]:
    """For each output that is a force of prescribed motion, the number of the prescribed coordinate."""
    model = w.system.model
    return {
        i: model.prescribed_names.index(o.choice[0])
        for i, (o, m) in enumerate(zip(model.outputs, w.measures, strict=True))
        if isinstance(m, DrivingMeasure)
    }


def output_products(w: Shared) -> Procedure:
    """The function that multiplies the Hessian of a weighted sum of outputs by directions."""
    read: set[str] = set()
    for o, m in zip(w.system.model.outputs, w.measures, strict=True):
        if isinstance(m, RecordMeasure):
            read |= {*m.reads, *m.also(o)}
    entries = {i: m.entry for i, m in enumerate(w.measures) if isinstance(m, EnergyMeasure)}
    driving = driving_entries(w)
    bar, energy_bar = w.one("outputs").called("outputs_bar"), w.one("energy").called("energy_bar")
    weights = w.one("output_weights")
    quantities = measured(w.system, read, entries.values())
    solved = driving or any(q.dynamics for q in quantities)
    made = AfterSolution(w, quantities, driving) if solved else Measures(w, "output", quantities, (OUTPUTS,))
    begin: tuple[Step, ...] = (
        Own(bar),
        Combine(bar, (weights,)),
        *(AddEntry(energy_bar, entry, bar, i) for i, entry in entries.items()),
        *(AddEntry(driving_bar(w), entry, bar, i) for i, entry in driving.items()),
    )
    return made.procedure(OUTPUT_PRODUCTS, w.of(*w.state), (weights,), begin, [bar])


def driving_bar(w: Shared) -> Array:
    """The array of weights of the forces that prescribed motion requires."""
    return w.one("driving").called("driving_bar")


def solution_bars(w: Shared) -> list[Array]:
    """The arrays of adjoints that determine the virtual motion: of udot, and of the wrenches of loops."""
    return [w.one("udot").called("udot_bar"), *([w.one("position").called("multiplier_bar")] if w.loops else [])]


class AfterSolution(Measures):
    """The steps for outputs that depend on accelerations or on forces of prescribed motion, for a tree or for loops.

    First, outputs other than these forces are differentiated as functions of udot and the state. Then udot is eliminated as
    in `second_order.hessian_products`, with the derivatives with respect to udot as weights. Forces of prescribed motion are
    forces of the inverse dynamics, so their weights are the components of the virtual motion along prescribed coordinates.
    """

    def __init__(self, w: Shared, quantities: list[Quantity], driving: dict[int, int]):
        super().__init__(w, "output", quantities, (OUTPUTS,))
        self.driven = bool(driving)
        self.tree = TreeSteps(w, of="_of_outputs", driving=self.driven)
        self.formulas, self.bars = self.tree.formulas, self.tree.bars
        self.second = WithLoops(w, self.formulas, self.bars, of="_of_outputs", driving=self.driven)
        unread = {"rate_gaps", "gaps", *(() if w.elements else ("velocities",))}
        self.sweeps = [s for s in self.sweeps if s not in unread]
        self.of_values = [*self.sweeps]
        self.weights_along = self.dudot.called("weights_along")
        self.found_dudot = self.dudot.called("found_dudot")
        self.virtual = self.udot.called("virtual_motion")

    def steps(self, gradient: tuple[Array, ...]) -> tuple[Step, ...]:
        """The steps of the function."""
        w, udot_bar = self.w, self.udot_bar
        bars = [a for a in self.given_bars if a not in self.sum_bars]
        self.sum_bars += [driving_bar(w)] if self.driven else []
        solved: list[Step] = [
            Own(self.virtual),
            Single(SOLVE, ((self.right, udot_bar),), ((self.dudot, self.virtual),)),
            Own(self.force_bar),
            Combine(self.force_bar, (), (self.virtual,)),
        ]
        second = self._second_of_tree()
        if w.loops:
            known = (self.weights_along, self.found_dudot)
            solved, second = [], [*self.second.adjoints(udot_bar, self.virtual), *self.second.along(gradient, known)]
        return (
            *w.solved,
            *(self.second.values() if w.loops else ()),
            *self.no_sums(),
            *run(*self.of_values),
            *map(Own, (*self.sum_bars, *self.bars, *self.zero, *bars)),
            *(step for a in solution_bars(w) for step in (Own(a), Zero(a))),
            *(self._of_driving() if self.driven else ()),
            self._all_back("", self.sweeps),
            *solved,
            *self._first_along(gradient),
            *second,
            *((Check(True),) if w.formula_pivots else ()),
        )

    # -- values ----------------------------------------------------------------------------------------------------

    def _of_driving(self) -> list[Step]:
        """Steps that add contributions of forces of prescribed motion to the right sides for the virtual motion."""
        values: tuple[Step, ...] = ()
        sweeps = ["tree_motion", *WITH_WRENCHES, "driving_in_loops"]
        if not self.w.loops:
            values, sweeps = (Own(self.force), *run("found_motion", "missing_forces")), self.tree.sweeps[-3:]
        return [
            *values,
            Own(self.force_bar),
            Zero(self.force_bar),
            performed(
                "adjoints_of_driving",
                "Derivatives of the weighted forces of prescribed motion with respect to udot and the wrenches of loops.",
                (
                    *map(Zero, (*self.zero, *self.bars, *self.sum_bars)),
                    *self.begin,
                    Prepare(ADJOINT_VALUES),
                    *(Run(adjoint_name(s)) for s in reversed(sweeps)),
                ),
            ),
        ]

    # -- along directions ------------------------------------------------------------------------------------------

    def _first_along(self, gradient: tuple[Array, ...]) -> list[Step]:
        """Steps for the tangents of the outputs, as functions of udot and the state, and of their adjoints."""
        w, dudot_bar = self.w, self.udot_bar.tangent()
        sums = [a.tangent() for a in (*self.sums, *self.bars, *self.given_bars)]
        return [
            *w.along,
            Own(self.found_dudot),
            Bind(self.dudot, self.found_dudot),
            w.balance,
            *(step for a in (*sums, self.weights_along) for step in (Own(a), Zero(a))),
            Bind(dudot_bar, self.weights_along),
            performed(
                "output_tangents",
                "Tangents of the quantities.",
                (Prepare(self.clear, True), *(Run(along_name(s), True) for s in self.of_values)),
            ),
            *map(Zero, gradient),
            performed(
                "output_tangents_of_adjoints",
                "Tangents of the adjoints, with udot as an argument.",
                (
                    *(replace(f, lanes=True, twice=True) for f in self.over),
                    *(Run(along_name(adjoint_name(s)), True) for s in reversed(self.sweeps)),
                ),
            ),
        ]

    def _second_of_tree(self) -> list[Step]:
        """Steps that eliminate udot in trees: virtual motion, and tangents of the adjoints of the inverse dynamics."""
        change, dforce = self.udot_bar.tangent(), self.dudot.called("dforce_bar")
        return [
            Own(change),
            Zero(change),
            self.tree.mass_tangents,
            Own(self.right),
            Combine(self.right, (), (change, self.weights_along)),
            Own(dforce),
            Bind(self.dudot, dforce),
            *SOLVE,
            Bind(self.dudot, self.found_dudot),
            self.tree.adjoint_tangents,
        ]
