"""Quantities computed for a state: energies, outputs, switching functions, forces of prescribed motion, reactions."""

from __future__ import annotations

from ...program.procedure import Check, Copy, CopyEntry, Formulas, Own, Procedure, Step, Zero
from ..outputs import DrivingMeasure, EnergyMeasure, RecordMeasure
from ..outputs.switches import quantities_of
from ..quantities import ENERGIES, POSE, Quantity, measured, run
from .shared import Shared
from .words import OUTPUTS, SWITCHES


def energies(w: Shared) -> list[Procedure]:
    model = w.system.model
    energy, denergy = w.of("energy", "denergy")
    quantities = measured(w.system, (), range(len(ENERGIES)))
    values, tangents = w.measuring(quantities)
    read = set[str]().union(*(e.names for x in model.loads if x.has_energy for e in x.coefficients))
    more = [*(["inputs"] if read & set(model.inputs) else []), *(["t"] if "t" in read else [])]
    given = [n for n in w.rest if n in (*w.p, *more)]
    check = (Check(True),) if any(q.pivots for q in quantities) else ()
    return w.pair(
        ("energies", "energy_sensitivities"),
        ("Kinetic and potential energy.", "Energies and their total derivative along seeds."),
        ["q", "u", *given],
        ["energy"],
        (Zero(energy), *w.begin, *values),
        (Zero(energy), *w.begin, Zero(denergy), *w.along, *w.turns, *tangents, *check),
    )


def outputs(w: Shared) -> list[Procedure]:
    model = w.system.model
    outputs, doutputs, energy, denergy = w.of("outputs", "doutputs", "energy", "denergy")
    driving, ddriving = w.of("driving", "ddriving")
    read: set[str] = set()
    for o, m in zip(w.system.model.outputs, w.measures, strict=True):
        if isinstance(m, RecordMeasure):
            read |= {*m.reads, *m.also(o)}
    quantities = measured(w.system, read, {m.entry for m in w.measures if isinstance(m, EnergyMeasure)})
    copies: list[Step] = []
    copies_along: list[Step] = []
    for i, measure in enumerate(w.measures):
        if isinstance(measure, EnergyMeasure):
            copies.append(CopyEntry(outputs, i, energy, measure.entry))
            copies_along.append(CopyEntry(doutputs, i, denergy, measure.entry))
        elif isinstance(measure, DrivingMeasure):
            n = model.prescribed_names.index(model.outputs[i].choice[0])
            copies.append(CopyEntry(outputs, i, driving, n))
            copies_along.append(CopyEntry(doutputs, i, ddriving, n))
    driven = any(isinstance(m, DrivingMeasure) for m in w.measures)
    energetic = any(isinstance(m, EnergyMeasure) for m in w.measures)
    values, along = _steps(w, quantities, OUTPUTS, driven, energetic)
    check = (Check(True),) if w.formula_pivots or any(q.pivots for q in quantities) else ()
    return w.pair(
        ("outputs", "output_sensitivities"),
        ("The outputs of the model.", "Outputs and their total derivative along seeds."),
        w.state,
        ["outputs"],
        (*values, *copies),
        (*along, *copies, *copies_along, *check),
    )


def switches(w: Shared) -> list[Procedure]:
    """Switching functions of the model, for integration over time."""
    return w.pair(
        ("switches", "switch_sensitivities"),
        ("The switching functions of the model.", "Switching functions and their total derivative along seeds."),
        w.state,
        ["switches"],
        *_steps(w, switch_quantities(w), SWITCHES),
    )


def switch_quantities(w: Shared) -> list[Quantity]:
    """The quantities that switching functions read."""
    return measured(w.system, set[str]().union(*map(quantities_of, w.system.model.switches.found)), ())


def _steps(
    w: Shared, quantities: list[Quantity], formulas: Formulas, driven: bool = False, energetic: bool = False
) -> tuple[tuple[Step, ...], tuple[Step, ...]]:
    """Steps for formulas over quantities, without and with tangents.

    With `driven` the steps also compute forces of prescribed motion. With `energetic` they also compute energies; an energy to
    which no quantity adds is zero.
    """
    sums = [w.one("energy")] if energetic or any(q.energy for q in quantities) else []
    sums += [w.one(name) for q in quantities for name in q.sums]
    zero = tuple(step for a in sums for step in (Own(a), Zero(a)))
    zero_along = tuple(step for a in sums for step in (Own(a.tangent()), Zero(a.tangent())))
    solved = driven or any(q.dynamics for q in quantities)
    before, along = (w.solved, w.solved_along) if solved else (w.begin, (*w.along, *w.turns))
    values, tangents = w.measuring(quantities, before, along)
    return (
        (*zero, *before, *values, formulas),
        (*zero, *before, *zero_along, *along, *tangents, formulas, formulas.tangents()),
    )


def driving_forces(w: Shared) -> list[Procedure]:
    """Procedures for the generalised forces that prescribed motion requires."""
    driving, ddriving, found, dfound = w.of("driving", "ddriving", "actuation", "dactuation")
    return w.pair(
        ("driving_forces", "driving_force_sensitivities"),
        (
            "Generalised forces that prescribed motion requires.",
            "Generalised forces that prescribed motion requires, and their total derivative along seeds.",
        ),
        w.state,
        ["actuation"],
        (*w.solved, Copy(found, driving)),
        (*w.solved, *w.solved_along, Copy(found, driving), Copy(dfound, ddriving)),
    )


def reactions_of(w: Shared) -> list[Procedure]:
    """Functions for the reactions of joints and loops. Derivatives of reactions need the derivatives of udot and two more
    sweeps over directions."""
    names = ["reaction", *(["loop_reaction"] if w.loops else [])]
    wrenches = w.of(*names)
    poses, turned = w.measuring([POSE], w.solved, w.solved_along)
    zero = tuple(map(Zero, wrenches[1:]))
    values = (*w.solved, *poses, *run("motion", "transmitted"))
    return w.pair(
        ("reactions", "reaction_sensitivities"),
        (
            "Reactions on links at their joints and on loops' end faces: moment, force; along the ground's axes.",
            "Reactions of joints and loops, and their total derivative along seeds.",
        ),
        w.state,
        names,
        (*zero, *values),
        (
            *zero,
            *values,
            *(Zero(a.tangent()) for a in wrenches[1:]),
            *w.solved_along,
            *turned,
            *run("reaction_out", "reaction_in"),
        ),
    )
