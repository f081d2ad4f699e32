"""Consistent states of models with loops: closes positions, and computes dependent entries of speeds and seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, Shape, Times, largest
from ..calls.arguments import placing, some
from ..calls.functions import STATE, Wanted
from ..calls.targets import Opened
from ..warning import warn
from .assembly import ROUNDING, Assembly
from .open_states import warn_of_dependent_speeds
from .states import States

POSITION = Wanted("closure", ["position"])

FAR_FROM_NAMED = 1e-3
"""rad or m: a user may give dependent coordinates by name, and no independent one. A warning reports a larger change of such a
coordinate."""


class Loops(States):
    """Consistent states of models with loops."""

    _made: tuple[Opened, Assembly] | None = None

    @property
    def assembly(self) -> Assembly:
        """The assembly of the partition in use."""
        opened, made = self._closing(), self._made
        if made is None or made[0] is not opened:
            self._made = made = opened, Assembly(opened)
        return made[1]

    def _closing(self) -> Opened:
        """The generated functions that close loops."""
        return self._opened

    def _consistent(self, given: tuple[Any, ...]) -> tuple[Array, Array] | None:
        speeds = self.package._one_state("completion", given) if self._is_closed(given) else None
        return None if speeds is None else (given[0].copy(), speeds[0])

    def consistent_along(
        self, given: tuple[Any, ...], seeds: tuple[Any, ...]
    ) -> tuple[Array, Array, Array, Array] | None:
        if self._watched or not self._is_closed(given):
            return None
        found = self.package._one_state("completion_sensitivities", given, seeds)
        return None if found is None else (given[0].copy(), *found)

    def _is_closed(self, given: tuple[Any, ...]) -> bool:
        """Whether `given` is one state in float64 vectors that assembly would not change."""
        if self._arguments.quaternions:
            return False
        gaps = self.package._one_state(POSITION, given)
        return gaps is not None and largest(gaps[0]) <= ROUNDING and not self.assembly.may_be_turned(given[0])

    def assemble(
        self, q: Numbers, u: Numbers, p: Numbers, inputs: Numbers, t: Times, follow: bool | None = None
    ) -> tuple[Array, Array]:
        found = super().assemble(q, u, p, inputs, t, follow)
        warn_of_dependent_speeds(self.package, u)
        if isinstance(q, Mapping):
            self._look_at_named(q, found[0])
        return found

    def _look_at_named(self, q: Mapping[str, Any], q_new: Array) -> None:
        """Warns if a mapping names dependent coordinates alone and assembly has changed them."""
        given = np.logical_not(self._arguments.omitted("q", q))
        free = [name in self.independent_names for name in self.coordinate_names]
        if not any(free) or not given.any() or given[free].any():
            return
        typed = np.broadcast_to(self._arguments.take({"q": q}, self._left_out)[0]["q"], q_new.shape)
        off = np.where(given, np.abs(q_new - typed), 0.0)
        if off.max() > FAR_FROM_NAMED:
            worst = np.unravel_index(int(off.argmax()), off.shape)
            name = self.coordinate_names[worst[-1]]
            warn(
                f"assemble: {name} is a dependent coordinate, so {typed[worst]:.4g} is a guess, and it becomes "
                f"{q_new[worst]:.4g}; the independent coordinates ({some(self.independent_names)}) keep their initial values. "
                f"Give these, or name {name} under `independent` of the model"
            )

    def assembled(self, arrays: Mapping[str, Any], batch: Shape, follow: bool | None = None) -> Array:
        q_new = super().assembled(arrays, batch)
        assembly = self.assembly
        x = placing(arrays, batch, self._opened.manifest)
        axis = self._path_axis(arrays, batch) if follow is None else len(batch) - 1 if follow and batch else None
        if axis is not None and batch[axis] > 1:
            states = np.moveaxis(np.arange(math.prod(batch)).reshape(batch), axis, -1).reshape(-1, batch[axis])
            called = [[_place(n, batch) for n in row] for row in states]
            flat_q, flat_x = q_new.reshape(-1, self.nq), x.reshape(states.size, x.shape[-1])
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
        """The batch axis along which states are continued by default: the time axis, if motion is prescribed and all times
        share one guess."""
        t = np.asarray(arrays["t"])
        if not self.prescribed_names or t.ndim == 0:
            return None
        axes = [k for k in range(len(batch)) if k >= len(batch) - t.ndim and t.shape[k - len(batch) + t.ndim] > 1]
        if not axes:
            return None
        q = arrays["q"][..., self.assembly.follower.others]
        k = axes[-1] - len(batch) - 1  # axes are counted from the end, since q may have fewer axes
        same = q.ndim < -k or q.shape[k] == 1 or bool((q == np.take(q, [0], axis=k)).all())
        return axes[-1] if same else None

    def moved(self, q: Array, arrays: Mapping[str, Any]) -> Array:
        q_new = super().moved(q, arrays)
        return self.assembly.follow(q_new, placing(arrays, (), self._opened.manifest))

    def completed(self, q_new: Array, arrays: Mapping[str, Any], batch: Shape) -> Array:
        return self._call("completion", (q_new, *(arrays[n] for n in STATE[1:])))[0]

    def _completed_along(
        self, at: Mapping[str, Any], batch: Shape, seeds: tuple[Any, ...]
    ) -> tuple[Array, Array, Array]:
        u, dq, du = self._call("completion_sensitivities", tuple(at[n] for n in STATE), seeds)
        return u, dq, du


def _place(number: int, batch: Shape) -> tuple[int, ...]:
    """Index of a state in its batch."""
    return tuple(int(i) for i in np.unravel_index(number, batch))
