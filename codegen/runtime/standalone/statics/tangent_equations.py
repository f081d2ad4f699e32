"""The matrices of the linearised equations of motion, and their derivatives with respect to parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..calls.package import Package, state
from ..state.derivatives import CURVED
from .jets import Jet
from .linearization import Matrices
from .second_derivatives import SecondDerivatives
from .tangent_space import TangentSpace

NUMBERS = 4096
"""Largest number of directions times parameters per call, which limits the memory."""


class Point(NamedTuple):
    """One state, without batch axes."""

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: float

    def named(self) -> dict[str, Any]:
        """The state as arguments by name."""
        return state(*self)


class Motion(NamedTuple):
    """Derivatives of a state with respect to m parameters: (m, n) for each array."""

    q: Array
    u: Array
    p: Array
    inputs: Array


class TangentEquations:
    """The linearised equations about a state.

    Let w be the small motion along the tangents N, v the change of the independent speeds u, and D the derivative in q. Then
    ``dq = N w`` and ``d(qdot) = D(N u)[N w] + N v``. The left side is also ``d/dt(N w) = D(N w)[N u] + N w'``, so

        w' = v + N^+ (D(N u)[N w] - D(N w)[N u]) = v + W w        v' = D udot[N w] + (d udot/du) v

    W w is the Lie bracket of the motions N u and N w. It is zero at rest, and for joints whose speeds are rates of coordinates.
    For a quaternion it is ``w x u``, because small rotations turn with the body. The bracket of two motions that keep
    the loops closed also keeps the loops closed, so the projection N^+ is exact.
    """

    def __init__(self, package: Package, space: TangentSpace, at: Point, outputs: list[int]):
        self._call, self.space, self.at, self.outputs = package._call, space, at, outputs
        self._functions, self._noutputs = package._functions, package.noutputs
        n, ninputs = space.n, len(at.inputs)
        self.tangents: Array = self._call("coordinate_rates", (at.q, space.units, at.p, None, 0.0))[0]
        self.seeds: dict[str, Any] = {
            "dq": np.concatenate([self.tangents, np.zeros((n + ninputs, len(at.q)))]),
            "du": np.concatenate([np.zeros((n, len(at.u))), space.units, np.zeros((ninputs, len(at.u)))]),
            "dinputs": np.concatenate([np.zeros((2 * n, ninputs)), np.eye(ninputs)]),
        }
        self.moves = bool(at.u.any())

    def matrices(self) -> tuple[Array, Matrices]:
        """udot (n,) of the independent speeds, and the matrices."""
        along = (self.seeds["dq"], self.seeds["du"], None, self.seeds["dinputs"], None)
        udot, dudot = self._call("sensitivities", tuple(self.at), along)
        dy = np.zeros((len(dudot), 0))
        if self.outputs:
            dy = self._call("output_sensitivities", tuple(self.at), along)[1][:, self.outputs]
        own = self.space.speeds
        return udot[own], self._matrices(self._bracket(), np.eye(self.space.n), dudot[:, own], dy)

    def derivatives(self, second: Callable[[], SecondDerivatives], along: Motion) -> Matrices:
        """Derivatives (m, ...) of the matrices if the state changes by `along`.

        They come from compiled Hessian products if the package has them, else from `second`, the NumPy module on dual numbers.
        """
        width = max(1, NUMBERS // max(1, len(self.seeds["dq"])))
        starts = range(0, max(1, len(along.p)), width)
        parts = [self._derivatives(second, Motion(*(x[i : i + width] for x in along))) for i in starts]
        return Matrices(*(np.concatenate(found) for found in zip(*parts, strict=True)))

    def _derivatives(self, second: Callable[[], SecondDerivatives], along: Motion) -> Matrices:
        at, n, m = self.at, self.space.n, len(along.p)
        dN = self._rates_along(at.q, self.space.units, dq=along.q[:, None], dp=along.p[:, None])[1]  # shape (m, n, nq)
        dudot = self._changes("accelerations", self.space.speeds, second, along, dN)
        dy = np.zeros((m, dudot.shape[1], 0))
        if self.outputs:
            dy = self._changes("outputs", self.outputs, second, along, dN)
        return self._matrices(self._bracket_derivatives(second, along, dN), np.zeros((n, n)), dudot, dy)

    def _changes(self, of: str, rows: Any, second: Callable[[], SecondDerivatives], along: Motion, dN: Array) -> Array:
        """Changes (m, 2n + ninputs, rows) of the derivatives of some results along the seeds; the tangents change by dN."""
        first = "sensitivities" if of == "accelerations" else "output_sensitivities"
        if CURVED[of].wanted.name not in self._functions or not len(dN):
            slope = np.zeros((*self.seeds["dq"].shape, len(dN)))
            slope[: self.space.n] = np.moveaxis(dN, 0, -1)
            seeds = {**self.seeds, "dq": Jet(self.seeds["dq"], slope)}
            return np.moveaxis(second().along(first, self._moved(along), seeds)[1].slope[:, rows], -1, 0)
        size = len(self.at.u) if of == "accelerations" else self._noutputs
        weights = np.eye(size)[rows]
        states = tuple(np.broadcast_to(x, (len(rows), *np.shape(x))) for x in self.at)
        seeds_of = tuple(np.broadcast_to(x[:, None], (len(x), len(rows), x.shape[1])) for x in along)
        changes = self._call(CURVED[of].wanted, (*states, weights), (*seeds_of, None))
        pairs = ((changes[0], "dq"), (changes[1], "du"), (changes[3], "dinputs"))
        found = np.swapaxes(sum(x @ self.seeds[name].T for x, name in pairs), 1, 2)
        turned = self._call(first, tuple(self.at), (dN.reshape(-1, dN.shape[2]), None, None, None, None))[1][:, rows]
        found[:, : self.space.n] += turned.reshape(*dN.shape[:2], len(rows))
        return found

    def _moved(self, along: Motion) -> dict[str, Any]:
        """The state, as dual numbers that change by `along`."""
        at = self.at
        return {
            "q": Jet(at.q, along.q.T), "u": Jet(at.u, along.u.T), "p": Jet(at.p, along.p.T),
            "inputs": Jet(at.inputs, along.inputs.T), "t": at.t,
        }  # fmt: skip

    def _rates_along(self, q: Array, u: Array, dq: Array, dp: Array | None = None) -> tuple[Array, Array]:
        """qdot of a state, and its derivatives along seeds."""
        given, along = (q, u, self.at.p, None, 0.0), (dq, None, dp, None, None)
        return self._call("coordinate_rate_sensitivities", given, along)

    def _bracket(self) -> Array:
        """The matrix W (n, n) of the Lie bracket; zero at rest."""
        if not self.moves:
            return np.zeros((self.space.n, self.space.n))
        q, u = self.at[:2]
        qdot, here = self._rates_along(q, u, dq=self.tangents)
        there = self._rates_along(q, self.space.units, dq=qdot)[1][0]
        return self.space.components(self.tangents, here - there).T

    def _bracket_derivatives(self, second: Callable[[], SecondDerivatives], along: Motion, dN: Array) -> Array:
        """Derivatives of W (n, n) with respect to m parameters, (m, n, n)."""
        m, n = dN.shape[:2]
        if not self.moves:
            return np.zeros((m, n, n))
        tangents, given, module = Jet(self.tangents, np.moveaxis(dN, 0, -1)), self._moved(along), second()
        qdot, here = module.along("coordinate_rate_sensitivities", given, {"dq": tangents})
        units = {**given, "u": self.space.units}
        there = module.along("coordinate_rate_sensitivities", units, {"dq": Jet(qdot.value[None], qdot.slope[None])})[1]
        W = self._bracket()
        change = here.slope - there.slope[0]  # (n, nq, m): derivatives of N W
        found = [self.space.components(self.tangents, change[..., j] - W.T @ dN[j]).T for j in range(m)]
        return np.array(found).reshape(m, n, n)

    def _matrices(self, W: Array, one: Array, dudot: Array, dy: Array) -> Matrices:
        """The matrices from W (..., n, n) and derivatives along the seeds (..., 2n + ninputs, n or outputs)."""
        n = self.space.n
        dudot, dy = np.swapaxes(dudot, -1, -2), np.swapaxes(dy, -1, -2)
        above = np.concatenate([W, np.broadcast_to(one, W.shape)], axis=-1)
        A = np.concatenate([above, dudot[..., : 2 * n]], axis=-2)
        B = np.concatenate([np.zeros_like(dudot[..., 2 * n :]), dudot[..., 2 * n :]], axis=-2)
        return Matrices(A, B, dy[..., : 2 * n].copy(), dy[..., 2 * n :].copy())
