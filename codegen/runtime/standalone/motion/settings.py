"""Settings of the integration over time: what `Solver.simulate` and `Solver.judge` share, with defaults and checks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, filled
from .controllers import Controller

METHODS = ("rk4", "dop853", "radau")
"""Integration methods, in the order of the constants of ``motion.h``."""

METHOD = "dop853"
RTOL = 1e-9
ATOL = 1e-9
MOST_STEPS = 1_000_000
"""Defaults of a motion: METHOD, RTOL and ATOL (tolerances), and MOST_STEPS, the largest number of steps."""

SMALLEST_TOLERANCE = 1e-14
"""Smallest relative tolerance; smaller errors would be below rounding."""


@dataclass(slots=True)
class Start:
    """The initial state, parameters, inputs and directions of a motion, as the user gives them."""

    q: Numbers
    u: Numbers
    p: Numbers
    inputs: Any
    sensitivities: Sequence[str] | str
    dq0: Numbers
    du0: Numbers
    controller: Controller | None = None


@dataclass(slots=True)
class Settings:
    """Method, tolerances and steps of an integration, checked.

    Attributes
    ----------
    method : str
        One of `METHODS`.
    rtol, atol, atol_sensitivities : float or array_like
        Tolerances of a step; see `Solver.simulate`.
    step, largest_step : float or None
        First or constant step, and upper bound of all steps, s.
    most_steps : int
        Maximum number of steps.
    keyword : str
        Name of the user's argument for the method, for messages.

    Raises
    ------
    ValueError
        If a setting is not allowed.
    """

    method: str
    rtol: float
    atol: Any
    step: float | None
    largest_step: float | None
    most_steps: int
    atol_sensitivities: Any = None
    keyword: str = "method"

    def __post_init__(self) -> None:
        if (
            self.method is METHOD
            and self.rtol is RTOL
            and self.step is self.largest_step is None
            and (self.most_steps is MOST_STEPS)
        ):  # the defaults
            return
        if self.method not in METHODS:
            raise ValueError(f"{self.keyword} is {self.method!r}; allowed are {', '.join(map(repr, METHODS))}")
        if self.method == "rk4" and self.step is None:
            raise ValueError(f"{self.keyword} 'rk4' takes constant steps: give step, s")
        for name in ("rtol", "step", "largest_step", "most_steps"):
            x = getattr(self, name)
            if x is not None and not (isinstance(x, (int, float, np.number)) and math.isfinite(x) and x > 0):
                raise ValueError(f"{name} is {x!r}, expected a positive number")
        if self.rtol < SMALLEST_TOLERANCE:
            raise ValueError(
                f"rtol is {self.rtol:g}, below the rounding of floating-point numbers; allowed are "
                f"{SMALLEST_TOLERANCE:g} and more"
            )

    def tolerances(self, name: str, count: int) -> Array | None:
        """Return ``atol`` or ``atol_sensitivities`` for each entry, (count,), or None if there is none."""
        given = getattr(self, name)
        if given is None:
            return None
        if type(given) is float and 0.0 < given < math.inf:
            return filled((count,), given)
        try:
            found = np.broadcast_to(np.asarray(given, float), (count,)).copy()
        except (TypeError, ValueError):
            raise ValueError(f"{name} is {given!r}, expected a positive number, or {count} of them") from None
        if not (np.isfinite(found).all() and (found > 0).all()):
            raise ValueError(f"{name} has entries that are not positive, expected positive tolerances")
        return found
