"""Andrews' squeezing mechanism (Test Set for IVP Solvers; A03 of the IFToMM library): seven bodies, three loops, 0.03 s."""

from __future__ import annotations

from ...measure.models import example
from ..problem import Goal, Motion, Setting, tolerances

ANGLES = (
    15.810771195153704691, -15.756371058411837046, 0.040822240119646751159, -0.53473011634207794399, 0.52440996587995403308,
    0.53473011634207770118, 1.0480807410419377723,
)  # fmt: skip
"""beta, Theta, gamma, Phi, delta, Omega, epsilon at 0.03 s, rad."""

ANDREWS = Motion(
    name="andrews",
    title="Andrews' squeezing mechanism, 0.03 s",
    text=lambda: example("andrews"),
    end=0.03,
    quantities=tuple(f"q.k{i}" for i in range(1, 8)),
    exact=lambda: ANGLES,
    source="recomputed: Gragg, Bulirsch and Stoer's extrapolation of order 16 on the equations of index 1 of the Test Set "
    "for IVP Solvers, in 80-bit numbers, 600 steps; 300 steps agree to 1e-13, the energy balance holds to 9e-16 J. The 16 digits "
    "that the Test Set prints are right to about 1e-10",
    settings=(*tolerances("dop853", 5, 14), Setting("dop853", 7e-14, 7e-14), *tolerances("radau", 5, 13)),
    quick=tolerances("dop853", 9, 9) + tolerances("radau", 8, 8),
    within=1e-5,
    goals=(Goal(1e-12, evaluations=3500), Goal(1e-10, seconds=0.01)),
)
PROBLEMS = (ANDREWS,)
