"""The error of finite differences by step size, compared with the error of the exact derivative."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import mpmath
import numpy as np

from ..runtime.standalone.errors import AssemblyError, SingularJointError, SingularLoopError
from .errors import DIGITS, Exact, relative
from .skipped import Skipped
from .states import State

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from ..model import Model
    from ..runtime import Solver

    Array = NDArray[np.float64]

COARSE, CURVED = 1e-3, 1e-5
"""A relative step, and the relative error of a one-sided difference above which udot counts as nonlinear."""

QUATERNION = ("qw", "qx", "qy", "qz")
"""Suffixes of coordinates that cannot be changed separately."""

STEPS = 10.0 ** np.arange(-16.0, 0.01, 0.5)
"""Steps h of the differences, relative to the size of the changed quantity."""


def differences(
    model: Model, solver: Solver, state: State, references: Mapping[str, Exact], skipped: list[Skipped]
) -> dict[str, Any] | None:
    """Errors of one-sided and central differences of udot by step, and of the exact derivative.

    Parameters
    ----------
    references : mapping of str to (nu,) numbers
        For each parameter: the derivative at this state, computed by the reference in extended precision.

    Returns
    -------
    dict or None
        ``by`` (a parameter, or a coordinate or speed if no parameter has an effect), ``steps``, ``forward``, ``central``,
        ``exact``, and ``reference``, the origin of the reference values.
    """
    chosen = _direction(model, solver, state)
    if chosen is None:
        why = "at this state, the accelerations do not depend on any parameter, independent coordinate or speed"
        skipped.append(Skipped("finite differences", why))
        return None
    name, seeds, size = chosen
    at = state.q, state.u, None, state.inputs, state.t
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        dudot = solver.sensitivities(*at, **seeds)[1][0]
    derivative = references.get(name) if "dp" in seeds else None
    if derivative is not None:
        reference, exact = f"the generic engine in {DIGITS} digits", relative(dudot, derivative)
    else:
        derivative = np.array([mpmath.mpf(float(x)) for x in dudot], dtype=object)
        reference, exact = "the exact derivative of the generated solver", None
    curves: dict[str, list[float | None]] = {"forward": [], "central": []}
    middle = _moved(solver, state, seeds, 0.0)
    for h in STEPS * size:
        ahead, behind = (_moved(solver, state, seeds, s * h) for s in (1, -1))
        for kind, found in (("forward", _quotient(ahead, middle, h)), ("central", _quotient(ahead, behind, 2 * h))):
            error = relative(found, derivative) if found is not None else None
            curves[kind].append(error if error is not None and np.isfinite(error) else None)
    return {
        "by": name,
        "size": size,
        "steps": (STEPS * size).tolist(),
        **curves,
        "exact": exact,
        "reference": reference,
    }


def _direction(model: Model, solver: Solver, state: State) -> tuple[str, dict[str, Any], float] | None:
    """The quantity to change: its name, seed and size; None if udot depends on nothing.

    The quantity is the first parameter, independent coordinate or speed on which udot depends nonlinearly, parameters first. If
    there is none, it is the first quantity with a non-zero derivative.
    """
    kinds = [
        ("dp", model.parameter_names, list(zip(model.parameter_names, np.abs(solver.parameters).tolist(), strict=True))),
        ("dq", solver.coordinate_names, [(n, 1.0) for n in solver.independent_names if n.rpartition(".")[2] not in QUATERNION]),
        ("du", solver.speed_names, [(n, 1.0) for n in solver.independent_speed_names]),
    ]  # fmt: skip
    straight = None
    for kind, names, candidates in kinds:
        for name, value in candidates:
            size = value or 1.0
            seeds: dict[str, Any] = {kind: np.eye(len(names))[[names.index(name)]]}
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                derivative = solver.sensitivities(state.q, state.u, None, state.inputs, state.t, **seeds)[1][0]
            if _is_curved(solver, state, seeds, COARSE * size, derivative):
                return name, seeds, size
            if straight is None and np.any(derivative):
                straight = name, seeds, size
        if straight is not None and kind == "dp":  # a parameter is preferred, even if udot is linear in it
            return straight
    return straight


def _is_curved(solver: Solver, state: State, seeds: dict[str, Array], h: float, derivative: Array) -> bool:
    """Whether the error of a coarse difference exceeds rounding, which is false for a linear function."""
    size = np.max(np.abs(derivative), initial=0.0)
    ahead, middle = (_moved(solver, state, seeds, x) for x in (h, 0.0))
    return bool(size > 0 and ahead is not None and middle is not None
                and np.max(np.abs((ahead - middle) / h - derivative)) > CURVED * size)  # fmt: skip


def _moved(solver: Solver, state: State, seeds: dict[str, Array], h: float) -> Array | None:
    """udot after a step, with the loops closed again; None if the loops do not close."""
    p = solver.parameters + h * seeds["dp"][0] if "dp" in seeds else solver.parameters
    q = state.q + h * seeds["dq"][0] if "dq" in seeds else state.q
    u = state.u + h * seeds["du"][0] if "du" in seeds else state.u
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            if solver.closure_names:
                q, u = solver.assemble(q, u, p, state.inputs, state.t)
            return np.asarray(solver.accelerations(q, u, p, state.inputs, state.t))
    except (AssemblyError, SingularLoopError, SingularJointError, ValueError):
        return None


def _quotient(a: Array | None, b: Array | None, h: float) -> Sequence[float] | None:
    return None if a is None or b is None else ((a - b) / h).tolist()
