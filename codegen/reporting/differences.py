"""The V of finite differences: the digits that they lose at every step, beside the exact derivative."""

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
"""A relative step, and the relative error of a one-sided difference with it where udot is no straight line."""

STEPS = 10.0 ** np.arange(-16.0, 0.01, 0.5)
"""Steps h of the differences, relative to the size of what is changed."""


def differences(
    model: Model, solver: Solver, state: State, references: Mapping[str, Exact], skipped: list[Skipped]
) -> dict[str, Any] | None:
    """Errors of one-sided and central differences of udot by step, and of the exact derivative.

    Parameters
    ----------
    references : mapping of str to (nu,) numbers
        Derivatives at that state by the reference in extended precision, by parameter.

    Returns
    -------
    dict or None
        ``by`` (a parameter, or a coordinate of a model that has none), ``steps``, ``forward``, ``central``, ``exact``, and
        ``reference``, what errors are against.
    """
    name, seeds, size = _direction(model, solver, state)
    at = state.q, state.u, None, state.inputs, state.t
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        dudot = solver.sensitivities(*at, **seeds)[1][0]
    derivative = references.get(name)
    if derivative is not None:
        reference, exact = f"the generic engine in {DIGITS} digits", relative(dudot, derivative)
    else:
        derivative = np.array([mpmath.mpf(float(x)) for x in dudot], dtype=object)
        reference, exact = "the exact derivative of the generated solver", None
    if not any(derivative):
        skipped.append(Skipped("finite differences", f"the derivative by {name} vanishes"))
        return None
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


def _direction(model: Model, solver: Solver, state: State) -> tuple[str, dict[str, Any], float]:
    """What is changed: the first parameter that udot is no straight line of, else the first with a derivative; of a model without
    parameters the first independent coordinate."""
    at = state.q, state.u, None, state.inputs, state.t
    if solver.np:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            dudot = solver.sensitivities(*at, dp=np.eye(solver.np))[1]
        i = next((i for i in range(solver.np) if _is_curved(solver, state, i, dudot[i])), None)
        if i is None:
            i = next((i for i, row in enumerate(dudot) if np.any(row)), 0)
        return model.parameter_names[i], {"dp": np.eye(solver.np)[i : i + 1]}, abs(float(solver.parameters[i])) or 1.0
    i = solver.coordinate_names.index(solver.independent_names[0])
    return solver.coordinate_names[i], {"dq": np.eye(solver.nq)[i : i + 1]}, 1.0


def _is_curved(solver: Solver, state: State, i: int, derivative: Array) -> bool:
    """Whether a coarse difference is off by more than rounding: of a straight line it never is, and there is no V."""
    h = COARSE * (abs(float(solver.parameters[i])) or 1.0)
    size = np.max(np.abs(derivative), initial=0.0)
    ahead, middle = (_moved(solver, state, {"dp": np.eye(solver.np)[i : i + 1]}, x) for x in (h, 0.0))
    return bool(size > 0 and ahead is not None and middle is not None
                and np.max(np.abs((ahead - middle) / h - derivative)) > CURVED * size)  # fmt: skip


def _moved(solver: Solver, state: State, seeds: dict[str, Array], h: float) -> Array | None:
    """udot a step away, loops closed again; None where they do not close."""
    p = solver.parameters + h * seeds["dp"][0] if "dp" in seeds else solver.parameters
    q = state.q + h * seeds["dq"][0] if "dq" in seeds else state.q
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            if solver.closure_names:
                q, _ = solver.assemble(q, state.u, p)
            return np.asarray(solver.accelerations(q, state.u, p, state.inputs, state.t))
    except (AssemblyError, SingularLoopError, SingularJointError, ValueError):
        return None


def _quotient(a: Array | None, b: Array | None, h: float) -> Sequence[float] | None:
    return None if a is None or b is None else ((a - b) / h).tolist()
