"""Forward dynamics: accelerations, their derivatives along seeds, their Jacobians, and rates of the coordinates."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, Times, all_finite
from ..calls.arguments import Seeds
from ..calls.functions import STATE
from ..calls.non_finite import tell_infinite
from ..calls.package import Package
from ..calls.results import empty, overlap, places, put
from .jacobians import ARRAYS, MATRICES, Jacobians, asked_for, jacobians_of


class Dynamics(Package):
    """Forward dynamics."""

    def accelerations(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: Times = 0.0,
        *,
        out: Array | None = None,
    ) -> Array:
        """The derivatives of the speeds, udot (..., nu), by Eqs. 18-24 and 42-56."""
        return self._call("accelerations", (q, u, p, inputs, t), None, out)[0]

    def sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """udot (..., nu) and its total derivative (k, ..., nu) along the seeds (Eqs. 9, 10), exact to rounding."""
        along = (dq, du, dp, dinputs, dt)
        found: tuple[Array, Array] = self._call("sensitivities", (q, u, p, inputs, t), along, out)
        return found

    def jacobians(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: Times = 0.0,
        *,
        wrt: str | Sequence[str] | None = None,
        out: Jacobians | None = None,
    ) -> Jacobians:
        """The partial derivatives of udot, or those by what `wrt` names, ``"q, u"``; the others are not computed, and None."""
        asked, opened, given = asked_for(wrt), self._opened, (q, u, p, inputs, t)
        f = self._find(opened, "jacobians")
        if out is not None and not isinstance(out, Jacobians):
            raise ValueError(f"out is {type(out).__name__}, expected Jacobians, such as those of an earlier call")
        if self._watched and "p" in asked:
            self._look_at_directions("jacobians", given, (None, None, np.eye(self.np), None, None))
        else:
            found = self._calls[MATRICES[asked]](given, None, None if out is None else ARRAYS[asked](out))
            if found is not None:
                return out or (
                    Jacobians(*found) if len(found) == 5 else jacobians_of(dict(zip(asked, found, strict=True)))
                )
        arrays, batch = self._arguments.take(dict(zip(STATE, given, strict=True)), self._left_out)
        shapes = {f"J_{n}": batch + self._shapes[f"J_{n}"] for n in asked}
        J = out or jacobians_of({n: empty(shapes[f"J_{n}"], self._arguments.dtype) for n in asked})
        if not f.has_entries():
            return J
        taken = places(
            [getattr(J, n) for n in asked], [f"J.{n}" for n in asked], list(shapes.values()), self._arguments.dtype
        )
        named = dict(zip(shapes, taken, strict=True))
        # udot, which is computed beside them, has no place
        whole = f.whole_shapes(batch)
        wanted: list[Any] = [
            empty(s, self._arguments.dtype) if r == "udot" else named.get(r)
            for r, s in zip(f.results, whole, strict=True)
        ]
        if out is not None and overlap(taken, arrays):
            put(opened.target.compute(f, arrays, batch), wanted)
        else:
            opened.target.compute(f, arrays, batch, out=wanted)
        if not all(all_finite(x) for x in wanted if x is not None):
            sizes = {f"d{n}": math.prod(self._shapes[n]) for n in f.arguments}
            every, ends = np.eye(sum(sizes.values())), itertools.accumulate(sizes.values())
            units = {s: every[:, end - n : end] for (s, n), end in zip(sizes.items(), ends, strict=True)}
            tell_infinite(opened, f, wanted, arrays, batch, Seeds(units, len(every)))
        for name, place in named.items():
            if name not in f.results:
                place[...] = 0.0
        return J

    def coordinate_rates(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: Times = 0.0,
        *,
        out: Array | None = None,
    ) -> Array:
        """The derivatives of the coordinates, qdot (..., nq), by Eq. 1."""
        return self._call("coordinate_rates", (q, u, p, inputs, t), None, out)[0]

    def coordinate_rate_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """qdot (..., nq) and its total derivative (k, ..., nq) along the seeds."""
        name, along = "coordinate_rate_sensitivities", (dq, du, dp, dinputs, dt)
        found: tuple[Array, Array] = self._call(name, (q, u, p, inputs, t), along, out)
        return found
