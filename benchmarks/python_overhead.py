"""What a call from Python costs above the C function: every function of CHAIN(n), one state, beside Pinocchio from Python.

The time of the Python call minus that of the same C function called in a C loop (its batch function over one state again and
again), measured in turns in one process on one core; the fastest of many. Pinocchio's rows are left out where it is not
installed. `frames`, `points` and `assemble` are compared with the functions of the C that they call.

    python benchmarks/python_overhead.py [--n 12] [--rounds 40] [--mode api|abi]
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from chains import chain_model, chain_seeds, chain_state
from ctiming import use_one_core

import codegen
from codegen.runtime import Jacobians

LOOP = 200
FOR_FORCES = {"solve_mass": "b", "inverse_dynamics": "udot"}
"""Members that take accelerations or forces behind the state, and what the C calls them."""


class Member(NamedTuple):
    """A member of the solver, the C function that it calls, its arguments, and whether it takes ``out=``."""

    name: str
    function: str
    given: tuple[Any, ...]
    named: Mapping[str, Any] = MappingProxyType({})
    out: bool = True
    width: int = 0


def members(solver: Any, n: int) -> list[Member]:
    """Every function of a tree."""
    q, u = chain_state(n)
    p = solver.parameters
    force = np.linspace(-1.0, 1.0, n)
    seeds = dict(zip(("dq", "du", "dp"), (x[:1] for x in chain_seeds(n)), strict=True))
    eight = dict(zip(("dq", "du", "dp"), chain_seeds(n), strict=True))
    place = {s: seeds[s] for s in ("dq", "dp")}
    state, at = (q, u, p), (q, p)
    found = [
        Member("accelerations", "accelerations", state),
        Member("sensitivities", "sensitivities", state, seeds, width=1),
        Member("sensitivities, 8", "sensitivities", state, eight, width=8),
        Member("jacobians", "jacobians", state),
        Member("gradients", "sensitivities_transposed", state, {"weights": force}, False, 1),
        Member("coordinate_rates", "coordinate_rates", state),
        Member("coordinate_rate_sensitivities", "coordinate_rate_sensitivities", state, seeds, width=1),
        Member("coordinate_rate_gradients", "coordinate_rate_sensitivities_transposed", state, {"weights": force}, False, 1),
        Member("energies", "energies", state, out=False),
        Member("energy_sensitivities", "energy_sensitivities", state, seeds, False, 1),
        Member("energy_gradients", "energy_sensitivities_transposed", state, {"weights": np.ones(2)}, False, 1),
        Member("outputs", "outputs", state),
        Member("output_sensitivities", "output_sensitivities", state, seeds, width=1),
        Member("output_gradients", "output_sensitivities_transposed", state, {"weights": np.ones(1)}, False, 1),
        Member("mass_matrix", "mass_matrix", at),
        Member("mass_matrix_sensitivities", "mass_matrix_sensitivities", at, place, width=1),
        Member("inverse_mass_matrix", "inverse_mass_matrix", at),
        Member("solve_mass", "solve_mass", (q, force, p)),
        Member("solve_mass_sensitivities", "solve_mass_sensitivities", (q, force, p), place | {"db": seeds["du"]}, width=1),
        Member("inverse_dynamics", "inverse_dynamics", (q, u, force, p)),
        Member("inverse_dynamics_sensitivities", "inverse_dynamics_sensitivities", (q, u, force, p),
               seeds | {"dudot": seeds["du"]}, width=1),
        Member("bias_force", "inverse_dynamics", state),
        Member("bias_force_sensitivities", "inverse_dynamics_sensitivities", state, seeds, width=1),
        Member("reactions", "reactions", state, out=False),
        Member("reaction_sensitivities", "reaction_sensitivities", state, seeds, False, 1),
        Member("frames", "frames", state, out=False),
        Member("frame_sensitivities", "frame_sensitivities", state, seeds, False, 1),
        Member("points", "frames", state, {"points": [(solver._manifest["bodies"][-1], (0.0, 0.0, -0.5))]}, False),
        Member("assemble", "", state, out=False),
    ]  # fmt: skip
    return found


def c_loop(solver: Any, member: Member, force: np.ndarray) -> Callable[[], Any] | None:
    """What calls the C function of a member again and again."""
    if not member.function:
        return None
    f, target, width = solver._functions[member.function], solver._target, member.width
    n = solver.nu
    q, u = chain_state(n)
    known = {"q": q, "u": u, "p": solver.parameters, "inputs": np.zeros(0), "t": np.zeros(1), "udot": force, "b": force}
    dq, du, dp = chain_seeds(n)
    directions = {"dq": dq, "du": du, "dp": dp, "db": du, "dudot": du, "dqdot": du}
    lanes = [
        np.ascontiguousarray(directions.get(s, np.ones((8, size)))[:width, :size].T) for s, size in f.seeds.items()
    ]
    results = [
        np.empty((LOOP, math.prod(s) * (width if d and width else 1)))
        for s, d in zip(f.shapes, f.derived, strict=True)
    ]  # fmt: skip
    given = [(target.pointer(x), 0) for x in (*(known[a] for a in f.arguments), *lanes)]
    return lambda: target.batches.rows(f, width, given, results, LOOP)


def with_places(solver: Any, member: Member) -> Callable[[], Any] | None:
    """The call of a member with its results in ``out=``."""
    if not member.out:
        return None
    call = getattr(solver, member.name.partition(",")[0])
    found = call(*member.given, **member.named)
    out = found if isinstance(found, (np.ndarray, Jacobians)) else tuple(x.copy() for x in found)
    return partial(call, *member.given, **member.named, out=out)


def pinocchio(n: int) -> dict[str, Callable[[], Any]]:
    """The same chain at L = 1 in Pinocchio, if it is there."""
    try:
        import pinocchio as pin
    except ImportError:
        return {}
    model = pin.Model()
    model.gravity.linear = np.array([0, 0, -9.81])
    across, along = 0.05**2 / 4 + 1 / 12, 0.05**2 / 2
    parent = 0
    for k in range(1, n + 1):
        joint = pin.JointModelRX() if k % 2 == 0 else pin.JointModelRY()
        place = pin.SE3(np.eye(3), np.array([0, 0, -1.0 if k > 1 else 0.0]))
        parent = model.addJoint(parent, joint, place, f"j{k}")
        inertia = pin.Inertia(1.0, np.array([0, 0, -0.5]), np.diag([across, across, along]))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    data = model.createData()
    q, u = chain_state(n)
    force = np.linspace(-1.0, 1.0, n)
    return {
        "pin.aba": partial(pin.aba, model, data, q, u, force),
        "pin.rnea": partial(pin.rnea, model, data, q, u, force),
        "pin.nonLinearEffects": partial(pin.nonLinearEffects, model, data, q, u),
        "pin.computeABADerivatives": partial(pin.computeABADerivatives, model, data, q, u, force),
    }


def fastest(call: Callable[[], Any], repetitions: int) -> float:
    """Seconds of one of so many calls."""
    clock = time.perf_counter
    start = clock()
    for _ in range(repetitions):
        call()
    return (clock() - start) / repetitions


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--n", type=int, default=12)
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--mode", choices=("api", "abi"), default="api", help="of cffi")
    options = parser.parse_args()
    n = options.n
    use_one_core()
    os.environ["ORDERNM_CFFI"] = options.mode
    solver = codegen.load(codegen.generate(
        chain_model(n), Path(tempfile.mkdtemp()) / "chain", compile="all", check=False, reactions=True, frames=True
    ).folder)  # fmt: skip
    theirs = pinocchio(n)
    force = np.linspace(-1.0, 1.0, n)
    if theirs:
        expected = theirs["pin.rnea"]()
        assert np.max(np.abs(solver.inverse_dynamics(*chain_state(n), force) - expected)) < 1e-11 * np.max(
            np.abs(expected)
        )
    calls: dict[tuple[str, str], tuple[Callable[[], Any], int]] = {}
    for m in members(solver, n):
        member = getattr(solver, m.name.partition(",")[0])
        calls[m.name, "Python"] = partial(member, *m.given, **m.named), 200
        if (loop := c_loop(solver, m, force)) is not None:
            calls[m.name, "C"] = loop, 1
        if (placed := with_places(solver, m)) is not None:
            calls[m.name, "out="] = placed, 200
    calls["simulate(1e-3)", "Python"] = partial(solver.simulate, 1e-3), 10
    calls |= {(name, "Python"): (call, 200) for name, call in theirs.items()}
    found = dict.fromkeys(calls, math.inf)
    for _ in range(options.rounds):
        for key, (call, repetitions) in calls.items():
            took = fastest(call, repetitions)
            found[key] = min(found[key], took / LOOP if key[1] == "C" else took)
    print(
        f"CHAIN({n}), microseconds; cffi in {options.mode} mode, Python {sys.version.split()[0]}, NumPy {np.__version__}"
    )
    columns = ("C", "Python", "out=")
    print(f"{'':34s}" + "".join(f"{c:>9s}" for c in (*columns, "above C", "with out=")))
    for name in dict.fromkeys(name for name, _ in calls):
        c, python, out = (found.get((name, column), math.nan) for column in columns)
        numbers = (c, python, out, python - c, out - c)
        print(f"{name:34s}" + "".join(f"{'' if math.isnan(x) else f'{1e6 * x:.2f}':>9s}" for x in numbers))


if __name__ == "__main__":
    main()
