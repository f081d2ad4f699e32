"""What sensitivities of a motion are with respect to: names of parameters, initial values and inputs as directions."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arguments import some
from .arrays import Array, Numbers
from .motion_inputs import Inputs


@dataclass(slots=True)
class Directions:
    """Directions of a motion.

    Attributes
    ----------
    names : tuple of str
    dq, du : array (k, nq), (k, nu)
        Of the initial state; zero where it is the model's that follows.
    dp : array (k, np)
    dinputs : array (k, count, ninputs) or None
        Of the inputs' control points.
    given : bool
        The caller gave derivatives of the initial state.
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


def take_sensitivities(
    solver: Any, names: Sequence[str] | str, dq0: Numbers, du0: Numbers, inputs: Inputs
) -> Directions:
    """Directions from names, checked.

    Raises
    ------
    ValueError
    """
    wanted = (names,) if isinstance(names, str) else tuple(names)
    given = dq0 is not None or du0 is not None
    if not wanted and given:
        rows = len(np.atleast_2d(np.asarray(dq0 if dq0 is not None else du0, float)))
        wanted = tuple(f"direction {i}" for i in range(rows))
        unnamed = True
    else:
        unnamed = False
    k = len(wanted)
    if len(set(wanted)) < k:
        raise ValueError(f"sensitivities name something twice: {some(wanted)}")
    found = Directions(
        wanted, np.zeros((k, solver.nq)), np.zeros((k, solver.nu)), np.zeros((k, solver.np)), None, given
    )
    for row, name in enumerate([] if unnamed else wanted):
        _set(solver, found, row, name, inputs)
    for label, value, place in (("dq0", dq0, "dq"), ("du0", du0, "du")):
        if value is not None:
            array = solver._arguments.array(label, value, place[1:])
            array = array[None] if array.ndim == 1 else array
            shape = getattr(found, place).shape
            if array.shape != shape:
                raise ValueError(f"{label} has shape {array.shape}, expected {shape}: a row for each of {some(wanted)}")
            setattr(found, place, array)
    return found


def _set(solver: Any, found: Directions, row: int, name: Any, inputs: Inputs) -> None:
    if not isinstance(name, str):
        raise ValueError(f"sensitivities hold {name!r}; names are needed, such as 'length' or 'q0.crank'")
    if name in solver.parameter_names:
        found.dp[row, solver.parameter_names.index(name)] = 1.0
        return
    kind, _, of = name.partition(".")
    for word, place, names, independent in (
        ("q0", found.dq, solver.coordinate_names, solver.independent_names),
        ("u0", found.du, solver.speed_names, solver.independent_speed_names),
    ):
        if kind == word and of in names:
            if of not in independent:
                raise ValueError(
                    f"sensitivities: {name} is dependent, it follows from {some(independent)}; name one of these"
                )
            place[row, names.index(of)] = 1.0
            return
    entry = re.fullmatch(r"inputs\.(.+?)(?:\[(\d+)\])?", name)
    if entry and entry[1] in solver.input_names:
        count = len(inputs.values)
        if found.dinputs is None:
            found.dinputs = np.zeros((found.k, count, solver.ninputs))
        if entry[2] is not None and int(entry[2]) >= count:
            raise ValueError(f"sensitivities: {name}: the inputs have {count} values, counted from 0")
        at = slice(None) if entry[2] is None else int(entry[2])
        found.dinputs[row, at, solver.input_names.index(entry[1])] = 1.0
        return
    known = [
        *solver.parameter_names, *(f"q0.{n}" for n in solver.independent_names),
        *(f"u0.{n}" for n in solver.independent_speed_names), *(f"inputs.{n}" for n in solver.input_names),
    ]  # fmt: skip
    near = difflib.get_close_matches(name, known, 1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise ValueError(f"sensitivities: {name!r} is not known; expected is any of {some(known)}{hint}")
