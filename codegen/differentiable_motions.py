"""Motions as functions of parameters, initial values and inputs, for libraries that differentiate functions."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .design.variables import Variables
from .runtime.standalone.arrays import Array
from .runtime.standalone.motion.functionals import WeightedResults

OWN = ("wrt", "sensitivities", "dq0", "du0", "hessian")
"""Options of `Solver.judge` and `Solver.simulate` that the variables determine; callers may not set them."""

FEW = 8
"""Largest number of variables for which sensitivities cost less than one adjoint; they are computed eight at a time."""

SAME = {"rtol": "rtol", "atol": "atol", "method": "integrator", "step": "step", "largest_step": "largest_step",
        "most_steps": "most_steps"}  # fmt: skip
"""Options of `Solver.simulate` that `Solver.judge` needs to take the same steps, and the names of these options in
`Solver.judge`."""


class Moved(NamedTuple):
    """States and outputs of a motion.

    Attributes
    ----------
    q, u, outputs : array (nt, nq), (nt, nu), (nt, noutputs)
    """

    q: Any
    u: Any
    outputs: Any


class DifferentiableMotion:
    """Results of a motion, and their derivatives with respect to variables.

    Attributes
    ----------
    names : tuple of str
        The k variables, in the order of the function's argument x.
    shapes : tuple of tuple of int
        Shapes of the results.
    """

    member = ""
    shapes: tuple[tuple[int, ...], ...]

    def __init__(self, solver: Any, t: Any, wrt: str | Sequence[str], options: Mapping[str, Any]):
        if not hasattr(solver, self.member):
            raise TypeError(f"expected a solver with {self.member}, not {type(solver).__name__}")
        for name in (n for n in OWN if n in options):
            raise TypeError(
                f"{self.member}: {name} is not an option here; the variables in wrt are the function's argument"
            )
        self._solver, self._partition = solver, solver.partition
        self.options = {n: _copied(x) for n, x in options.items()}
        given = {n: self.options.pop(n, None) for n in ("q", "u", "p", "inputs")}
        times = np.atleast_1d(np.asarray(t, float))
        span = (0.0, float(times[0])) if len(times) == 1 else (float(times[0]), float(times[-1]))
        wanted = wrt if isinstance(wrt, str) else list(wrt)
        self._variables = Variables(solver, wanted, **given, interval=span)
        self.names = self._variables.names
        self._variables.origin, self._variables.scale = np.zeros(len(self.names)), np.ones(len(self.names))
        self._last: tuple[bytes, tuple[Array, ...], tuple[Array, ...]] | None = None

    @property
    def solver(self) -> Any:
        """The solver, with the partition that it had when this object was made."""
        if self._solver.partition != self._partition:
            self._solver = copy.copy(self._solver)
            self._solver.use_partition(self._partition)
            self._variables.solver = self._solver
        return self._solver

    def check(self, shape: tuple[int, ...], kind: str) -> None:
        """Raises if an argument does not hold a number for each variable."""
        of = f"{self.member} of {self._solver.name}"
        if shape != (len(self.names),):
            raise ValueError(f"{of}: x has shape {shape}, expected ({len(self.names)},): {', '.join(self.names)}")
        if kind != "float64":
            raise TypeError(f"{of}: x has type {kind}, expected float64")

    def values(self, x: Any, ahead: bool = False) -> tuple[Array, ...]:
        """The results; with `ahead`, derivatives will be needed, and are computed at the same time if that is cheaper."""
        x = np.asarray(x, float)
        if ahead and (self.member == "judge" or len(x) <= FEW):
            return self._both(x)[0]
        return self._run(x)

    def pushed(self, x: Any, v: Any) -> tuple[Array, ...]:
        """Derivatives of the results along directions (..., k)."""
        return tuple(np.moveaxis(np.tensordot(j, np.asarray(v), (-1, -1)), range(j.ndim - 1), range(1 - j.ndim, 0))
                     for j in self._both(np.asarray(x, float))[1])  # fmt: skip

    def pulled(self, x: Any, weights: Sequence[Any]) -> Array:
        """Gradients (..., k) of weighted sums of the results."""
        found: Any = 0.0
        for j, w in zip(self._both(np.asarray(x, float))[1], weights, strict=True):
            axes = j.ndim - 1
            found = found + np.tensordot(np.asarray(w), j, (tuple(range(-axes, 0)), tuple(range(axes))))
        return np.asarray(found)

    def no_second(self) -> str:
        """The message of the error that a second derivative raises."""
        return f"{self.member} of {self._solver.name}: no second derivatives; differentiate once"

    def _known(self, x: Array) -> bool:
        """Whether derivatives at x are known from the last motion with derivatives."""
        return self._last is not None and self._last[0] == x.tobytes()

    def _both(self, x: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """Results and their Jacobians, with the variables on the last axis."""
        last = self._last
        if last is None or last[0] != x.tobytes():
            self._last = last = (x.tobytes(), *self._differentiated(x))
        return last[1:]

    def _run(self, x: Array) -> tuple[Array, ...]:
        raise NotImplementedError

    def _differentiated(self, x: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        raise NotImplementedError


class JudgedMotion(DifferentiableMotion):
    """Values (m,) of functionals of a motion."""

    member = "judge"

    def __init__(self, solver: Any, t: Any, functionals: Any, wrt: str | Sequence[str], options: Mapping[str, Any]):
        super().__init__(solver, t, wrt, options)
        several = list(functionals) if isinstance(functionals, (list, tuple)) else [functionals]
        self.t, self.functionals = copy.deepcopy(t), copy.deepcopy(several)
        self.shapes = ((len(several),),)

    def _run(self, x: Array) -> tuple[Array, ...]:
        motion = self._variables.motion(x, derivatives=False)
        return (self.solver.judge(self.t, self.functionals, **motion, **self.options).values,)

    def _differentiated(self, x: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        found = self.solver.judge(self.t, self.functionals, **self._variables.motion(x), wrt=self.names, **self.options)
        return (found.values,), (found.gradients,)


class SimulatedMotion(DifferentiableMotion):
    """States and outputs of a motion at given times."""

    member = "simulate"

    def __init__(self, solver: Any, t: Any, wrt: str | Sequence[str], options: Mapping[str, Any]):
        super().__init__(solver, t, wrt, options)
        self.t = np.array(t, float)
        if self.t.ndim != 1 or len(self.t) < 2:
            raise ValueError(f"simulate: t has shape {self.t.shape}, expected at least two increasing times, (nt,)")
        for name in (n for n in ("events", "on_failure") if n in options):
            raise TypeError(f"simulate: {name} is not an option here, since the number of results is fixed")
        self.shapes = tuple((len(self.t), n) for n in (solver.nq, solver.nu, solver.noutputs))

    def pulled(self, x: Any, weights: Sequence[Any]) -> Array:
        """Gradients (..., k) of weighted sums of the results; by the adjoint if that is cheaper."""
        x, each = np.asarray(x, float), [np.asarray(w, float) for w in weights]
        several = each[0].shape[:-2]
        cheap = len(x) > FEW * math.prod(several) and self.options.keys() <= SAME.keys() and self._reverses
        if not cheap or self._known(x):
            return super().pulled(x, weights)
        q, u, outputs = (w.reshape(-1, *shape) for w, shape in zip(each, self.shapes, strict=True))
        wanted = [WeightedResults(self.t, *w) for w in zip(np.concatenate([q, u], axis=-1), outputs, strict=True)]
        options = {SAME[n]: y for n, y in self.options.items()}
        found = self.solver.judge(
            (self.t[0], self.t[-1]), wanted, **self._variables.motion(x), wrt=self.names, method="adjoint", **options
        )
        return np.asarray(found.gradients).reshape(*several, -1)

    @property
    def _reverses(self) -> bool:
        """Whether the package has the functions of the adjoint."""
        return hasattr(self.solver, "judge") and "sensitivities_transposed" in self.solver._functions

    def _run(self, x: Array) -> tuple[Array, ...]:
        run = self.solver.simulate(self.t, **self._variables.motion(x, derivatives=False), **self.options)
        return run.q, run.u, run.outputs

    def _differentiated(self, x: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        run = self.solver.simulate(self.t, **self._variables.motion(x), sensitivities=self.names, **self.options)
        return (run.q, run.u, run.outputs), tuple(np.moveaxis(d, 0, -1) for d in (run.dq, run.du, run.doutputs))


def _copied(x: Any) -> Any:
    """Copies arrays, since the caller may change them before derivatives read them; returns other objects as they are."""
    if isinstance(x, np.ndarray):
        return x.copy()
    if isinstance(x, Mapping):
        return {n: _copied(y) for n, y in x.items()}
    return type(x)(map(_copied, x)) if type(x) in (list, tuple) else x
