"""Directions by name: a design parameter, or an input as ``inputs.motor``."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .arguments import some
from .arrays import Array


class Directions(NamedTuple):
    """Unit seeds.

    Attributes
    ----------
    names : tuple of str
    p : (k, np)
    inputs : (k, ninputs)
    """

    names: tuple[str, ...]
    p: Array
    inputs: Array


def named_directions(asked: str | Sequence[str], parameters: Sequence[str], inputs: Sequence[str]) -> Directions:
    """The directions that names mean.

    Raises
    ------
    ValueError
        A name is not known; tells the nearest one.
    """
    names = (asked,) if isinstance(asked, str) else tuple(asked)
    known = [*parameters, *(f"inputs.{n}" for n in inputs)]
    units = np.zeros((len(names), len(known)))
    for row, name in zip(units, names, strict=True):
        if name not in known:
            near = difflib.get_close_matches(str(name), known, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"sensitivities: {name!r} is not known; expected is any of {some(known)}{hint}")
        row[known.index(name)] = 1.0
    return Directions(names, units[:, : len(parameters)], units[:, len(parameters) :])
