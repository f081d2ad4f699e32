"""Tests whether prescribed motion with branches has a jump in velocity during a simulated motion.

The model reader tests the default parameters only; this module tests the parameters and inputs of the motion. The
impulse of a jump in velocity would be ignored, so a motion ends before the jump.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ....jumps import Known, Pair, from_to, jumps, switched, zeros
from ..arrays import Array
from .inputs import Inputs

SAMPLES = 2000
"""Number of times at which switching functions are evaluated; zeros of linear functions are exact, extrema are
refined."""


def first_kink(motion: Sequence[Mapping[str, Any]], known: Known, times: Array) -> tuple[float, str] | None:
    """The first jump of prescribed motion or of its velocity during a motion, with a message; None if there is none.

    Parameters
    ----------
    motion : sequence of mapping
        Prescribed motions, with the keys ``name``, ``tree`` and ``names`` (variables of the tree); see the manifest.
    known : callable
    times : array
        Increasing times from the start to the end of the motion, at which switching functions are evaluated.
    """
    found: list[tuple[float, str]] = []
    for one in motion:
        tree = _hashable(one["tree"])
        at = sorted({t for s in dict.fromkeys(s for _, s in switched(tree)) for t in zeros(s, known, times, times[-1])})
        for jump in jumps(tree, known, np.array(at))[:1] if at else ():
            message = (
                f"the {('value', 'velocity')[jump.order]} of the prescribed motion of {one['name']!r} jumps "
                f"{from_to(jump.before, jump.after)} there, at these parameters and inputs, and the impulse on other bodies "
                f"would be ignored; use an expression with continuous velocity, such as step(t, from, to)"
            )
            found.append((at[jump.at], message))
    return min(found, default=None)


def _hashable(tree: Any) -> Any:
    """Converts nested lists to nested tuples."""
    return tuple(map(_hashable, tree)) if isinstance(tree, (list, tuple)) else tree


def known_of(names: Sequence[str], p: Array, input_names: Sequence[str], inputs: Inputs) -> Known:
    """The variables of prescribed motions, as functions of time."""
    parameters = {n: (np.float64(x), 0.0) for n, x in zip(names, p, strict=True)}

    def known(t: Array) -> Mapping[str, Pair]:
        values, rates = inputs.at(t), inputs.rate(t)
        of_inputs = {n: (values[..., i], rates[..., i]) for i, n in enumerate(input_names)}
        return {**parameters, **of_inputs, "t": (t, 1.0)}

    return known


def times_of(start: float, end: float, inputs: Inputs) -> Array:
    """Times at which switching functions are evaluated, with several between any two knots."""
    found = np.linspace(start, end, SAMPLES)
    if inputs.knots is not None:
        knots = np.unique(np.clip(inputs.knots, start, end))
        between = knots[:-1, None] + np.diff(knots)[:, None] * np.linspace(0.0, 1.0, 5)
        found = np.union1d(found, between)
    return found
