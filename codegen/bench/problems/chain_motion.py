"""CHAIN(4) for 5 s with its derivatives by the length of the rods: what `ordernm bench --peers` compares programs on."""

from __future__ import annotations

from ...measure.models import changed
from ..problem import Motion, tolerances

RODS = 4
ANGLES = (-0.23433117203060152193, 0.028574050956611388793, -0.13486517489853769978, 0.32255523538455153714)
BY_LENGTH = (0.07334979262674368285, -1.2520856904143540374, -0.25336031277269753588, 0.7743732997239442641)

CHAIN_MOTION = Motion(
    name="chain_motion",
    title="a chain of four rods, 5 s",
    text=lambda: changed("chain", "{n: 12,", f"{{n: {RODS},"),
    end=5.0,
    quantities=tuple(f"q.link_{k}" for k in range(1, RODS + 1)),
    exact=lambda: ANGLES,
    source="computed by Gragg, Bulirsch and Stoer's extrapolation of order 16 with an articulated-body algorithm written by "
    "hand, on dual 80-bit numbers, 100 steps; 60 steps agree to 6e-17 in the angles and 3e-16 in their derivatives",
    settings=tolerances("dop853", 5, 13) + tolerances("radau", 5, 11),
    quick=tolerances("dop853", 8, 8),
    within=1e-8,
    derivatives=lambda: (BY_LENGTH,),
    sensitivities=("L",),
)
PROBLEMS = (CHAIN_MOTION,)
