"""The NumPy target: arrays of double precision, over a batch of states at once."""

from __future__ import annotations

import keyword

from ...elementary import ELEMENTWISE
from ...program.limits import DOUBLE
from ..target import Scalar, Target, spelled

FLOAT64 = Scalar("float64", "float64", "doubles", 8, DOUBLE, 2.0**1023 * (2 - 2.0**-52))

NUMPY = Target(
    "numpy",
    (FLOAT64,),
    {
        **spelled("numpy", "np."), **{f: f for f in ELEMENTWISE}, "pow": "np.power", "Power": "np.power", "Floor": "np.floor",
        "Choice": "choice", "Vanishing": "vanishing",
        "Along": "vanishing",
    },
    frozenset(keyword.kwlist),
)  # fmt: skip

__all__ = ["FLOAT64", "NUMPY"]
