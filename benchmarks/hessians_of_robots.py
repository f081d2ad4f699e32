"""Hessians of a weighted sum of udot by coordinates and speeds, of robots: time in Python, size of the C text, time of gcc.

    pip install pin example-robot-data
    python benchmarks/hessians_of_robots.py [--folder ROBOTS] [--budget 2] [G1 ...]

The solver is generated with `accelerations` and `hessian_products`. A whole Hessian is one call with a direction for every
coordinate and speed. Times are CPU times of one thread, with the cost of the call in Python.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
from pathlib import Path

import numpy as np

import codegen
from codegen.measure.clock import alternate, calibrated, one_core
from codegen.measure.pinocchio_models import ours, theirs_of
from codegen.measure.tables import markdown

HEAD = (
    "robot",
    "speeds",
    "KB of C",
    "gcc, s",
    "udot, us",
    "1 direction, us",
    "8 directions, us",
    "Hessian, us",
    "asymmetry",
)


def row(name: str, folder_of_robots: Path | None, budget: float) -> list[object]:
    """Figures of a robot."""
    model = ours(theirs_of(name, folder_of_robots), name)
    with tempfile.TemporaryDirectory() as folder:
        codegen.generate(model, folder, functions="accelerations,hessian_products", check=False)
        size = sum(f.stat().st_size for f in Path(folder).glob("*.[ch]"))
        solver = codegen.load(folder)
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        solver.prepare("accelerations", "hessian_products")
        compiled = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        rng = np.random.default_rng(0)
        q, u = solver.initial
        u = u + 0.3 * rng.normal(size=u.shape)
        inputs, weights = np.zeros(len(solver.input_names)), rng.normal(size=solver.nu)
        dq, du = (x.copy() for x in np.split(np.eye(solver.nq + solver.nu), [solver.nq], axis=1))
        given = {"q": q, "u": u, "inputs": inputs}

        def products(k: int) -> object:
            return solver.hessian_products(**given, weights=weights, dq=dq[:k], du=du[:k])

        H = solver.hessians(**given, weights=weights, wrt="q, u")
        runs = {
            "udot": calibrated(lambda: solver.accelerations(**given)),
            **{str(k): calibrated(lambda k=k: products(k)) for k in (1, 8, len(dq))},
        }
        times = alternate(runs, budget)
    micro = [f"{1e6 * times[n].median:.1f}" for n in runs]
    asymmetry = f"{np.abs(H - H.T).max() / np.abs(H).max():.0e}"
    return [name, model.nu, size // 1000, f"{compiled:.1f}", *micro, asymmetry]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", default=["G1"])
    parser.add_argument("--folder", type=Path, help="the folder robots of example-robot-data")
    parser.add_argument("--budget", type=float, default=2.0, help="time for each function, s")
    options = parser.parse_args()
    with one_core():
        rows = [row(name, options.folder, options.budget) for name in options.robots]
    print(markdown(HEAD, rows))


if __name__ == "__main__":
    main()
