"""Switches that a motion with second derivatives passes: what is refused, and the modes of its steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import PackageError
from .results import Segment
from .switches import switch_words

HEAD, AT_ROOT = 6, 5
"""Entry of a step at which the modes of switches begin; entry that is not zero if the step starts or ends at the zero of a
root, where rates have no derivative."""

SIGN, TURN = 0, 3
"""Kinds of switches, as in ``motion.h``."""

AT_THE_SAME_TIME = 1e-9
"""Fraction of a motion's duration within which a switch and an output count as simultaneous, as in the integrator."""

REFUSED = (
    "another switch determines the time at which {} changes its branch",
    "the motion passes where {} changes its branch at the same time as another switch",
    "the motion begins where {} changes its branch, and second derivatives jump there",
)
"""Why second derivatives may not exist, in the order of ``motion.h``."""


def check_switches(
    segment: Segment, manifest: Mapping[str, Any], steps: Array, kinds: Sequence[int], times: Array, needs_outputs: bool
) -> int:
    """The number of steps that begin at switches.

    Parameters
    ----------
    steps : array
        Rows of steps, at least with the modes and flags of switches.
    kinds : sequence of int
        The kind of each switch.
    times : array (nt,)
        Times of outputs.
    needs_outputs : bool
        Whether there are integrals, but no compiled second derivatives of outputs.

    Raises
    ------
    ValueError
        Second derivatives may not exist.
    PackageError
        Second derivatives of integrals need a function that the package lacks.
    """
    of, n = np.array(kinds, int), len(kinds)
    crossed = steps[:, HEAD + n : HEAD + 2 * n] != 0.0
    ends = (steps[:, AT_ROOT] != 0.0) | crossed[:, (of > SIGN) & (of < TURN)].any(axis=1)
    passed = steps[crossed.any(axis=1), 0]
    near = AT_THE_SAME_TIME * (segment.problem.end - segment.problem.start)
    apart = np.abs(times[:, None] - passed).min(axis=1, initial=math.inf)
    reason = _unclear(manifest, segment)
    if ends.any():
        reason = (
            f"at t = {steps[np.argmax(ends), 0]:.9g} s the base of a root or power, such as max(0, x)**1.5, is zero, where "
            "second derivatives are not finite"
        )
    elif (apart <= near).any():
        reason = f"at t = {times[np.argmin(apart)]:.9g} s, where an output is requested, a force or an output changes its branch"
    if reason:
        raise ValueError(f"hessian: {reason}. Gradients are available without hessian")
    if len(passed) and needs_outputs:
        raise PackageError(
            "hessian: a force or an output changes its branch during the motion, and a functional is an integral; generate "
            "the package with --functions 'motion, hessian_products, output_hessian_products'"
        )
    return len(passed)


def _unclear(manifest: Mapping[str, Any], segment: Segment) -> str:
    """The reason why second derivatives may not exist after the switches of a motion; "" if there is none."""
    names = [switch_words(manifest, n) for n in range(len(manifest.get("switches", ())))]
    if segment.r.grazed:
        return f"the motion only touches where {names[segment.r.grazed - 1]} changes its branch"
    if segment.r.not_held:
        return f"where {names[segment.r.not_held - 1]} changes its branch, one branch has no value on the other side"
    if segment.late:
        return f"at t = {segment.late[0]:.9g} s, {names[segment.late[1]]} changes its branch where a loop loses rank"
    if segment.lost:
        return "the motion has no first derivatives along some directions"
    return ""


def lasting_modes(steps: Array, kinds: Sequence[int]) -> Array:
    """Modes (n, nswitches) of the steps: a kink that rounding crosses repeatedly has no mode, and here its next one."""
    n = len(kinds)
    modes, crossed = steps[:, HEAD : HEAD + n].copy(), steps[:, HEAD + n : HEAD + 2 * n]
    for row, k in reversed(np.argwhere((crossed != 0.0) & (modes == 0.0)).tolist()):
        later = np.flatnonzero(modes[row:, k])
        if kinds[k] == SIGN and len(later):
            modes[row : row + later[0], k] = modes[row + later[0], k]
    return modes


__all__ = ["HEAD", "REFUSED", "check_switches", "lasting_modes"]
