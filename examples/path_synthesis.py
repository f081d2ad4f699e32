"""Path synthesis: links, pivots and coupler point of a four-bar whose coupler point passes through eighteen points.

    python examples/path_synthesis.py [--folder examples/figures]

The points are those of A. Kunjur and S. Krishnamurty (1997), one for each 20 degrees of the crank. A heavy flywheel keeps the
crank of examples/coupler.yaml at one revolution per second, so times replace angles. There are ten variables. If the links of a
design do not close, the motion fails, and the optimiser steps back. The best result of several starts, drawn from a fixed seed,
is kept.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pictures import BLACK, BLUE, GREY, ORANGE, figure, folder_asked, solver_of, write

import ordernm
from ordernm.runtime import LeastSquares

X = [0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0.02, 0.0, 0.0, 0.03, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.6]
Y = [1.1, 1.1, 1.1, 1.0, 0.9, 0.75, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.3, 0.4, 0.5, 0.7, 0.9, 1.0]
TIMES = np.arange(18) / 18

VARIABLES = {
    "crank": (0.05, 1.0), "coupler": (0.2, 3.0), "rocker": (0.2, 3.0), "along": (-2.0, 2.0), "across": (-2.0, 2.0),
    "A_x": (-2.0, 2.0), "A_y": (-2.0, 2.0), "B_x": (-2.0, 2.0), "B_y": (-2.0, 2.0), "q0.crank": (-4.0, 4.0),
}  # fmt: skip

TURNS = {"flywheel": 1e6, "friction": 0.0}
"""The flywheel keeps the crank's speed constant."""


def path_objective(solver: Any, method: str = "auto") -> ordernm.Objective:
    """Half the sum of squared distances from the points, m^2."""
    samples = LeastSquares(TIMES, {"x": X, "y": Y})
    return ordernm.objective(solver, TIMES[-1], samples, VARIABLES, p=TURNS, method=method, most_steps=3000)


def synthesise(solver: Any, starts: int = 4, maxiter: int = 400) -> tuple[ordernm.Objective, Any]:
    """The best four-bar of several searches."""
    f = path_objective(solver)
    rng = np.random.default_rng(1)
    best = None
    for i in range(starts):
        x0 = f.x0 + (0.15 * rng.uniform(-1, 1, len(f.x0)) if i else 0.0)
        if not np.isfinite(f(x0)):
            continue
        found = ordernm.optimize(f, "L-BFGS-B", x0=x0, maxiter=maxiter, ftol=1e-12, gtol=1e-7)
        if best is None or found.fun < best.fun:
            best = found
    return f, best


def draw(f: ordernm.Objective, best: Any, folder: Path | None = None) -> Path:
    """Figure: points, curves before and after, the linkage at the first point, and the progress of the searches."""
    made, ((left, right),) = figure(9.0, 4.2, across=2, width_ratios=[1.25, 1])
    t = np.linspace(0, 1, 361)
    before, after = f.simulate(f.x0, t), f.simulate(best.x, t)
    left.plot(before["x"], before["y"], color=GREY, linestyle=(0, (5, 2)), label="at the start")
    left.plot(after["x"], after["y"], color=BLUE, label="optimised")
    left.plot(X, Y, "o", color=BLACK, markersize=4.5, markerfacecolor="white", label="places")
    p = f.values(best.x)
    theta, phi = after["q.crank"][0], after["q.crank"][0] + after["q.coupler"][0]
    A, B = np.array([p["A_x"], p["A_y"]]), np.array([p["B_x"], p["B_y"]])
    C = A + p["crank"] * np.array([np.cos(theta), np.sin(theta)])
    e = np.array([np.cos(phi), np.sin(phi)])
    D, P = C + p["coupler"] * e, C + p["along"] * e + p["across"] * np.array([-e[1], e[0]])
    left.plot(*np.transpose([A, C]), color=ORANGE, linewidth=2.5)
    left.plot(*np.transpose([D, B]), color=ORANGE, linewidth=2.5)
    left.fill(*np.transpose([C, D, P]), facecolor=ORANGE, alpha=0.15, edgecolor=ORANGE, linewidth=1.2)
    left.plot(*np.transpose([A, B]), "^", color=BLACK, markersize=8)
    left.plot(*np.transpose([C, D]), "o", color=ORANGE, markersize=4)
    left.set_aspect("equal", adjustable="datalim")
    left.set_xlabel("x (m)")
    left.set_ylabel("y (m)")
    left.set_title("The coupler point, and the linkage at its first place", loc="left", fontsize=9)
    left.legend(loc="upper right", fontsize=8)
    values = np.array([e.value for e in f.history])
    lowest = np.minimum.accumulate(values)
    right.semilogy(
        np.arange(1, len(values) + 1), values, ".", color=GREY, markersize=3, label="a motion with its gradient"
    )
    right.semilogy(np.arange(1, len(values) + 1), lowest, color=BLUE, label="the lowest so far")
    right.set_xlabel("motions")
    right.set_title("half the sum of squared distances (m²)", loc="left", fontsize=9)
    right.set_ylim(top=1e3)
    right.legend(loc="upper right", fontsize=8)
    return write(made, "path_synthesis", folder)


def main() -> None:
    folder = folder_asked(__doc__)
    f, best = synthesise(solver_of("coupler"))
    print(f)
    print(best.outcome)
    print(draw(f, best, folder))


if __name__ == "__main__":
    main()
