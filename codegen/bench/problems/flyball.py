"""A05 of the IFToMM library of multibody benchmarks: a stiff flyball governor, rates from -7403 to 7i per second."""

from __future__ import annotations

from ...measure.models import example
from ..problem import Goal, Motion, tolerances

FLYBALL = Motion(
    name="flyball",
    title="A05, a stiff flyball governor, 10 s",
    text=lambda: example("flyball"),
    end=10.0,
    quantities=("height",),
    exact=lambda: (0.6196229170613666,),
    source="computed for the two coordinates of the symmetric motion, with its momentum about the shaft kept: DOP853 at 1e-11 "
    "(412 000 evaluations); Radau at 1e-11 agrees to 8 digits",
    settings=tolerances("dop853", 5, 12) + tolerances("radau", 5, 13),
    quick=tolerances("radau", 7, 7),
    within=1e-5,
    goals=(Goal(1e-7),),
)
PROBLEMS = (FLYBALL,)
