"""Energies of the whole model, J."""

from __future__ import annotations

from .output import Measure


class KineticEnergy(Measure):
    """Of all bodies."""

    name = "kinetic_energy"
    unit = "J"


class PotentialEnergy(Measure):
    """Of gravity, zero at the ground's origin, and of force elements."""

    name = "potential_energy"
    unit = "J"
