"""Batches in which some states cannot be computed, for ``bad_states = "nan"``: the results of these states become
NaN."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Shape
from ..warning import warn
from .arguments import SMALLEST_QUATERNION, Arguments, LeftOut

BAD_STATES = ("error", "nan")

MOST_NAMED = 5
"""Maximum number of bad states that a warning names."""


def without_bad(
    strict: Arguments, initial: Array, given: Mapping[str, Any], left_out: LeftOut
) -> tuple[dict[str, Any], Shape, dict[int, str]]:
    """Arguments in which numbers of bad states are replaced by valid ones, the batch shape, and the reason for each bad
    state.

    The reasons have the numbers of the states in the batch as keys. Arguments that all states share are checked as
    usual. `initial` are the coordinates that replace bad rows of q.
    """
    arrays, batch = strict.lenient().take(given, left_out)
    bad: dict[int, str] = {}
    for name, x in arrays.items():
        if np.ndim(x) == (name != "t"):
            strict.take({name: x}, left_out)
            continue
        rows = x[..., None] if name == "t" else x
        found = _bad_rows(strict, name, rows)
        if not found.any():
            continue
        whole = np.broadcast_to(rows, (*batch, rows.shape[-1])).reshape(-1, rows.shape[-1])
        for number in np.flatnonzero(np.broadcast_to(found, batch)):
            bad.setdefault(int(number), _what(strict, name, whole[number]))
        rows = rows.copy()
        rows[found] = initial if name == "q" else strict.defaults.get(name, 0.0)
        arrays[name] = rows[..., 0] if name == "t" else rows
    return arrays, batch, dict(sorted(bad.items()))


def _bad_rows(strict: Arguments, name: str, rows: Array) -> Any:
    found = ~strict.finite(rows).all(axis=-1)
    for i in strict.quaternions if name == "q" else ():
        with np.errstate(all="ignore"):
            e = rows[..., i : i + 4].astype(float)
            found |= ~(np.einsum("...i,...i", e, e) >= SMALLEST_QUATERNION**2)
    return found


def _what(strict: Arguments, name: str, row: Array) -> str:
    """A description of the first bad number in an argument of one state."""
    for i in np.flatnonzero(~strict.finite(row)):
        return f"{name} is {row[i]}" if name == "t" else f"{name}[{i}] ({strict.names[name][i]}) is {row[i]}"
    return "a quaternion of q is too short for a rotation"


def warn_of_bad(model: str, bad: Mapping[int, str], batch: Shape) -> None:
    """Warns of states of a batch that cannot be computed."""
    named = []
    for number, what in list(bad.items())[:MOST_NAMED]:
        at = ", ".join(str(int(i)) for i in np.unravel_index(number, batch))
        named.append(f"state [{at}]: {what}")
    more = f"; and {len(bad) - MOST_NAMED} more" if len(bad) > MOST_NAMED else ""
    warn(f"{model}: {len(bad)} of {int(np.prod(batch))} states are NaN: {'; '.join(named)}{more}")


def spread(bad: Mapping[int, str], of: Shape, batch: Shape) -> dict[int, str]:
    """Indices of bad states in a larger batch, to which the smaller batch of shape `of` is broadcast."""
    if not bad:
        return {}
    numbers = np.full(math.prod(of), -1)
    numbers[list(bad)] = list(bad)
    whole = np.broadcast_to(numbers.reshape(of), batch).reshape(-1)
    return {int(i): bad[int(whole[i])] for i in np.flatnonzero(whole >= 0)}


__all__ = ["BAD_STATES", "spread", "warn_of_bad", "without_bad"]
