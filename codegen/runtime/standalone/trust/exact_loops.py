"""Closes loops in extended precision, from states that are closed in double precision."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Shape, normalise
from ..assembly.loops import Loops
from ..calls.arguments import placing
from ..calls.targets import Opened

NEWTON = 60
"""Maximum number of Newton steps in extended precision."""

LEFT = 5
"""Number of digits that a closure may lack if no step improves it."""

SAME = 1e-13
"""Relative change of coordinates below which closing the loops in double precision leaves them as they are."""


class ExactLoops(Loops):
    """Computes consistent states in extended precision.

    Parameters
    ----------
    exact : Extended
    solver : Solver
        The same solver in double precision.
    """

    def __init__(self, exact: Any, solver: Any):
        super().__init__(exact, solver._states._equilibrium)
        self.exact, self.solver = exact, solver

    def _closing(self) -> Opened:
        opened: Opened = self.solver._open(self._opened.number)
        return opened

    def assembled(self, arrays: Mapping[str, Any], batch: Shape, follow: bool | None = None) -> Array:
        q_new = np.broadcast_to(arrays["q"], (*batch, self.nq)).astype(object)
        normalise(q_new, self._arguments.quaternions)
        p = placing(arrays, batch, self._opened.manifest)
        rough = {n: np.asarray(arrays[n]).astype(float) for n in ("p", "inputs", "t") if n in arrays}
        near = super().assembled({"q": q_new.astype(float), **rough}, batch, follow)
        for at in np.ndindex(batch):
            moved = np.abs(near[at] - q_new[at].astype(float)) > SAME * (1.0 + np.abs(near[at]))
            q_new[at] = self._closed(np.where(moved, self.exact._digits.to_mpf(near[at]), q_new[at]), p[at], at)
        return q_new

    def _closed(self, q: Any, p: Any, at: tuple[int, ...]) -> Any:
        """Closes, in extended precision, coordinates (nq,) that are closed in double precision."""
        opened, assembly, exact = self._opened, self.assembly, self.exact
        u, named = np.zeros(self.nu), assembly.newton.named

        def gaps(q: Any) -> Any:
            found = opened.target.compute(opened.functions["closure"], named(q, p) | {"u": u}, ())[0]
            return np.abs(found)[assembly.kept]

        left = gaps(q)
        for _ in range(NEWTON):
            (step,) = opened.target.compute(opened.functions["newton_step"], named(q, p), ())
            trial = q + step
            normalise(trial, self._arguments.quaternions)
            after = gaps(trial)
            if not 2 * max(after) < max(left):
                break
            q, left = trial, after
        if not max(left) < exact.mp.mpf(10) ** (LEFT - exact.digits):
            where = f" (state {list(at)} of the batch)" if at else ""
            digits = f" in {exact.digits} digits{where}"
            raise assembly.open(int(np.argmax(left)), float(max(left)), digits)
        return q
