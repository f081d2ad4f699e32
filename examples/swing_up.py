"""Swing-up of a cart-pole by a force on the cart, with minimal integral of the squared force.

    python examples/swing_up.py [--folder examples/figures]

The force is a polyline through 26 values over 2.5 s, which are variables bounded by 20 N. The four outputs at the end, position,
angle and their rates, are constraints with exact Jacobians. SLSQP runs one motion with all gradients for each point.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pictures import BLACK, BLUE, GREY, ORANGE, figure, folder_asked, solver_of, write

import ordernm
from ordernm.runtime import Final, Integral

SECONDS, VALUES, MOST = 2.5, 26, 20.0
"""Final time, s; number of values of the force; limit of the force, N."""

AIM = {"place": 0.0, "angle": np.pi, "speed": 0.0, "spin": 0.0}


def swing_up_problem(solver: Any, method: str = "auto") -> tuple[ordernm.Objective, Any]:
    """The effort, N^2 s, as objective (a fiftieth of it, so that it is of order one), and the final state as a constraint."""
    times = np.linspace(0, SECONDS, VALUES)
    push = 3.0 * np.sin(2 * np.pi * times / 1.3)
    f = ordernm.objective(
        solver, SECONDS, Integral("effort"), {"inputs.push": (-MOST, MOST)}, weights=[0.02], inputs=(times, push, "linear"),
        method=method, rtol=1e-8, atol=1e-8,
    )  # fmt: skip
    aim = list(AIM.values())
    return f, f.constraint([Final(name) for name in AIM], aim, aim)


def swing_up(solver: Any, maxiter: int = 300) -> tuple[ordernm.Objective, Any]:
    f, there = swing_up_problem(solver)
    return f, ordernm.optimize(f, "SLSQP", constraints=there, maxiter=maxiter)


def draw(f: ordernm.Objective, best: Any, folder: Path | None = None) -> Path:
    """Figure: force, angle and position, the cart and its pole over time, and the progress of the search."""
    made, axes = figure(9.0, 5.6, 2, 2)
    (force, states), (poses, search) = axes
    t = np.linspace(0, SECONDS, 251)
    motion, times = f.simulate(best.x, t), np.linspace(0, SECONDS, VALUES)
    values = f.variables.values(best.x)
    force.plot(times, f.variables.values(f.x0), color=GREY, linestyle=(0, (5, 2)), label="at the start")
    force.plot(times, values, "o-", color=BLUE, markersize=3, label="optimised")
    force.set_title("Force on the cart (N)", loc="left", fontsize=9)
    states.plot(t, motion["angle"], color=ORANGE, label="angle (rad)")
    states.plot(t, motion["place"], color=BLUE, linestyle=(0, (5, 2)), label="place (m)")
    states.axhline(np.pi, color=BLACK, linewidth=0.6, linestyle=(0, (1, 1.2)))
    states.set_title("The pole hangs at 0 and stands at π", loc="left", fontsize=9)
    for axis in (force, states):
        axis.set_xlabel("t (s)")
        axis.legend(fontsize=8)
    shown = range(0, 251, 10)
    for i in shown:
        shade = str(0.85 - 0.85 * i / 250)
        place = motion["place"][i]
        poses.plot([place, motion["tip_x"][i]], [0, motion["tip_z"][i]], color=shade, linewidth=1.2)
        poses.plot(motion["tip_x"][i], motion["tip_z"][i], "o", color=shade, markersize=4)
    poses.plot(motion["tip_x"], motion["tip_z"], color=ORANGE, linewidth=0.8)
    poses.set_aspect("equal", adjustable="datalim")
    poses.set_xlabel("x (m)")
    poses.set_title("Poles every tenth of a second, later ones darker", loc="left", fontsize=9)
    number = np.arange(1, len(f.history) + 1)
    misses = [np.abs(e.functionals[1:] - list(AIM.values())).max() for e in f.history]
    search.semilogy(number, [e.functionals[0] for e in f.history], color=BLUE, label="effort (N² s)")
    search.semilogy(
        number, np.maximum(misses, 1e-12), color=ORANGE, linewidth=0.8, label="the aim is missed by at most"
    )
    search.set_xlabel("motions")
    search.legend(fontsize=8, loc="lower left")
    search.set_title("The search", loc="left", fontsize=9)
    return write(made, "swing_up", folder)


def main() -> None:
    folder = folder_asked(__doc__)
    f, best = swing_up(solver_of("swing_up"))
    print(f)
    print(best.message, best.outcome, sep="\n")
    print(draw(f, best, folder))


if __name__ == "__main__":
    main()
