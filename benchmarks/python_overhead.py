"""What a call from Python costs above the C function: every function of CHAIN(n), one state, beside Pinocchio from Python.

The time of the Python call minus that of the same C function called in a C loop (its batch function over one state again and
again), measured in turns in one process on one core, as CPU time; the fastest of many. Pinocchio's rows are left out where it is
not installed. `frames`, `points` and `assemble` are compared with the functions of the C that they call.

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

import codegen
from codegen.measure.accuracy import relative
from codegen.measure.clock import Timed, elapsed, in_rounds, one_core
from codegen.measure.models import chain_state, seeds, sized
from codegen.measure.pinocchio_models import chain
from codegen.runtime import Jacobians

LOOP = 200

timed = partial(elapsed, clock=time.thread_time)
"""The CPU time of a call: on a busy machine, the wall clock counts what others do meanwhile."""


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
    along = dict(zip(("dq", "du", "dp"), (x[:1] for x in seeds(n)), strict=True))
    eight = dict(zip(("dq", "du", "dp"), seeds(n), strict=True))
    place = {s: along[s] for s in ("dq", "dp")}
    state, at = (q, u, p), (q, p)
    found = [
        Member("accelerations", "accelerations", state),
        Member("sensitivities", "sensitivities", state, along, width=1),
        Member("sensitivities, 8", "sensitivities", state, eight, width=8),
        Member("jacobians", "jacobians", state),
        Member("gradients", "sensitivities_transposed", state, {"weights": force}, False, 1),
        Member("coordinate_rates", "coordinate_rates", state),
        Member("coordinate_rate_sensitivities", "coordinate_rate_sensitivities", state, along, width=1),
        Member("coordinate_rate_gradients", "coordinate_rate_sensitivities_transposed", state, {"weights": force}, False, 1),
        Member("energies", "energies", state, out=False),
        Member("energy_sensitivities", "energy_sensitivities", state, along, False, 1),
        Member("energy_gradients", "energy_sensitivities_transposed", state, {"weights": np.ones(2)}, False, 1),
        Member("outputs", "outputs", state),
        Member("output_sensitivities", "output_sensitivities", state, along, width=1),
        Member("output_gradients", "output_sensitivities_transposed", state, {"weights": np.ones(1)}, False, 1),
        Member("mass_matrix", "mass_matrix", at),
        Member("mass_matrix_sensitivities", "mass_matrix_sensitivities", at, place, width=1),
        Member("inverse_mass_matrix", "inverse_mass_matrix", at),
        Member("solve_mass", "solve_mass", (q, force, p)),
        Member("solve_mass_sensitivities", "solve_mass_sensitivities", (q, force, p), place | {"db": along["du"]}, width=1),
        Member("inverse_dynamics", "inverse_dynamics", (q, u, force, p)),
        Member("inverse_dynamics_sensitivities", "inverse_dynamics_sensitivities", (q, u, force, p),
               along | {"dudot": along["du"]}, width=1),
        Member("bias_force", "inverse_dynamics", state),
        Member("bias_force_sensitivities", "inverse_dynamics_sensitivities", state, along, width=1),
        Member("reactions", "reactions", state, out=False),
        Member("reaction_sensitivities", "reaction_sensitivities", state, along, False, 1),
        Member("frames", "frames", state, out=False),
        Member("frame_sensitivities", "frame_sensitivities", state, along, False, 1),
        Member("points", "frames", state, {"points": [(solver._manifest["bodies"][-1], (0.0, 0.0, -0.5))]}, False),
        Member("points, accelerations", "", state,
               {"points": [(solver._manifest["bodies"][-1], (0.0, 0.0, -0.5))], "accelerations": True}, False),
        Member("frame_jacobians", "", at, out=False),
        Member("assemble", "", state, out=False),
        Member("assemble_sensitivities", "", state, along, False),
    ]  # fmt: skip
    return found


def c_loop(solver: Any, member: Member, force: np.ndarray) -> Callable[[], Any] | None:
    """What calls the C function of a member again and again."""
    if not member.function:
        return None
    f, target, width = solver._functions[member.function], solver._target, member.width
    n, ffi = solver.nu, target.ffi
    q, u = chain_state(n)
    known = {"q": q, "u": u, "p": solver.parameters, "inputs": np.zeros(0), "t": np.zeros(1), "udot": force, "b": force}
    dq, du, dp = seeds(n)
    directions = {"dq": dq, "du": du, "dp": dp, "db": du, "dudot": du, "dqdot": du}
    lanes = {
        s: np.ascontiguousarray(directions.get(s, np.ones((8, size)))[:width, :size].T) for s, size in f.seeds.items()
    }
    sizes = [math.prod(s) * (width if d and width else 1) for s, d in zip(f.shapes, f.derived, strict=True)]
    given = {name: (target.pointer(x), 0) for name, x in ({a: known[a] for a in f.arguments} | lanes).items()}
    given |= {r: (target.pointer(np.empty((LOOP, size))), size) for r, size in zip(f.results, sizes, strict=True)}
    arrays = ", ".join(solver._manifest["batch"])
    if "batch" not in ffi.list_types()[0]:
        ffi.cdef(f"""typedef struct {{ double *at; long step; }} rows;
            typedef struct {{ long count, failed; rows {arrays}; double *work; }} batch;""")
    symbol = f"{solver.name}_{f.name}" + (f"_{width}" if width else "") + "_batch"
    ffi.cdef(f"int {symbol}(batch *);", override=True)
    call = getattr(target.library_of(f.name, width), symbol)
    work = target.pointer(np.empty(target.workspace))
    b = ffi.new("batch *", {"count": LOOP, "work": work})
    for name, at in given.items():
        setattr(b, name, at)
    kept = given, work
    return lambda: call(b) or kept


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
    model = chain(n)
    data, (q, u), force = model.createData(), chain_state(n), np.linspace(-1.0, 1.0, n)
    return {
        "pin.aba": partial(pin.aba, model, data, q, u, force),
        "pin.rnea": partial(pin.rnea, model, data, q, u, force),
        "pin.nonLinearEffects": partial(pin.nonLinearEffects, model, data, q, u),
        "pin.computeABADerivatives": partial(pin.computeABADerivatives, model, data, q, u, force),
    }


def of_each(run: Timed) -> float:
    """Seconds of one of `LOOP` states."""
    return run() / LOOP


def calls_of(solver: Any, theirs: Mapping[str, Callable[[], Any]]) -> dict[tuple[str, str], Timed]:
    """Everything that is timed, by its name and "C", "Python" or "out="; in C one of `LOOP` states."""
    found: dict[tuple[str, str], Timed] = {}
    force = np.linspace(-1.0, 1.0, solver.nu)
    for m in members(solver, solver.nu):
        member = getattr(solver, m.name.partition(",")[0])
        found[m.name, "Python"] = timed(partial(member, *m.given, **m.named), LOOP)
        if (loop := c_loop(solver, m, force)) is not None:
            found[m.name, "C"] = partial(of_each, timed(loop))
        if (placed := with_places(solver, m)) is not None:
            found[m.name, "out="] = timed(placed, LOOP)
    found["simulate(1e-3)", "Python"] = timed(partial(solver.simulate, 1e-3), LOOP // 4)
    return found | {(name, "Python"): timed(call, LOOP) for name, call in theirs.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--n", type=int, default=12)
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--mode", choices=("api", "abi"), default="api", help="of cffi")
    options = parser.parse_args()
    os.environ["ORDERNM_CFFI"] = options.mode
    m, theirs = sized("CHAIN", options.n), pinocchio(options.n)
    with tempfile.TemporaryDirectory() as folder, one_core():
        codegen.generate(m.model, Path(folder) / "chain", compile="all", check=False, reactions=True, frames=True)
        solver = codegen.load(Path(folder) / "chain")
        if theirs:
            assert (
                relative(solver.inverse_dynamics(m.q, m.u, np.linspace(-1.0, 1.0, m.size)), theirs["pin.rnea"]())
                < 1e-11
            )
        calls = calls_of(solver, theirs)
        labels = {" / ".join(key): key for key in calls}
        times = in_rounds({label: calls[key] for label, key in labels.items()}, options.rounds)
    found = {key: times[label].least for label, key in labels.items()}
    print(
        f"CHAIN({options.n}), microseconds; cffi in {options.mode} mode, Python {sys.version.split()[0]}, NumPy {np.__version__}"
    )
    columns = ("C", "Python", "out=")
    print(f"{'':34s}" + "".join(f"{c:>9s}" for c in (*columns, "above C", "with out=")))
    for name in dict.fromkeys(name for name, _ in calls):
        c, python, out = (found.get((name, column), math.nan) for column in columns)
        numbers = (c, python, out, python - c, out - c)
        print(f"{name:34s}" + "".join(f"{'' if math.isnan(x) else f'{1e6 * x:.2f}':>9s}" for x in numbers))


if __name__ == "__main__":
    main()
