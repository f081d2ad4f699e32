"""Identification: variables of a model from samples of its motions, by nonlinear least squares with exact Jacobians."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.standalone.arrays import Array, Numbers
from ..runtime.standalone.motion.settings import ATOL, METHOD, RTOL
from ..runtime.standalone.trajectory.trajectory import Trajectory
from ..terminal import working
from ..wording import counted
from .experiments import Experiment, take_experiments
from .failures import FAILURES
from .fit_curvature import check_hessian, full_hessian
from .fit_result import Fit
from .given_solver import check_given
from .variables import Wanted

UNDETERMINED = 1e-9
"""A direction of variables whose singular value is below this fraction of the largest is not determined by the samples."""

METHODS = ("trf", "dogbox")


class _Problem:
    """Residuals and their Jacobian at an x; the last result is kept."""

    def __init__(self, experiments: Sequence[Experiment], x0: Array):
        self.experiments, self.motions = experiments, 0
        self.failures: list[str] = []
        self.trajectories: list[Trajectory] = []
        self.error: Exception | None = None
        self._key, self._found = b"", (np.zeros(0), np.zeros((0, 0)))
        self.n = len(x0)

    def at(self, x: Array) -> tuple[Array, Array]:
        """Residuals (m,) and Jacobian (m, n); infinite where a motion fails."""
        key = np.asarray(x, float).tobytes()
        if key == self._key:
            return self._found
        parts, self.error = [], None
        trajectories = []
        for e in self.experiments:
            try:
                self.motions += 1
                trajectory = e.simulate(x)
                residuals, jacobian = e.residuals(trajectory, self.n)
            except FAILURES as error:
                self.error = error
                self.failures.append(f"{e.name}: {error}")
                m = sum(other.count for other in self.experiments)
                self._key, self._found = key, (np.full(m, np.inf), np.full((m, self.n), np.inf))
                return self._found
            trajectories.append(trajectory)
            parts.append((residuals, jacobian))
        self.trajectories = trajectories
        self._key = key
        self._found = np.concatenate([r for r, _ in parts]), np.concatenate([j for _, j in parts])
        return self._found


@working("fitting")
def fit(
    solver: Any, times: ArrayLike | None = None, samples: Mapping[str, ArrayLike] | None = None, variables: Wanted = (), *,
    sigma: float | Mapping[str, ArrayLike] | None = None, q: Numbers = None, u: Numbers = None, p: Numbers = None,
    inputs: Any = None, start: float = 0.0, experiments: Sequence[Mapping[str, Any]] | None = None, integrator: str = METHOD,
    rtol: float = RTOL, atol: Any = ATOL, method: str = "trf", loss: str = "linear", undetermined: float = UNDETERMINED,
    most_motions: int | None = None, tolerance: float = 1e-10, hessian: bool = False, **options: Any,
) -> Fit:  # fmt: skip
    """Identify variables from samples of motions, by nonlinear least squares with exact Jacobians.

    Parameters
    ----------
    solver : Solver
        The model.
    times : array_like (nt,)
        Times of the samples, s, increasing.
    samples : mapping of str to array_like (nt,)
        Samples by names of outputs, or by ``q.NAME`` and ``u.NAME``. NaN where there is no sample.
    variables : str, sequence of str, or mapping of str to None, (lower, upper) or Variable
        Variables, as in `objective`. The search begins at the values of the given motion.
    sigma : float, or mapping of str to float or array_like (nt,), optional
        Standard deviations of the samples, in their units. Default: all are equal and follow from the residuals.
    q, u, p : array_like or mapping, optional
        Initial state and parameters where no variable determines them, as in `Solver.simulate`.
    inputs : array_like, tuple, callable, spline or mapping, optional
        Inputs over time, as in `Solver.simulate`.
    start : float, optional
        Start of the motion, s; not after the first sample.
    experiments : sequence of mappings, optional
        Several motions that share the variables, instead of times and samples. Each has ``times`` and ``samples``, and
        may have ``sigma``, ``q``, ``u``, ``p``, ``inputs``, ``start``, ``name``, and ``variables`` of its own. The
        names of its own variables are followed by the name of the experiment, such as ``q0.arm (second)``. Missing
        entries are those of the call.
    integrator : {"dop853", "radau", "rk4"}, optional
        The method of `Solver.simulate`.
    rtol, atol : float, optional
        Tolerances of a step, as in `Solver.simulate`.
    method, loss : str, optional
        As in `scipy.optimize.least_squares`. A loss other than "linear" reduces the weight of outliers; the covariance
        then refers to the weighted samples.
    undetermined : float, optional
        Directions with a singular value below this fraction of the largest are reported as not determined.
    most_motions : int, optional
        Largest number of evaluations of all motions.
    tolerance : float, optional
        Relative change of cost and variables, and size of the gradient, at which the search ends.
    hessian : bool, optional
        Compute the full Hessian of half the sum of squares, and the covariance from it. See ``hessian`` of
        `Solver.judge` for the models that have it; samples must be of outputs, and the loss "linear".
    **options
        Further arguments of `Solver.simulate`.

    Returns
    -------
    Fit
        Values, standard deviations, correlations, residuals.

    Raises
    ------
    SimulationError, AssemblyError, SingularJointError
        If a motion fails at the start of the search. Later failures are counted, and the search steps back.

    Examples
    --------
    >>> times = np.linspace(0.0, 1.0, 11)
    >>> true = solver.simulate(times, p={"length_1": 1.1})
    >>> found = ordernm.fit(solver, times, {"upper": true["upper"]}, "length_1")
    >>> round(found["length_1"], 6)
    1.1
    """
    # long: the docstring describes every argument
    from scipy.optimize import least_squares

    check_given(solver)
    if taken := [word for word in ("on_failure", "sensitivities", "dq0", "du0") if word in options]:
        raise ValueError(f"fit does not take {taken[0]}, because it sets it itself; leave it out")
    if not 0.0 <= undetermined < 1.0:
        raise ValueError(
            f"undetermined is {undetermined!r}, expected a number between 0 and 1, relative to the largest singular value"
        )
    if method not in METHODS:
        raise ValueError(f"method is {method!r}; allowed are {', '.join(map(repr, METHODS))}")
    common = {
        "times": times, "samples": samples, "sigma": sigma, "q": q, "u": u, "p": p, "inputs": inputs, "start": start,
    }  # fmt: skip
    simulation = {"method": integrator, "rtol": rtol, "atol": atol, **options}
    space, parts = take_experiments(solver, common, variables, experiments, simulation)
    if hessian:
        check_hessian(parts, loss)
    problem = _Problem(parts, space.x0)
    residuals, _ = problem.at(space.x0)
    if problem.error is not None:
        raise problem.error
    first_cost = 0.5 * float(residuals @ residuals)
    if len(residuals) < len(space.names):
        raise ValueError(
            f"fit: {counted(len(residuals), 'sample')} cannot determine {counted(len(space.names), 'variable')}; "
            + (
                "give more samples or fewer variables"
                if len(residuals)
                else "all samples are NaN, which means no sample"
            )
        )
    found = least_squares(
        lambda x: problem.at(x)[0], space.x0, jac=lambda x: problem.at(x)[1], bounds=space.x_bounds, method=method, loss=loss,
        ftol=tolerance, xtol=tolerance, gtol=tolerance, max_nfev=most_motions,
    )  # fmt: skip
    residuals, jacobian = problem.at(found.x)
    given = parts[0].sigma_given
    # found.jac is the Jacobian with the weights of the loss
    return Fit.of(
        space, found.x, residuals, found.jac if loss != "linear" else jacobian, tuple(parts), tuple(problem.trajectories),
        sigma_given=given, undetermined=undetermined, success=bool(found.success), message=str(found.message),
        motions=problem.motions, failures=tuple(problem.failures), cost=float(found.cost), first_cost=first_cost,
        by_x=full_hessian(parts, found.x) if hessian else None, search=(problem, found.x, space) if loss == "linear" else None,
    )  # fmt: skip


__all__ = ["Fit", "fit"]
