"""What is measured in a state: energies, outputs, reactions."""

from __future__ import annotations

from ...program.procedure import (
    Check,
    Copy,
    CopyEntry,
    Own,
    Procedure,
    Step,
    Zero,
)
from ..outputs import DrivingMeasure, EnergyMeasure, RecordMeasure
from ..outputs.switches import quantities_of
from ..quantities import ENERGIES, POSE, measured, run
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
    outputs, doutputs, energy, denergy, udot = w.of("outputs", "doutputs", "energy", "denergy", "udot")
    driving, ddriving = w.of("driving", "ddriving")
    read: set[str] = set()
    for o, m in zip(w.system.model.outputs, w.measures, strict=True):
        if isinstance(m, RecordMeasure):
            read |= {*m.reads, *m.also(o)}
    quantities = measured(w.system, read, {m.entry for m in w.measures if isinstance(m, EnergyMeasure)})
    sums = [energy] if any(q.energy for q in quantities) else []
    sums += [w.one(name) for q in quantities for name in q.sums]
    zero = tuple(step for a in sums for step in (Own(a), Zero(a)))
    zero_along = tuple(step for a in sums for step in (Own(a.tangent()), Zero(a.tangent())))
    before: tuple[Step, ...] = w.begin
    along: tuple[Step, ...] = (*w.along, *w.turns)
    driven = any(isinstance(m, DrivingMeasure) for m in w.measures)
    if driven or any(q.dynamics for q in quantities):
        before = (*before, Own(udot), *w.forward)
        along = (*w.along, Own(udot.tangent()), w.balance)
    values, tangents = w.measuring(quantities, before, along)
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
    check = (Check(True),) if w.formula_pivots or any(q.pivots for q in quantities) else ()
    return w.pair(
        ("outputs", "output_sensitivities"),
        ("The outputs of the model.", "Outputs and their total derivative along seeds."),
        w.state,
        ["outputs"],
        (*zero, *before, *values, OUTPUTS, *copies),
        (
            *zero,
            *before,
            *zero_along,
            *along,
            *tangents,
            OUTPUTS,
            OUTPUTS.tangents(),
            *copies,
            *copies_along,
            *check,
        ),
    )


def switches(w: Shared) -> list[Procedure]:
    """Switching functions of the model, for integration over time."""
    model = w.system.model
    read: set[str] = set()
    for s in model.switches.found:
        read |= quantities_of(s)
    quantities = measured(w.system, read, ())
    energy = w.one("energy")
    sums = (Own(energy), Zero(energy)) if any(q.energy for q in quantities) else ()
    denergy = energy.tangent()
    sums_along = (Own(denergy), Zero(denergy)) if sums else ()
    along: tuple[Step, ...] = (*w.along, *w.turns)
    values, tangents = w.measuring(quantities, w.begin, along)
    return w.pair(
        ("switches", "switch_sensitivities"),
        ("The switching functions of the model.", "Switching functions and their total derivative along seeds."),
        w.state,
        ["switches"],
        (*sums, *w.begin, *values, SWITCHES),
        (*sums, *w.begin, *sums_along, *along, *tangents, SWITCHES, SWITCHES.tangents()),
    )


def driving_forces(w: Shared) -> list[Procedure]:
    """What prescribed motion takes."""
    udot, dudot, driving, ddriving, found, dfound = w.of(
        "udot", "dudot", "driving", "ddriving", "actuation", "dactuation"
    )
    before: tuple[Step, ...] = (*w.begin, Own(udot), *w.forward)
    return w.pair(
        ("driving_forces", "driving_force_sensitivities"),
        (
            "Generalised forces that prescribed motion takes.",
            "Generalised forces that prescribed motion takes, and their total derivative along seeds.",
        ),
        w.state,
        ["actuation"],
        (*before, Copy(found, driving)),
        (*before, *w.along, Own(dudot), w.balance, Copy(found, driving), Copy(dfound, ddriving)),
    )


def reactions_of(w: Shared) -> list[Procedure]:
    """What joints and loops transmit. Its derivatives take those of udot, and two sweeps over directions more."""
    names = ["reaction", *(["loop_reaction"] if w.loops else [])]
    wrenches = w.of(*names)
    udot = w.one("udot")
    before: tuple[Step, ...] = (*w.begin, Own(udot), *w.forward)
    along: tuple[Step, ...] = (*w.along, Own(udot.tangent()), w.balance)
    poses, turned = w.measuring([POSE], before, along)
    zero = tuple(map(Zero, wrenches[1:]))
    values = (*before, *poses, *run("motion", "transmitted"))
    return w.pair(
        ("reactions", "reaction_sensitivities"),
        (
            "Wrenches on links at their joints and on loops' end faces: moment, force; ground frame.",
            "Wrenches on links at their joints and on loops' end faces, and their total derivative along seeds.",
        ),
        w.state,
        names,
        (*zero, *values),
        (
            *zero,
            *values,
            *(Zero(a.tangent()) for a in wrenches[1:]),
            *along,
            *turned,
            *run("reaction_out", "reaction_in"),
        ),
    )
