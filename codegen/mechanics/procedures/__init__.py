"""The steps of each function of a solver: one file for each group of functions.

Read this to see what runs when; `codegen.mechanics.sweeps` lists the sweeps. A model that has no inputs has functions without an
argument ``inputs``; the same holds for ``t`` and ``p``.
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
from .second_order import GRADIENT_TANGENTS, SECOND_ORDER, of_motions, second_order
from .second_order_measures import SWITCH_PRODUCTS
from .shared import Shared
from .swept import check_names, checked_backwards, swept_backwards, swept_together
from .transposed import backwards
from .words import OTHER_WIDTHS, OUTPUTS, SHAPES, SWITCHES, arrays

__all__ = [
    "GRADIENT_TANGENTS", "OTHER_WIDTHS", "OUTPUTS", "SECOND_ORDER", "SHAPES", "SWITCHES", "SWITCH_PRODUCTS",
    "UnknownFunctionError", "arrays", "asks_reactions", "check_names", "checked_backwards", "left_out", "procedures",
    "swept_backwards", "swept_together",
]  # fmt: skip

MOTIONS = ("state_rates", "state_rate_sensitivities")
"""Functions that only motions call; a solver without them integrates no motions."""

FOUR = (4,)
"""Number of directions for which functions that integration calls have an additional variant; motions with two to four
directions use it."""

ALONG_MOTIONS = ("state_rate_sensitivities", "completion_sensitivities", "output_sensitivities", "switch_sensitivities")
"""Functions that also have a variant for `FOUR` directions."""

IN_MODES = (
    "state_rates", "state_rate_sensitivities", "sensitivities_transposed", "outputs", "output_sensitivities",
    "output_sensitivities_transposed", "switches", "switch_sensitivities", "switch_sensitivities_transposed", "gradient_tangents",
    "output_hessian_products", "switch_hessian_products",
)  # fmt: skip
"""Functions to which integration passes the modes of switches."""

CLOSING_IN_MODES = ("closing_step", "completion", "completion_sensitivities", "completion_sensitivities_transposed")
"""Functions that also receive the modes if a prescribed motion that affects loops has switches."""


def procedures(
    system: System,
    reactions: bool = False,
    functions: Collection[str] | None = None,
    frames: bool = False,
    moves: bool = True,
) -> tuple[Procedure, ...]:
    """The functions of a solver, in the order of its header.

    Parameters
    ----------
    reactions : bool
        Includes reactions and, unless `functions` are given, their derivatives.
    functions : collection of str, optional
        The functions to include, by their names, the names of solver members, or the words in `GROUPS`; by default all except
        reactions, frames and products with second derivatives.
    frames : bool
        Includes frames.
    moves : bool
        Includes the functions that only motions call.

    Raises
    ------
    UnknownFunctionError
    """
    w = Shared(system)
    found = every(w, reactions or asks_reactions(functions))
    if frames or functions is not None:
        found += tuple(frames_of(w))
    if functions is not None:
        found += second_order(w, functions)
        found = chosen(found, [*functions, *(["reactions"] if reactions else []), *(["frames"] if frames else [])])
    if not moves:
        found = without_motions(found, functions)
    found = switching(w, of_motions(w, found))
    if all(p.name != ALONG_MOTIONS[0] for p in found):
        return found
    return tuple(replace(p, apart=FOUR) if p.name in ALONG_MOTIONS else p for p in found)


def without_motions(found: tuple[Procedure, ...], functions: Collection[str] | None) -> tuple[Procedure, ...]:
    """The functions of a solver that cannot integrate motions because of its scalar type."""
    kept = tuple(p for p in found if p.name not in MOTIONS)
    if functions is not None and len(kept) < len(found):
        raise UnknownFunctionError(
            "functions: motions are integrated in double precision only; leave out "
            f"{', '.join(w for w in functions if w in ('motion', 'simulate', *MOTIONS))}, or generate with --scalar float64"
        )
    return kept


def switching(w: Shared, found: tuple[Procedure, ...]) -> tuple[Procedure, ...]:
    """The given functions, and the switching functions if motions need them. Functions that depend on the modes of
    switches get an argument for these modes."""
    names = {p.name for p in found}
    if not w.system.model.switches.found or "state_rates" not in names:
        return found
    further = switches(w)[
        : None if w.system.model.switches.have_modes else 1
    ]  # models without modes need no derivatives of switching functions
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
    """The user's names of the functions that were not selected; reactions and frames are not counted."""
    names = {p.name for p in kept}
    return [p.called for p in every(Shared(system), False) if p.name not in names]


def every(w: Shared, reactions: bool) -> tuple[Procedure, ...]:
    """All functions that a solver of the system can have, except functions for frames."""
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
