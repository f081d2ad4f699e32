"""Quantities of all links that outputs and force elements may read; a procedure computes each at most once."""

from __future__ import annotations

from collections.abc import Iterable

from ..program.procedure import Formulas, Run, Step
from ..records import dataclass
from .structure.system import System
from .sweeps import SWEEP


def run(*sweeps: str) -> tuple[Run, ...]:
    """Steps that run the named sweeps one after another."""
    return tuple(Run(s, SWEEP[s].lanes) for s in sweeps)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity of all links, and the steps that compute it.

    Attributes
    ----------
    name : str
    values, tangents : tuple of Step
        Steps for the quantity, and for its tangent. The steps for the tangent need complete seeds.
    energy : bool
        The steps add to the energies.
    pivots : bool
        The steps for the tangent may meet a zero pivot.
    sums : tuple of str
        Arrays to which the steps add; they must begin with zeros.
    dynamics : bool
        The steps need udot, and its tangent.
    """

    name: str
    values: tuple[Step, ...]
    tangents: tuple[Step, ...]
    energy: bool = False
    pivots: bool = False
    sums: tuple[str, ...] = ()
    dynamics: bool = False


POSE = Quantity("pose", run("pose"), run("pose_tangents"))
"""Positions and attitudes in the ground frame."""
VELOCITY = Quantity("velocity", run("velocities"), run("velocity_tangents"))
"""Velocities for force elements, before the forward dynamics."""
KINETIC = Quantity("kinetic", run("kinetic"), run("kinetic_tangents"), energy=True)
"""Velocities and kinetic energy."""
ACCELERATION = Quantity("acceleration", run("link_accelerations"), run("link_acceleration_tangents"), dynamics=True)
"""Accelerations of links relative to the ground."""
MASSES = Quantity("masses", run("masses"), run("mass_tangents"), sums=("masses",))
"""Mass and first moment of the system, from the poses of links."""
MOMENTA = Quantity("momenta", run("momenta"), run("momentum_tangents"), sums=("momenta",))
"""Momentum of the system, from the poses and velocities of links."""
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
"""Coefficients of force elements that have an energy, and of those that have none."""
ELEMENTS = Quantity(
    "elements",
    (COEFFICIENTS, *run("element_energy")),
    (COEFFICIENTS, COEFFICIENTS.tangents(), *run("element_energy_tangents")),
    energy=True,
    pivots=True,
)
"""Potential energy of force elements, given positions and attitudes."""

RATES = Quantity("rates", run("rates"), run("rate_tangents"))
"""Time derivatives of the coordinates."""

QUANTITIES = {q.name: q for q in (POSE, KINETIC, ACCELERATION, MASSES, MOMENTA)}
"""Quantities that outputs may read, by name, in the order of computation."""

ENERGIES = ("kinetic_energy", "potential_energy")
"""The two energies, in the order of the array ``energy``."""


def measured(system: System, read: Iterable[str], energies: Iterable[int]) -> list[Quantity]:
    """The named quantities and the quantities that the energies need, in the order of computation.

    Parameters
    ----------
    read : iterable of str
        Names of `QUANTITIES`.
    energies : iterable of int
        Indices in `ENERGIES`.
    """
    wanted = set(read)
    stored = any(e.element.has_energy for e in system.elements)
    potential = [*([GRAVITY] if system.model.gravity is not None else []), *([ELEMENTS] if stored else [])]
    for energy in energies:
        if ENERGIES[energy] == "kinetic_energy":
            wanted.add(KINETIC.name)
        else:
            wanted |= {q.name for q in (*potential, *([POSE] if stored else []))}
    assert wanted <= {*QUANTITIES, *(q.name for q in potential)}, wanted
    return [q for q in (*QUANTITIES.values(), *potential) if q.name in wanted]
