"""Hard points of a double wishbone on a bump: their effect on camber and toe, and a design with a given camber gain.

    python examples/suspension.py [--folder examples/figures]

The wheel of examples/double_wishbone.yaml rolls over a bump of 60 mm. First, one adjoint integration gives the gradient of the
camber on the bump with respect to all 33 coordinates of hard points. Then the heights of five points are optimised, such that at
all times the camber is -18 degrees per metre of wheel travel and the toe does not change. `combine` reduces these 60 functionals
to one number.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pictures import BLUE, GREY, ORANGE, figure, folder_asked, solver_of, write

import ordernm
from ordernm.runtime import At

SECONDS, PEAK = 0.4, 0.21
ROAD = (np.array([0.0, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4]), np.array([0.0, 0.0, 0.03, 0.06, 0.03, 0.0, 0.0]))
"""Times, s, and heights, m."""

GAIN = np.radians(-18.0)
"""Camber per metre of wheel travel, rad/m."""

MATTERS = np.radians(0.05)
"""Significant deviation of an angle, rad."""

TIMES = np.linspace(0.12, 0.38, 20)
VARIED = ("upper_ball_z", "upper_front_z", "upper_rear_z", "tie_inner_z", "tie_outer_z")
WAY = 0.03
"""Largest shift of a point, m."""


def bump() -> Any:
    """The inputs bump and force over time."""
    return ROAD[0], np.column_stack([ROAD[1], np.zeros(len(ROAD[1]))]), "linear"


def hard_points(solver: Any) -> list[str]:
    ends = ("_x", "_y", "_z")
    return [n for n in solver.parameter_names if n.endswith(ends)]


def camber_gradient(solver: Any, method: str = "auto") -> Any:
    """Camber on the bump with derivatives with respect to all coordinates of hard points; `Judged`."""
    return solver.judge(SECONDS, At("camber", PEAK), inputs=bump(), wrt=hard_points(solver), method=method)


def misses(values: Any) -> tuple[float, Any]:
    """Half the sum of squared errors of camber and toe, and its derivatives with respect to camber, toe and travel at all
    times."""
    camber, toe, travel = values.reshape(3, -1)
    off, steer = (camber - GAIN * travel) / MATTERS, toe / MATTERS
    value = 0.5 * (off @ off + steer @ steer) / len(off)
    return value, np.concatenate([off, steer, -GAIN * off]) / MATTERS / len(off)


def camber_objective(solver: Any, method: str = "auto") -> ordernm.Objective:
    wanted = [At(output, t) for output in ("camber", "toe", "travel") for t in TIMES]
    now = dict(zip(solver.parameter_names, solver.parameters, strict=True))
    variables = {name: (now[name] - WAY, now[name] + WAY) for name in VARIED}
    return ordernm.objective(solver, SECONDS, wanted, variables, combine=misses, inputs=bump(), method=method)


def design(solver: Any, maxiter: int = 100) -> tuple[ordernm.Objective, Any]:
    f = camber_objective(solver)
    return f, ordernm.optimize(f, "L-BFGS-B", maxiter=maxiter)


def draw(solver: Any, f: ordernm.Objective, best: Any, folder: Path | None = None) -> Path:
    """Figure: gradient by hard points; camber and toe over the wheel's travel, before and after."""
    made, (axes,) = figure(9.0, 4.4, across=3, width_ratios=[1.3, 1, 1])
    bars, camber, toe = axes
    found = np.degrees(camber_gradient(solver).gradients[0]) * 1e-3
    names = hard_points(solver)
    order = np.argsort(-np.abs(found), kind="stable")[:14]
    places = np.arange(len(order))[::-1]
    bars.barh(places, found[order], 0.6, color=BLUE)
    bars.set_yticks(places, [names[i] for i in order], fontsize=8)
    bars.set_title("Camber on the bump (degrees)\nby hard points (mm)", loc="left", fontsize=9)
    t = np.linspace(0, SECONDS, 401)
    before, after = f.simulate(f.x0, t), f.simulate(best.x, t)
    for axis, output in ((camber, "camber"), (toe, "toe")):
        axis.plot(np.degrees(before[output]), 1e3 * before["travel"], color=GREY, linestyle=(0, (5, 2)), label="before")
        axis.plot(np.degrees(after[output]), 1e3 * after["travel"], color=BLUE, label="after")
        axis.set_xlabel("degrees")
        axis.set_title(f"{output.capitalize()}, over the\nwheel's way up (mm)", loc="left", fontsize=9)
    way = np.array([-5.0, 60.0])
    camber.plot(np.degrees(GAIN) * way * 1e-3, way, color=ORANGE, linestyle=(0, (1, 1.2)), label="wanted")
    camber.legend(fontsize=8, loc="lower left")
    return write(made, "suspension", folder)


def main() -> None:
    folder = folder_asked(__doc__)
    solver = solver_of("double_wishbone")
    forward, adjoint = (camber_gradient(solver, method).gradients for method in ("forward", "adjoint"))
    print(f"forward and adjoint differ by {np.abs(forward - adjoint).max() / np.abs(forward).max():.1e}")
    f, best = design(solver)
    print(f)
    print(
        best.message, *repr(best.outcome).splitlines()[:1], *repr(best.outcome).splitlines()[-len(VARIED) :], sep="\n"
    )
    print(draw(solver, f, best, folder))


if __name__ == "__main__":
    main()
