"""What sweeps make known of all links, for outputs and force elements to ask for; procedures run what was asked for, once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
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


@dataclass(frozen=True, slots=True)
class Element:
    """What a sort of force element asks for and adds.

    Attributes
    ----------
    name : str
    present : callable (System) -> bool
    forces, tangents : tuple of Step
        From coefficients and motion of links to forces on links, and the tangents of these.
    needs, energy_needs : tuple of Quantity
        What the forces and the potential energy are functions of.
    energy : Quantity
        Its potential energy.
    """

    name: str
    present: Callable[[System], bool]
    coefficients: Formulas
    forces: tuple[Run, ...]
    tangents: tuple[Run, ...]
    needs: tuple[Quantity, ...]
    energy: Quantity
    energy_needs: tuple[Quantity, ...]


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
_OF_SPRINGS = Formulas("spring_coefficients", ("coefficient",))
SPRINGS = Element(
    "spring",
    lambda system: bool(system.model.springs),
    _OF_SPRINGS,
    run("clear", "springs"),
    run("clear_tangents", "spring_tangents"),
    (POSE, VELOCITY),
    Quantity(
        "springs",
        (_OF_SPRINGS, *run("spring_energy")),
        (_OF_SPRINGS, _OF_SPRINGS.tangents(), *run("spring_energy_tangents")),
        energy=True,
        pivots=True,
    ),
    (POSE,),
)
ELEMENTS = (SPRINGS,)
"""All sorts of force elements."""

MEASURES: dict[str, tuple[Quantity, ...]] = {
    "value": (),
    "position": (POSE,),
    "velocity": (POSE, KINETIC),
    "kinetic_energy": (KINETIC,),
}
"""What each measure of an output is a function of; for the potential energy see `measured`."""


def elements(system: System) -> list[Element]:
    """The sorts of force elements that a model has."""
    return [e for e in ELEMENTS if e.present(system)]


def measured(system: System, measures: Iterable[str]) -> list[Quantity]:
    """The quantities that measures are functions of, in the order in which they are computed."""
    wanted: set[str] = set()
    potential = [*([GRAVITY] if system.model.gravity is not None else []), *(e.energy for e in elements(system))]
    for measure in measures:
        if measure == "potential_energy":
            of_elements = [q for e in elements(system) for q in e.energy_needs]
            wanted |= {q.name for q in (*potential, *of_elements)}
        else:
            wanted |= {q.name for q in MEASURES[measure]}
    return [q for q in (POSE, KINETIC, *potential) if q.name in wanted]


def missing(quantities: Iterable[Quantity], taken: tuple[Step, ...]) -> tuple[Step, ...]:
    """Steps for what some steps have not computed yet."""
    known = set(walk(taken))
    return tuple(s for q in quantities if not known.issuperset(q.values) for s in q.values)
