"""Directions by name: a design parameter, or an input as ``inputs.motor``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..calls.named_entries import Names, apart, look_up


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
    known = Names(parameters, inputs)
    names = apart(known, (asked,) if isinstance(asked, str) else tuple(asked))
    entries = [look_up(known, name) for name in names]
    found = Directions(names, np.zeros((len(names), len(parameters))), np.zeros((len(names), len(inputs))))
    for row, entry in enumerate(entries):
        (found.p if entry.of == "p" else found.inputs)[row, entry.at] = 1.0
    return found
