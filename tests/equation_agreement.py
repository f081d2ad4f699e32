"""Equations of motion in sympy compared with a solver: residuals for its accelerations, matrices and outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from codegen.model import Model
from codegen.reference.dense import DenseEngine
from codegen.symbolic import Equations

State = tuple[Any, Any, Any, Any, float]
"""q, u, p, inputs, t."""


def difference(x: Any, y: Any, scale: Any = 1.0) -> float:
    """The largest difference divided by the largest of y, of the scale and of one."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    assert x.shape == y.shape
    return float(np.abs(x - y).max(initial=0) / max(1.0, np.abs(y).max(initial=0), np.max(np.abs(scale), initial=0)))


def accelerations(found: Equations, numbers: dict[str, Any]) -> Any:
    """udot from the matrices of the equations, according to their form."""
    if found.form == "tree":
        return np.linalg.solve(numbers["M"], numbers["forcing"])[:, 0]
    if found.form == "embedded":
        return (numbers["S"] @ np.linalg.solve(numbers["M"], numbers["forcing"]) + numbers["remainder"])[:, 0]
    J = numbers["J"]
    A = np.block([[numbers["M"], J.T], [J, np.zeros((len(J), len(J)))]])
    return np.linalg.solve(A, np.concatenate([numbers["forcing"], -numbers["rate"]]))[: len(numbers["M"]), 0]


class Agreement:
    """Compares the equations of a model with its solver.

    Parameters
    ----------
    model : Model
    solver : Solver
    found : Equations
        Of the model.
    """

    def __init__(self, model: Model, solver: Any, found: Equations) -> None:
        self.model, self.solver, self.found = model, solver, found
        self.evaluate = found.lambdify(outputs=True)
        self.tree = DenseEngine(replace(model, loops=(), independent=())) if found.form == "multipliers" else None

    def errors(self, state: State) -> dict[str, float]:
        """Relative errors, by compared quantity, at a state that closes the loops.

        The solver's accelerations have to satisfy the equations; mass matrices and outputs have to be equal.
        """
        q, u, p, inputs, t = state
        found, udot = self.found, np.asarray(self.solver.accelerations(*state))
        numbers = self.evaluate(*state, udot)
        M, f = numbers["M"], numbers["forcing"][:, 0]
        result = {"qdot": difference(numbers["qdot"][:, 0], self.solver.coordinate_rates(*state))}
        if found.form == "embedded":
            chosen = [found.u.index(s) for s in found.independent]
            S, r, s = numbers["S"], numbers["remainder"][:, 0], numbers.get("s", np.zeros((len(u), 1)))[:, 0]
            result["S"] = difference(S @ u[chosen] + s, u, np.abs(S) @ np.abs(u[chosen]))
            result["udot"] = difference(S @ udot[chosen] + r, udot, np.abs(S) @ np.abs(udot[chosen]) + np.abs(r))
            udot = udot[chosen]
        left, size = M @ udot, np.abs(M) @ np.abs(udot) + np.abs(f)
        if found.form == "multipliers":
            J, rate, drift = numbers["J"], numbers["rate"][:, 0], numbers.get("drift", np.zeros((len(M), 1)))
            result["closed"] = difference(numbers["position"], 0 * numbers["position"])
            result["J"] = difference(J @ udot, -rate, np.abs(J) @ np.abs(udot) + np.abs(rate))
            if "drift" in numbers:
                result["drift"] = difference(J @ u, -drift[:, 0], np.abs(J) @ np.abs(u))
            multipliers = np.linalg.lstsq(J.T, f - left, rcond=None)[0]
            left, size = left + J.T @ multipliers, size + np.abs(J.T) @ np.abs(multipliers)
            assert self.tree is not None
            result["M"] = difference(M, self.tree.mass_matrix(q, p, inputs, t))
            zero = np.zeros(len(u))
            result["tree forcing"] = difference(-f, self.tree.inverse_dynamics(q, u, zero, p, inputs, t), size)
        else:
            result["M"] = difference(M, self.solver.mass_matrix(q, p, inputs, t))
        result["forcing"] = difference(left, f, size)
        if found.outputs:
            known = dict(zip((o.name for o in self.model.outputs), self.solver.outputs(*state), strict=False))
            for name, value in zip(found.outputs, numbers["outputs"][:, 0], strict=True):
                result[f"output {name}"] = difference(value, known[name])
        return result


def largest(model: Model, solver: Any, found: Equations, states: Sequence[State]) -> tuple[float, str]:
    """The largest error at some states, and the quantity that has it."""
    agreement = Agreement(model, solver, found)
    return max((error, name) for state in states for name, error in agreement.errors(state).items())
