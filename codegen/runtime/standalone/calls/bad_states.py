"""How a solver works on batches: on how many threads, and what becomes of states that cannot be computed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Shape
from ..warning import warn
from .arguments import SMALLEST_QUATERNION, Arguments, LeftOut

BAD_STATES = ("error", "nan")

MOST_TOLD = 5
"""So many bad states are told of one by one."""


class Lenient(Arguments):
    """Checks arguments but for numbers that are not finite and short quaternions of single states of a batch.

    Parameters
    ----------
    manifest : dict
    arguments : Arguments
        Those that check everything.
    """

    _is_finite = staticmethod(lambda x: True)
    _finite = staticmethod(lambda x: np.ones((), bool))

    def __init__(self, manifest: Mapping[str, Any], arguments: Arguments):
        super().__init__(manifest, arguments.shapes)
        self.strict = arguments
        initial = np.array(manifest["initial"]["q"], float)
        self.instead = {"q": initial, "p": self.defaults["p"]}

    def _check_quaternions(self, q: Array) -> None:
        """Done for each state in `without_bad`."""

    def without_bad(self, given: Mapping[str, Any], left_out: LeftOut) -> tuple[dict[str, Any], Shape, dict[int, str]]:
        """Arguments with ordinary numbers where states are bad, the shape of the batch, and what is bad by number of state.

        What all states share is checked as always.
        """
        arrays, batch = self.take(given, left_out)
        bad: dict[int, str] = {}
        for name, x in arrays.items():
            entries = 0 if name == "t" else 1
            if np.ndim(x) == entries:
                if name == "t":
                    self.strict.take({"t": x}, left_out)
                else:
                    self.strict.array(name, x, name)
                    if name == "q":
                        self.strict._check_quaternions(x)
                continue
            rows = x[..., None] if name == "t" else x
            found = self._bad_rows(name, rows)
            if not found.any():
                continue
            whole = np.broadcast_to(found, batch)
            for number in np.flatnonzero(whole.reshape(-1)):
                row = np.broadcast_to(rows, (*batch, rows.shape[-1])).reshape(-1, rows.shape[-1])[number]
                bad.setdefault(int(number), self._what(name, row))
            rows = rows.copy()
            rows[found] = self.instead.get(name, 0.0)
            arrays[name] = rows[..., 0] if name == "t" else rows
        return arrays, batch, dict(sorted(bad.items()))

    def _bad_rows(self, name: str, rows: Array) -> Any:
        found = ~np.isfinite(rows).all(axis=-1)
        if name == "q":
            for i in self.quaternions:
                with np.errstate(all="ignore"):
                    e = rows[..., i : i + 4]
                    found |= ~(np.einsum("...i,...i", e, e) >= SMALLEST_QUATERNION**2)
        return found

    def _what(self, name: str, row: Array) -> str:
        """What is bad about a row."""
        for i in np.flatnonzero(~np.isfinite(row)):
            return f"{name} is {row[i]}" if name == "t" else f"{name}[{i}] ({self.names[name][i]}) is {row[i]}"
        return "a quaternion of q is too short for a rotation"


def tell_bad(model: str, bad: Mapping[int, str], batch: Shape) -> None:
    """Warn of states of a batch that cannot be computed."""
    told = []
    for number, what in list(bad.items())[:MOST_TOLD]:
        at = ", ".join(str(int(i)) for i in np.unravel_index(number, batch))
        told.append(f"state [{at}]: {what}")
    more = f"; and {len(bad) - MOST_TOLD} more" if len(bad) > MOST_TOLD else ""
    warn(f"{model}: {len(bad)} of {int(np.prod(batch))} states are NaN: {'; '.join(told)}{more}")


def spread(bad: Mapping[int, str], of: Shape, batch: Shape) -> dict[int, str]:
    """The bad states of a batch that has been broadcast to a larger one."""
    if not bad:
        return {}
    numbers = np.full(math.prod(of), -1)
    numbers[list(bad)] = list(bad)
    whole = np.broadcast_to(numbers.reshape(of), batch).reshape(-1)
    return {int(i): bad[int(whole[i])] for i in np.flatnonzero(whole >= 0)}


__all__ = ["BAD_STATES", "Lenient", "spread", "tell_bad"]
