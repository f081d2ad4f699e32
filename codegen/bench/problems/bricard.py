"""A04 of the IFToMM library of multibody benchmarks: Bricard's mechanism, one loop of six hinges with one condition too many."""

from __future__ import annotations

from ...measure.models import example
from ..problem import Goal, Motion, tolerances

BRICARD = Motion(
    name="bricard",
    title="A04, Bricard's mechanism, 10 s",
    text=lambda: example("bricard"),
    end=10.0,
    quantities=("x", "y", "z"),
    exact=lambda: (0.9997309873038327, -0.9999999638258171, -0.00026897651225189534),
    source="computed along the closure curve (1 + sin alpha)(1 + sin beta) = 1 by its polar angle: energies by the kinematics of "
    "the rods, 1024 Fourier coefficients, DOP853 at 1e-13; the loops close to 3e-15, energy drifts by 6e-13 J",
    settings=tolerances("dop853", 5, 14) + tolerances("radau", 5, 13),
    quick=tolerances("dop853", 8, 8) + tolerances("radau", 6, 6),
    within=1e-5,
    goals=(Goal(1e-9), Goal(1e-8, seconds=0.01)),
)
PROBLEMS = (BRICARD,)
