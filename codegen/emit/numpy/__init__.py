"""The NumPy target: arrays of double precision, a batch of states at once."""

from __future__ import annotations

import keyword

from ...program.limits import DOUBLE
from ..target import Scalar, Target

FLOAT64 = Scalar("float64", "float64", "doubles", 8, DOUBLE, 2.0**1023 * (2 - 2.0**-52))

NUMPY = Target(
    "numpy",
    (FLOAT64,),
    {
        "sin": "np.sin", "cos": "np.cos", "tan": "np.tan", "asin": "np.arcsin", "acos": "np.arccos", "atan": "np.arctan",
        "atan2": "np.arctan2", "sinh": "np.sinh", "cosh": "np.cosh", "tanh": "np.tanh", "exp": "np.exp", "log": "np.log",
        "sqrt": "np.sqrt", "Absolute": "np.abs", "Maximum": "np.maximum", "Minimum": "np.minimum", "Sign": "np.sign",
        "pow": "np.power", "Power": "np.power", "Floor": "np.floor", "Choice": "choice", "Vanishing": "vanishing",
        "Along": "vanishing",
    },
    frozenset(keyword.kwlist),
)  # fmt: skip

__all__ = ["FLOAT64", "NUMPY"]
