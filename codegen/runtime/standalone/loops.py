"""Consistent states of models with loops: loops closed in position, dependent speeds and seeds from velocity closure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .arguments import placing
from .arrays import Array, Shape
from .assembly import ROUNDING, Assembly
from .closing_together import FEW
from .states import States
from .targets import Opened


class Loops(States):
    """Consistent states of models that have loops, or none."""

    def _use(self, opened: Opened) -> None:
        super()._use(opened)
        self._assembly = Assembly(opened)

    def _assembled(self, arrays: Mapping[str, Any], batch: Shape) -> Array:
        q_new = super()._assembled(arrays, batch)
        if not self.closure_names:
            return q_new
        assembly = self._assembly
        p = placing(arrays, batch, self._opened.manifest)
        gaps = np.abs(assembly.newton.gaps(q_new, p if self.prescribed_names else arrays["p"])).max(
            axis=-1, initial=0.0
        )
        if (gaps <= ROUNDING).all():
            return q_new
        open_ones = np.nonzero(np.atleast_1d(~(gaps <= ROUNDING)))
        if batch and len(open_ones[0]) >= FEW and q_new.dtype == np.float64:
            closed = assembly.close_together(q_new[open_ones], p[open_ones], open_ones, q_new)
            open_ones = tuple(i[~closed] for i in open_ones)
        for found in zip(*open_ones, strict=True):
            at = tuple(int(i) for i in found[: len(batch)])
            q_new[at] = assembly.close(q_new[at].copy(), p[at].copy(), at)
        return q_new

    def _moved(self, q: Array, arrays: Mapping[str, Any]) -> Array:
        q_new = super()._moved(q, arrays)
        return self._assembly.follow(q_new, placing(arrays, (), self._opened.manifest)) if self.closure_names else q_new

    def _completed(self, q_new: Array, arrays: Mapping[str, Any], batch: Shape) -> Array:
        if not self.closure_names:
            return super()._completed(q_new, arrays, batch)
        return self._values("completion", {**arrays, "q": q_new})[0]

    def _completed_along(
        self,
        q_new: Array,
        arrays: Mapping[str, Any],
        batch: Shape,
        dq_new: Array,
        du_new: Array,
        rest: Mapping[str, Any],
    ) -> tuple[Array, Array, Array, Array]:
        if not self.closure_names:
            return super()._completed_along(q_new, arrays, batch, dq_new, du_new, rest)
        given = {**arrays, "q": q_new, "u": super()._completed(q_new, arrays, batch)}
        along = {**rest, "dq": dq_new, "du": du_new}
        return q_new, *self._along("completion_sensitivities", given, along)
