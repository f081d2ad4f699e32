"""Consistent states of models with loops: loops closed in position, dependent speeds and seeds from velocity closure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Shape, largest
from ..calls.arguments import placing
from ..calls.functions import STATE, Wanted
from ..calls.targets import Opened
from .assembly import ROUNDING, Assembly
from .states import States

POSITION = Wanted("closure", ["position"])


class Loops(States):
    """Consistent states of models that have loops, or none."""

    def _use(self, opened: Opened) -> None:
        super()._use(opened)
        self._assembly = Assembly(opened)

    def _consistent(self, given: tuple[Any, ...]) -> tuple[Array, Array] | None:
        if not self.closure_names:
            return super()._consistent(given)
        speeds = self._one_state("completion", given) if self._is_closed(given) else None
        return None if speeds is None else (given[0].copy(), speeds[0])

    def _consistent_along(
        self, given: tuple[Any, ...], seeds: tuple[Any, ...]
    ) -> tuple[Array, Array, Array, Array] | None:
        if not self.closure_names:
            return super()._consistent_along(given, seeds)
        if self._watched or not self._is_closed(given):
            return None
        found = self._one_state("completion_sensitivities", given, seeds)
        return None if found is None else (given[0].copy(), *found)

    def _is_closed(self, given: tuple[Any, ...]) -> bool:
        """Whether that is one state in plain arrays whose coordinates assembly leaves as they are."""
        if self._arguments.quaternions:
            return False
        gaps = self._one_state(POSITION, given)
        return gaps is not None and largest(gaps[0]) <= ROUNDING and not self._assembly.may_be_turned(given[0])

    def _assembled(self, arrays: Mapping[str, Any], batch: Shape, follow: bool | None = None) -> Array:
        q_new = super()._assembled(arrays, batch)
        if not self.closure_names:
            return q_new
        assembly = self._assembly
        x = placing(arrays, batch, self._opened.manifest)
        axis = self._path_axis(arrays, batch) if follow is None else len(batch) - 1 if follow and batch else None
        if axis is not None and batch[axis] > 1:
            states = np.moveaxis(np.arange(math.prod(batch)).reshape(batch), axis, -1).reshape(-1, batch[axis])
            called = [[_place(n, batch) for n in row] for row in states]
            flat_q, flat_x = q_new.reshape(-1, self.nq), x.reshape(-1, x.shape[-1])
            flat_q[states] = assembly.continued(flat_q[states], flat_x[states], called)
            return q_new
        gaps = np.abs(assembly.newton.gaps(q_new, x if self.prescribed_names else arrays["p"])).max(
            axis=-1, initial=0.0
        )
        open_ones = ~(gaps <= ROUNDING) | assembly.is_turned(q_new, x)
        if not open_ones.any():
            return q_new
        at = np.nonzero(open_ones) if batch else ()
        q_open, x_open = (q_new[at], x[at]) if batch else (q_new[None], x[None])
        places: list[tuple[int, ...]] = (
            [tuple(int(i) for i in place) for place in zip(*at, strict=True)] if batch else [()]
        )
        found = assembly.close(q_open, x_open, places)
        if not batch:
            return found[0]
        q_new[at] = found
        return q_new

    def _path_axis(self, arrays: Mapping[str, Any], batch: Shape) -> int | None:
        """The axis along which states are followed unless the caller says otherwise: that of the time, where a mechanism with
        prescribed motion is given one guess for all times."""
        t = np.asarray(arrays["t"])
        if not self.prescribed_names or t.ndim == 0:
            return None
        axes = [k for k in range(len(batch)) if k >= len(batch) - t.ndim and t.shape[k - len(batch) + t.ndim] > 1]
        if not axes:
            return None
        q = arrays["q"][..., self._assembly.follower.others]
        k = axes[-1] - len(batch) - 1  # counted from the end, for q may have fewer axes
        same = q.ndim < -k or q.shape[k] == 1 or bool((q == np.take(q, [0], axis=k)).all())
        return axes[-1] if same else None

    def _moved(self, q: Array, arrays: Mapping[str, Any]) -> Array:
        q_new = super()._moved(q, arrays)
        return self._assembly.follow(q_new, placing(arrays, (), self._opened.manifest)) if self.closure_names else q_new

    def _completed(self, q_new: Array, arrays: Mapping[str, Any], batch: Shape) -> Array:
        if not self.closure_names:
            return super()._completed(q_new, arrays, batch)
        return self._call("completion", (q_new, *(arrays[n] for n in STATE[1:])))[0]

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
        along = dq_new, du_new, rest["dp"], rest["dinputs"], rest["dt"]
        return q_new, *self._call("completion_sensitivities", tuple([given[n] for n in STATE]), along)


def _place(number: int, batch: Shape) -> tuple[int, ...]:
    """Where a state is in its batch."""
    return tuple(int(i) for i in np.unravel_index(number, batch))
