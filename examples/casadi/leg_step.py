"""The swing of a five-bar leg from one stance to the next with least effort, for the lengths given and for the best lengths.

    python examples/casadi/leg_step.py

Both thighs turn by 0.7 rad in 0.4 s, from rest to rest. The lengths of thighs and shanks are variables of the same optimisation
as the torques of the motors, with exact Hessians through the closed loop.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import casadi

import ordernm
import ordernm.casadi

HERE = Path(__file__).parent
FUNCTIONS = "accelerations,sensitivities,gradients,hessian_products"
SECONDS = 0.4
START = {"q.left_thigh": -2.9, "q.right_thigh": -0.9, "u.left_thigh": 0.0, "u.right_thigh": 0.0}
END = {"q.left_thigh": -2.2, "q.right_thigh": -0.2, "u.left_thigh": 0.0, "u.right_thigh": 0.0}


def effort(x: Any) -> Any:
    """The sum of squared torques."""
    return casadi.sumsqr(x["inputs"])


def solved(solver: Any, **more: Any) -> Any:
    return ordernm.casadi.collocation(solver, SECONDS, 10, cost=effort, start=START, end=END, **more).solve()


def main() -> tuple[Any, Any]:
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder, "five_bar_leg")
        ordernm.generate(HERE / "five_bar_leg.yaml", package, functions=FUNCTIONS, compile=False)
        solver = ordernm.load(package)
        given = solved(solver)
        best = solved(solver, design={"thigh": (0.15, 0.25), "shank": (0.3, 0.4)})
    print(f"as given: {given.value:.4f} N^2 m^2 s, {given.iterations} iterations")
    for name, slope in given.gradients.items():
        print(f"  by {name}: {slope:.4g}")
    lengths = ", ".join(f"{n} = {x:.3f} m" for n, x in best.design.items())
    print(f"with {lengths}: {best.value:.4f} N^2 m^2 s, {best.iterations} iterations")
    return given, best


if __name__ == "__main__":
    main()
