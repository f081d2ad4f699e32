"""Andrews' squeezing mechanism: gradients of a motion with respect to all 42 parameters, forward and by the adjoint.

    python examples/andrews_gradients.py [--folder examples/figures]

The result is the position of point E of the three closed loops after 0.03 s, the time of the benchmark. Either 42 sensitivities
are integrated with the motion, in six blocks of eight, or the adjoint goes back through its steps once. Both differentiate the
same computed motion and agree to rounding. The time of the adjoint does not grow with the number of parameters.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from pictures import BLUE, GREEN, GREY, ORANGE, figure, folder_asked, solver_of, write

from ordernm.runtime import Final

SECONDS = 0.03
SHOWN = 14
"""Number of parameters in the figure."""


DASHES = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 2, 1, 2)))


def gradients(solver: Any, method: str, output: str = "E_x", number: int = 42) -> Any:
    """The position of E with derivatives with respect to the first parameters; `Judged`."""
    wrt = solver.parameter_names[:number]
    return solver.judge(SECONDS, Final(output), wrt=wrt, method=method)


def difference(solver: Any, output: str = "E_x") -> float:
    """The largest difference of the two methods, relative to the largest derivative."""
    forward, adjoint = (gradients(solver, method, output).gradients for method in ("forward", "adjoint"))
    return float(np.abs(forward - adjoint).max() / np.abs(forward).max())


def seconds(solver: Any, method: str, number: int, repeat: int = 15) -> float:
    """The median time of a motion with its gradient."""
    found = []
    for _ in range(repeat):
        began = time.perf_counter()
        gradients(solver, method, "E_x", number)
        found.append(time.perf_counter() - began)
    return float(np.median(found))


def draw(solver: Any, folder: Path | None = None) -> Path:
    """Displacement of E due to a change of each parameter by one percent, at the end and over time."""
    made, ((bars, over_time),) = figure(9.0, 4.4, across=2)
    moved = {o: 1e3 * 0.01 * gradients(solver, "adjoint", o).gradients[0] * solver.parameters for o in ("E_x", "E_y")}
    size = np.hypot(moved["E_x"], moved["E_y"])
    order = np.argsort(-size, kind="stable")[:SHOWN]
    names = [solver.parameter_names[i] for i in order]
    places = np.arange(SHOWN)[::-1]
    bars.barh(places + 0.2, moved["E_x"][order], 0.36, color=BLUE, label="x")
    bars.barh(places - 0.2, moved["E_y"][order], 0.36, color=ORANGE, label="y")
    bars.set_yticks(places, names, fontsize=8)
    bars.set_xlabel("mm")
    bars.set_title("A percent more of a parameter moves E after 0.03 s by", loc="left", fontsize=9)
    bars.legend(fontsize=8)
    first = tuple(names[:4])
    motion = solver.simulate(np.linspace(0, SECONDS, 601), sensitivities=first)
    for name, i, colour, dashes in zip(first, order, (BLUE, ORANGE, GREEN, GREY), DASHES, strict=False):
        moves = 1e3 * 0.01 * solver.parameters[i] * motion.derivative("E_x", name)
        over_time.plot(1e3 * motion.t, moves, color=colour, linestyle=dashes, label=name)
    over_time.set_xlabel("t (ms)")
    over_time.set_title("A percent more of a parameter moves x by (mm)", loc="left", fontsize=9)
    over_time.legend(fontsize=8, loc="upper left")
    return write(made, "andrews_gradients", folder)


def main() -> None:
    folder = folder_asked(__doc__)
    solver = solver_of("andrews")
    print(f"forward and adjoint differ by {difference(solver):.1e} of the largest derivative")
    alone = seconds(solver, "auto", 0)
    print(f"the motion alone: {1e3 * alone:.2f} ms")
    print("parameters   forward, ms   adjoint, ms")
    for number in (1, 8, 16, 24, 32, 42):
        forward, adjoint = (1e3 * seconds(solver, method, number) for method in ("forward", "adjoint"))
        print(f"{number:10d} {forward:13.2f} {adjoint:13.2f}")
    print(draw(solver, folder))


if __name__ == "__main__":
    main()
