"""What sweeps make known of all links, for outputs and force elements to ask for; procedures run what was asked for, once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..program.procedure import Formulas, Run, Step, walk
from .structure.kinds import System
from .sweeps import SWEEP


def run(*sweeps: str) -> tuple[Run, ...]:
    """Sweeps one after the other."""
    return tuple(Run(s, SWEEP[s].lanes) for s in sweeps)


@dataclass(frozen=True, slots=True)
class Quantity:
    """Something that is known of all links once some steps were taken.

    Attributes
    ----------
    name : str
    values, tangents : tuple of Step
        They compute it; together with its tangent. The latter take a state and seeds that are complete.
    energy : bool
        They add to the energies.
    pivots : bool
        The tangents may meet a zero pivot.
    """

    name: str
    values: tuple[Step, ...]
    tangents: tuple[Step, ...]
    energy: bool = False
    pivots: bool = False


POSE = Quantity("pose", run("pose"), run("pose_tangents"))
"""Positions and attitudes in the ground frame."""
VELOCITY = Quantity("velocity", run("velocities"), run("velocity_tangents"))
"""Velocities, for forces: before the forward dynamics."""
KINETIC = Quantity("kinetic", run("kinetic"), run("kinetic_tangents"), energy=True)
"""Velocities and kinetic energy."""
_OF_GRAVITY = Formulas("potential_of_gravity", ("energy",))
GRAVITY = Quantity(
    "gravity",
    (*run("moments"), _OF_GRAVITY),
    (*run("moment_tangents"), _OF_GRAVITY, _OF_GRAVITY.tangents()),
    energy=True,
)
"""Potential energy of gravity."""
COEFFICIENTS = Formulas("element_coefficients", ("coefficient",))
DRIVES = Formulas("drives", ("drive",))
"""Coefficients of force elements, of those with an energy and of the others."""
ELEMENTS = Quantity(
    "elements",
    (COEFFICIENTS, *run("element_energy")),
    (COEFFICIENTS, COEFFICIENTS.tangents(), *run("element_energy_tangents")),
    energy=True,
    pivots=True,
)
"""Potential energy of force elements, where positions and attitudes are known."""

MEASURES: dict[str, tuple[Quantity, ...]] = {
    "value": (),
    "position": (POSE,),
    "velocity": (POSE, KINETIC),
    "kinetic_energy": (KINETIC,),
}
"""What each measure of an output is a function of; for the potential energy see `measured`."""


def measured(system: System, measures: Iterable[str]) -> list[Quantity]:
    """The quantities that measures are functions of, in the order in which they are computed."""
    wanted: set[str] = set()
    stored = any(e.element.has_energy for e in system.elements)
    potential = [*([GRAVITY] if system.model.gravity is not None else []), *([ELEMENTS] if stored else [])]
    for measure in measures:
        if measure == "potential_energy":
            wanted |= {q.name for q in (*potential, *([POSE] if stored else []))}
        else:
            wanted |= {q.name for q in MEASURES[measure]}
    return [q for q in (POSE, KINETIC, *potential) if q.name in wanted]


def missing(quantities: Iterable[Quantity], taken: tuple[Step, ...]) -> tuple[Step, ...]:
    """Steps for what some steps have not computed yet."""
    known = set(walk(taken))
    return tuple(s for q in quantities if not known.issuperset(q.values) for s in q.values)
