"""Jumps of prescribed motion or of its velocity, at which other bodies would receive an impulse.

A node with branches has a switching function, such as ``t - 0.5`` in ``max(0, t - 0.5)``. At the zeros of this
function, the values of the motion from both sides are compared, each with the branches of its side. A jump of the
acceleration alone is not reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..jumps import Known, changes, evaluated, jumps, switched, zeros
from .expressions import Expression
from .grammar import Tree
from .rates import rates_of

MOST_TIMES: Final = 8
"""Number of zeros examined of a switching function that is not linear."""

TIMES: Final = np.array(sorted({*np.logspace(-6, 6, 1201).tolist(), *np.linspace(0.0, 100.0, 2001).tolist()}))
"""Times in s at which switching functions are evaluated to find changes of sign; zeros of linear functions are computed
directly."""


@dataclass(frozen=True)
class Kink:
    """A jump of a motion or of its velocity.

    Attributes
    ----------
    node : Expression
        The node that is not smooth at the jump.
    t : float or None
        Time in s; None if it depends on inputs.
    order : int
        0 if the motion itself jumps, 1 if its velocity does.
    before, after : float
    """

    node: Expression
    t: float | None
    order: int
    before: float
    after: float


def find_kink(value: Expression, parameters: Mapping[str, float], inputs: frozenset[str]) -> Kink | None:
    """The first jump of a motion or its velocity at given parameters, for t >= 0 and any inputs; None if none is found."""
    moving = {"t", *inputs}
    branching = [(n, s, of) for n, s in switched(value.tree) if not (of := Expression(s).names).isdisjoint(moving)]
    if not branching:
        return None
    rng = np.random.default_rng(0)
    at: dict[str, Any] = {n: (np.float64(x), 0.0) for n, x in parameters.items()}
    of_inputs = {x: [float(rng.uniform(0.3, 0.9)) for _ in (x, *rates_of(x))] for x in sorted(inputs)}
    at |= {x: (np.float64(here), rate) for x, (here, rate, _) in of_inputs.items()}

    def of_time(t: np.ndarray) -> dict[str, Any]:
        return {**at, "t": (t, 1.0)}

    found = [
        (t, n) for n, s, of in branching if of.isdisjoint(inputs) for t in zeros(s, of_time, TIMES, np.inf, MOST_TIMES)
    ]
    if found:
        found.sort(key=lambda zero: zero[0])
        for j in jumps(value.tree, of_time, np.array([x for x, _ in found])):
            t, node = found[j.at]
            return Kink(Expression(node), t, j.order, j.before, j.after)
    for node, s, of in branching:
        for name in sorted(of & inputs):
            for known, when in _switched_by(s, at, of_inputs, name, rng):
                for j in jumps(value.tree, known, when):
                    return Kink(Expression(node), None, j.order, j.before, j.after)
    return None


def _switched_by(
    s: Tree, at: Mapping[str, Any], inputs: Mapping[str, list[float]], name: str, rng: np.random.Generator
) -> Iterator[tuple[Known, np.ndarray]]:
    """Yields pairs: a function that returns the values of all names at given times, and the time at which the input
    makes the switching function zero."""
    values = np.concatenate([-np.logspace(3, -3, 300), [0.0], np.logspace(-3, 3, 300)])
    for begin in rng.uniform(0.1, 2.0, 4).tolist():
        for x in changes(_of_input(s, {**at, "t": (np.float64(begin), 1.0)}, name), values, MOST_TIMES):
            states = {**inputs, name: [x, *inputs[name][1:]]}

            def known(
                t: np.ndarray, begin: float = begin, states: Mapping[str, list[float]] = states
            ) -> dict[str, Any]:
                gone = t - begin
                moved = {
                    y: (here + gone * (first + 0.5 * gone * second), first + gone * second)
                    for y, (here, first, second) in states.items()
                }
                return {**at, **moved, "t": (t, 1.0)}

            yield known, np.array([begin])


def _of_input(s: Tree, at: Mapping[str, Any], name: str) -> Callable[[np.ndarray], np.ndarray]:
    """The values of a switching function for values of one input."""
    return lambda x: evaluated(s, {**at, name: (x, 0.0)}, x.shape)[0]
