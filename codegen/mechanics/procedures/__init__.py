"""What each function of a solver does, step by step: a file for each group of functions.

This is the list to read for what runs when; what the sweeps compute stands in `codegen.mechanics.sweeps`. An argument that a
model does not use does not exist: no ``inputs`` without inputs, no ``t`` without time, no ``p`` without parameters.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from ...program.procedure import Procedure
from ..structure.system import System
from .choice import UnknownFunctionError, asks_reactions, chosen
from .closing import closing, initial
from .dynamics import dynamics, jacobians, rates, state_rates
from .frames import frames_of
from .mass import inverse_dynamics, mass
from .measures import driving_forces, energies, outputs, reactions_of, switches
from .shared import Shared
from .swept import checked_backwards, swept_backwards, swept_together
from .transposed import backwards
from .words import OTHER_WIDTHS, OUTPUTS, SHAPES, SWITCHES, arrays

__all__ = [
    "OTHER_WIDTHS", "OUTPUTS", "SHAPES", "SWITCHES", "UnknownFunctionError", "arrays", "asks_reactions",
    "checked_backwards", "left_out", "procedures", "swept_backwards", "swept_together",
]  # fmt: skip

MOTIONS = ("state_rates", "state_rate_sensitivities")
"""Functions that only motions call, and without which there are none."""

FOUR = (4,)
"""Beside them, for motions with two to four directions, of the functions that integration calls."""

ALONG_MOTIONS = ("state_rate_sensitivities", "completion_sensitivities", "output_sensitivities", "switch_sensitivities")
"""These functions."""

IN_MODES = (
    "state_rates", "state_rate_sensitivities", "sensitivities_transposed", "outputs", "output_sensitivities",
    "output_sensitivities_transposed", "switches", "switch_sensitivities", "switch_sensitivities_transposed",
)  # fmt: skip
"""Functions that integration calls with the modes of switches."""

CLOSING_IN_MODES = ("closing_step", "completion", "completion_sensitivities", "completion_sensitivities_transposed")
"""Those that do where prescribed motion, which loops follow, has switches."""


def procedures(
    system: System,
    reactions: bool = False,
    functions: Collection[str] | None = None,
    frames: bool = False,
    moves: bool = True,
) -> tuple[Procedure, ...]:
    """The functions that a solver has, in the order of its header.

    Parameters
    ----------
    reactions : bool
        Reactions are among them; and their derivatives, unless `functions` are chosen, which name these.
    functions : collection of str, optional
        Those that are wanted, by their names, by those of members of a solver, or by `GROUPS`; left out: all, without reactions
        and frames.
    frames : bool
        Frames are among them.
    moves : bool
        Functions that only motions call are among them.

    Raises
    ------
    UnknownFunctionError
    """
    w = Shared(system)
    found = every(w, reactions or asks_reactions(functions))
    if frames or functions is not None:
        found += tuple(frames_of(w))
    if functions is not None:
        found = chosen(found, [*functions, *(["reactions"] if reactions else []), *(["frames"] if frames else [])])
    if not moves:
        found = without_motions(found, functions)
    found = switching(w, found)
    if all(p.name != ALONG_MOTIONS[0] for p in found):
        return found
    return tuple(replace(p, apart=FOUR) if p.name in ALONG_MOTIONS else p for p in found)


def without_motions(found: tuple[Procedure, ...], functions: Collection[str] | None) -> tuple[Procedure, ...]:
    """Functions of a solver whose scalar type motions are not integrated in."""
    kept = tuple(p for p in found if p.name not in MOTIONS)
    if functions is not None and len(kept) < len(found):
        raise UnknownFunctionError(
            "functions: motions are integrated in double precision, so that a solver in another scalar type has none; leave out "
            f"{', '.join(w for w in functions if w in ('motion', 'simulate', *MOTIONS))}, or generate with --scalar float64"
        )
    return kept


def switching(w: Shared, found: tuple[Procedure, ...]) -> tuple[Procedure, ...]:
    """Functions of a model, those of its switches among them where motions need them, and which take modes."""
    names = {p.name for p in found}
    if not w.system.model.switches.found or "state_rates" not in names:
        return found
    further = switches(w)[: None if w.system.model.switches.have_modes else 1]  # singular functions are looked at only
    if "sensitivities_transposed" in names:
        further += backwards(w, further)
    found += tuple(replace(p, internal=True) for p in further)
    if not w.system.model.switches.have_modes:
        return found
    modes = w.one("modes")
    switched = any(place.startswith("motion.") for s in w.system.model.switches.found for place in s.places)
    names = {*IN_MODES, *(CLOSING_IN_MODES if switched else ())}
    return tuple(replace(p, modes=modes) if p.name in names else p for p in found)


def left_out(system: System, kept: tuple[Procedure, ...]) -> list[str]:
    """What users call the functions that a solver could have but for the choice, reactions and frames apart."""
    names = {p.name for p in kept}
    return [p.called for p in every(Shared(system), False) if p.name not in names]


def every(w: Shared, reactions: bool) -> tuple[Procedure, ...]:
    """All functions that a solver of the system can have."""
    found = [*dynamics(w), jacobians(w), *rates(w), *state_rates(w)]
    if not w.loops:
        found += [*mass(w), *inverse_dynamics(w)]
    found += energies(w)
    if w.motions:
        found += driving_forces(w)
    if reactions:
        found += reactions_of(w)
    if w.loops:
        found += closing(w)
    if w.system.model.initial_depends_on_parameters:
        found += initial(w)
    if w.system.model.outputs:
        found += outputs(w)
    return (*found, *backwards(w, found))
