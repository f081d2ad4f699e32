"""An excavator swings its load to the side and lifts it with minimal work of its cylinders and its swing motor.

    python examples/excavator_lift.py [--folder examples/figures]

The four inputs of examples/excavator.yaml are the torque of the swing motor and the forces of three cylinders. Each is a polyline
through nine values over 4 s, so there are 36 variables, bounded by the machine's limits. The motion starts at rest and ends with
at most 50 J of kinetic energy (an inequality), with the teeth at a given position and the bucket's cylinder at its initial length
(equations for four outputs). The work that does not lift the load is lost in the throttled oil. The four loops stay closed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pictures import BLUE, GREEN, GREY, ORANGE, figure, folder_asked, solver_of, write

import ordernm
from ordernm.runtime import Final, Integral

SECONDS, VALUES = 4.0, 9
PLACE = {"reach": 2.5, "side": 5.5, "height": 3.0, "length_bucket": 2.2427}
"""Final position of the teeth, and length of the bucket's cylinder, which is the initial one, m."""

REST = 50.0
"""Largest final kinetic energy, J."""

MOST = {"torque_swing": 2e5, "force_boom": 6e5, "force_stick": 3e5, "force_bucket": 1.5e5}
"""Limits of torque, N m, and forces, N."""


def holding(solver: Any) -> Any:
    """The inputs (ninputs,) that hold the arm at the start; accelerations are linear in the inputs."""
    q, u = solver.initial
    free = [solver.speed_names.index(n) for n in solver.independent_speed_names]
    found = np.linalg.solve(solver.jacobians(q, u).inputs[free], -solver.accelerations(q, u)[free])
    return found


def lift_problem(solver: Any, method: str = "auto") -> tuple[ordernm.Objective, Any]:
    times = np.linspace(0, SECONDS, VALUES)
    values = np.tile(holding(solver), (VALUES, 1))
    values[:, 0] = 6e4 * np.sin(2 * np.pi * times / SECONDS)
    values[:, 1] *= 1.05
    variables = {f"inputs.{name}": (-most, most) for name, most in MOST.items()}
    f = ordernm.objective(
        solver, SECONDS, Integral("power"), variables, weights=[1e-4], inputs=(times, values, "linear"), method=method,
        rtol=1e-8, atol=1e-8,
    )  # fmt: skip
    place = list(PLACE.values())
    there = f.constraint([Final(name) for name in PLACE], place, place)
    still = f.constraint(Final("kinetic"), upper=REST)
    return f, [there, still]


def lift(solver: Any, maxiter: int = 200) -> tuple[ordernm.Objective, Any]:
    f, constraints = lift_problem(solver)
    return f, ordernm.optimize(f, "SLSQP", constraints=constraints, maxiter=maxiter, ftol=1e-6)


def draw(f: ordernm.Objective, best: Any, folder: Path | None = None) -> Path:
    made, axes = figure(9.0, 5.6, 2, 2)
    (way, forces), (lengths, work) = axes
    t = np.linspace(0, SECONDS, 201)
    before, after = f.simulate(f.x0, t), f.simulate(best.x, t)
    dashes = (0, (5, 2))
    for name, colour in (("reach", BLUE), ("side", ORANGE), ("height", GREEN)):
        way.plot(t, before[name], color=colour, linestyle=dashes, linewidth=0.9)
        way.plot(t, after[name], color=colour, label=name)
        way.plot(SECONDS, PLACE[name], "o", color=colour, markerfacecolor="white")
    way.set_title("The teeth (m), dashed at the start of the search", loc="left", fontsize=9)
    values = f.variables.values(best.x).reshape(4, VALUES)
    for row, name, colour, line in zip(values, MOST, (GREY, BLUE, ORANGE, GREEN), (dashes, "-", "-", "-"), strict=True):
        forces.plot(np.linspace(0, SECONDS, VALUES), row / 1e3, color=colour, linestyle=line, label=name)
    forces.set_ylim(-250, 720)
    forces.set_title("Torque (kN m) and forces (kN)", loc="left", fontsize=9)
    for name, colour in (("length_boom", BLUE), ("length_stick", ORANGE), ("length_bucket", GREEN)):
        lengths.plot(t, after[name], color=colour, label=name)
    lengths.set_title("Cylinders, from pin to pin (m)", loc="left", fontsize=9)
    energy = after.energy.sum(axis=1) - after.energy[0].sum()
    spent = np.concatenate([[0], np.cumsum(np.diff(t) * (after["power"][1:] + after["power"][:-1]) / 2)])
    work.plot(t, spent / 1e3, color=BLUE, label="work of motor and cylinders")
    work.plot(t, energy / 1e3, color=ORANGE, label="gain of energy")
    work.plot(t, after["kinetic"] / 1e3, color=GREY, linestyle=dashes, label="of it kinetic")
    work.set_title("kJ", loc="left", fontsize=9)
    for axis in axes.flat:
        axis.set_xlabel("t (s)")
        axis.legend(fontsize=8, ncols=2 if axis is forces else 1)
    return write(made, "excavator_lift", folder)


def main() -> None:
    folder = folder_asked(__doc__)
    f, best = lift(solver_of("excavator"))
    print(f)
    print(best.message, *repr(best.outcome).splitlines()[:6], sep="\n")
    print(draw(f, best, folder))


if __name__ == "__main__":
    main()
