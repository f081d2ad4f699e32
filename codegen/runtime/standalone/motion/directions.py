"""Directions of a motion's sensitivities, from names of parameters, initial values and inputs."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, Numbers
from ..calls.arguments import name_or_names, some
from ..calls.named_entries import Entry, apart, look_up_all, names_of
from .inputs import Inputs


@dataclass(slots=True)
class Directions:
    """Directions of differentiation of a motion.

    Attributes
    ----------
    names : tuple of str
    dq, du : array (k, nq), (k, nu)
        Seeds of the initial state; zero if the model's initial state is used, whose derivatives are added later.
    dp : array (k, np)
    dinputs : array (k, count, nsignals) or None
        Seeds of the inputs' control points.
    given : bool
        Whether the user gave derivatives of the initial state.
    """

    names: tuple[str, ...]
    dq: Array
    du: Array
    dp: Array
    dinputs: Array | None
    given: bool

    @property
    def k(self) -> int:
        return len(self.names)


@functools.lru_cache(64)
def _no_directions(nq: int, nu: int, n_p: int) -> Directions:
    return Directions((), np.empty((0, nq)), np.empty((0, nu)), np.empty((0, n_p)), None, False)


def take_sensitivities(
    solver: Any, names: Sequence[str] | str, dq0: Numbers, du0: Numbers, inputs: Inputs
) -> Directions:
    """Checks names of sensitivities, and returns their directions.

    Raises
    ------
    ValueError
    """
    if names == () and dq0 is None and du0 is None:
        return _no_directions(solver.nq, solver.nu, solver.np)
    known = names_of(solver)
    wanted = apart(known, name_or_names("sensitivities", names))
    given = dq0 is not None or du0 is not None
    if not wanted and given:
        rows = len(np.atleast_2d(np.asarray(dq0 if dq0 is not None else du0, float)))
        wanted, entries = tuple(f"direction {i}" for i in range(rows)), list[Entry]()
    else:
        entries = look_up_all(known, wanted, inputs.counts())
    k = len(wanted)
    found = Directions(
        wanted, np.zeros((k, solver.nq)), np.zeros((k, solver.nu)), np.zeros((k, solver.np)), None, given
    )
    if any(entry.of == "inputs" for entry in entries):
        found.dinputs = np.zeros((k, *inputs.values.shape))
    for row, entry in enumerate(entries):
        match entry.of:
            case "p":
                found.dp[row, entry.at] = 1.0
            case "q":
                found.dq[row, entry.at] = 1.0
            case "u":
                found.du[row, entry.at] = 1.0
            case _:
                assert found.dinputs is not None
                found.dinputs[row, :, entry.at] = inputs.direction(entry.at, entry.row)
    for label, value, place in (("dq0", dq0, "dq"), ("du0", du0, "du")):
        if value is not None:
            array = solver._arguments.array(label, value, place[1:])
            array = array[None] if array.ndim == 1 else array
            shape = getattr(found, place).shape
            if array.shape != shape:
                raise ValueError(f"{label} has shape {array.shape}, expected {shape}: a row for each of {some(wanted)}")
            setattr(found, place, array)
    return found
