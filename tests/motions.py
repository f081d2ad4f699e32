"""Motions of shipped models, by SciPy: solvers with the functions that a motion needs, and their states at given times."""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import codegen

EXAMPLES = Path(__file__).parents[1] / "examples"


def built(name, folder, *functions):
    """The solver of an example with the given functions only, since other functions need not be compiled."""
    codegen.generate(EXAMPLES / f"{name}.yaml", folder / name, functions=functions)
    return codegen.load(folder / name)


def at(solver, **values):
    """All coordinates or speeds of a solver, zero except for the named ones; `_` in a name may replace `.`."""
    names = [n.replace(".", "_") for n in solver.coordinate_names]
    found = np.zeros(solver.nq)
    for name, value in values.items():
        found[names.index(name)] = value
    return found


def named(solver, values):
    """The values of outputs by name."""
    return dict(zip(solver.output_names, values, strict=True))


def motion(solver, q, u, times, p=None, inputs=None, tolerance=1e-11):
    """States (q, u) at the times, from q and u at 0, of a model in which every qdot is a u."""

    def rates(t, y):
        q, u = np.split(y, 2)
        return np.concatenate([u, solver.accelerations(q, u, p, inputs, t)])

    start = np.concatenate(solver.assemble(q, u, p))
    found = solve_ivp(rates, (0, times[-1]), start, method="DOP853", t_eval=times, rtol=tolerance, atol=tolerance)
    assert found.success, found.message
    return [np.split(y, 2) for y in found.y.T]


def meeting(a, b, ra, rb, side):
    """The intersection of the circles about a and b, on the left of the line from a to b if side is 1."""
    d = np.linalg.norm(b - a)
    along = (d * d + ra * ra - rb * rb) / (2 * d)
    ex = (b - a) / d
    return a + along * ex + side * np.sqrt(ra * ra - along * along) * np.array([-ex[1], ex[0]])


def crank_driven_by_its_piston(folder, functions, pressure="(q.piston - 0.5)"):
    """A solver with two partitions. The crank has a dead point at 0.15 s: from there on, it is independent.

    Near the dead point, rounding errors are multiplied by the condition number of the loop, about 30, and its square.
    """
    text = (EXAMPLES / "slider_crank.yaml").read_text()
    for old, new in {
        "independent: [wheel]": "independent: [piston]", "u: {wheel: 20.0}": "u: {piston: -2.0}",
        "max(q.piston - 0.5, 0)": pressure,
    }.items():  # fmt: skip
        text = text.replace(old, new)
    (folder / "crank.yaml").write_text(text)
    codegen.generate(folder / "crank.yaml", folder / "package", functions=functions, partitions=2)
    return codegen.load(folder / "package")
