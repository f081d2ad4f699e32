"""A solution of a problem of optimal control, and the error of a problem without a solution."""

from __future__ import annotations

from dataclasses import dataclass

from ..runtime.standalone.arrays import Array


class NotSolvedError(RuntimeError):
    """IPOPT found no optimum.

    Attributes
    ----------
    last : Optimum
        The last point, which is no solution.
    """

    def __init__(self, message: str, last: Optimum):
        super().__init__(message)
        self.last = last


@dataclass(frozen=True, slots=True)
class Optimum:
    """A solution of a problem of optimal control.

    Attributes
    ----------
    value : float
        Value of the objective.
    duration : float
        s.
    t : ndarray (k,)
        Times: the beginning of each segment, its collocation points, and the end.
    y : ndarray (k, n)
        Independent coordinates and speeds at these times.
    input_times : ndarray (m,)
        The collocation points.
    inputs : ndarray (m, ninputs)
        Inputs at these times.
    p : ndarray (np,)
        All parameters.
    design : dict of str to float
        The parameters that were variables.
    gradients : dict of str to float
        Derivatives of the optimal value with respect to the other parameters.
    iterations : int
        Iterations of IPOPT.
    seconds : float
        Time in IPOPT.
    status : str
        Status that IPOPT returned.
    """

    value: float
    duration: float
    t: Array
    y: Array
    input_times: Array
    inputs: Array
    p: Array
    design: dict[str, float]
    gradients: dict[str, float]
    iterations: int
    seconds: float
    status: str

    def __repr__(self) -> str:
        chosen = "".join(f", {n} = {x:.6g}" for n, x in self.design.items())
        return f"<Optimum {self.value:.12g}{chosen}: {self.status}, {self.iterations} iterations, {self.seconds:.2f} s>"
