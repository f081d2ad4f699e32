"""Compares the compiled C with the NumPy module of a package; both contain the same statements."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Shape
from ..errors import SingularJointError, TargetsDifferError
from .arguments import NO_SEEDS, Seeds
from .functions import ARGUMENTS, Function

TARGET_TOLERANCE = 1e-9
"""Relative difference allowed between the C and the NumPy module, per direction, in double precision."""

ROUNDED = 1e-3
"""Like `TARGET_TOLERANCE`, for C code that computes in single precision."""

STATES = 3
DIRECTIONS = 3


def compare(
    manifest: Mapping[str, Any],
    functions: Mapping[str, Function],
    shapes: Mapping[str, Shape],
    compiled: Any,
    plain: Any,
) -> None:
    """Compares two targets at random states, for all functions and directions.

    Raises
    ------
    TargetsDifferError
    """
    rng = np.random.default_rng(0)
    # with loops, states deviate little, so that both targets take the same branch at every decision
    spread = 0.03 if manifest["closure_names"] else 0.3
    q, p = (np.array(x, float) for x in (manifest["initial"]["q"], manifest["parameters"]))
    for _, f in itertools.product(range(STATES), functions.values()):
        arrays: dict[str, Any] = {n: rng.normal(size=shapes[n]) for n in ARGUMENTS if n not in ("q", "p")}
        arrays |= {"q": q + spread * rng.normal(size=q.shape), "p": p, "t": 0.7}
        seeds = {f"d{n}": rng.normal(size=(DIRECTIONS, *(shapes[n] or (1,)))) for n in arrays}
        with np.errstate(all="ignore"):
            ours, theirs = (_outcome(target, f, arrays, seeds) for target in (compiled, plain))
        if isinstance(ours, str) or isinstance(theirs, str):
            if isinstance(ours, str) != isinstance(theirs, str):
                raise TargetsDifferError(
                    f"{manifest['name']}, {f.name}: only one of C and NumPy finds a singular joint"
                )
            continue
        if f.name == "jacobians" and not (np.isfinite(ours[0]).all() or np.isfinite(theirs[0]).all()):
            continue  # accelerations are undefined, so derivatives may differ: C requests fewer directions than NumPy
        # completed seeds leave a rounding residual that grows with the condition of the closure matrices
        floor = 1e-9 if f.name == "closure_sensitivities" else 1e-12
        tolerance = TARGET_TOLERANCE
        if compiled.dtype != np.float64:
            tolerance = floor = ROUNDED
        for name, derived, a, b in zip(f.results, f.derived, ours, theirs, strict=True):
            rows = (DIRECTIONS if derived else 1, -1)
            for x, y in zip(a.reshape(rows), b.reshape(rows), strict=True):
                # a force of the model may be undefined at such a state, in both targets
                finite = np.isfinite(x) | np.isfinite(y)
                x, y = x[finite], y[finite]
                error = float(np.max(np.abs(x - y), initial=0.0))
                if not error <= tolerance * float(np.max(np.abs(y), initial=0.0)) + floor:
                    raise TargetsDifferError(
                        f"{manifest['name']}: {name} of {f.name} differs by {error:.3g} between C and NumPy; "
                        f"please report this with the model"
                    )


def _outcome(target: Any, f: Function, arrays: Mapping[str, Any], seeds: Mapping[str, Array]) -> list[Array] | str:
    """The results of a function, or the name of the singular joint."""
    try:
        found: list[Array] = target.compute(f, arrays, (), Seeds(seeds, DIRECTIONS) if f.seeds else NO_SEEDS)
    except SingularJointError as error:
        return error.link
    return found
