"""Hessians of weighted sums of results, from products with unit directions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, filled, lengths
from ..assembly.states import States
from ..calls.arguments import Seeds
from ..calls.functions import ALONG, STATE, Wanted
from ..calls.package import Package, state
from ..calls.room import Room
from .derivatives import CURVED, JACOBIANS, HessianProducts, InverseDynamicsProducts, asked_for

ASSEMBLED = Wanted("assemble_hessian_products", [f"dg{n}" for n in JACOBIANS])
BY_COORDINATES = Wanted("completion_sensitivities_transposed", ALONG)

COMPLETE = 1e-9
"""Largest change of a direction by completion, relative to its largest entry, that counts as none."""


def across(v: Array, e: Array) -> Array:
    """The part of v perpendicular to the quaternion e of unit length."""
    found: Array = v - e * np.sum(e * v, axis=-1, keepdims=True)
    return found


def by_given(db: Array, b: Array, e: Array, dx: Array, length: Array, partial: bool) -> Array:
    """Change, along dx, of a gradient with respect to a quaternion x of any length.

    With ``e = x / length``, b is the gradient with respect to e, and `db` its change. The gradient with respect to x is
    ``(b - e (e . b)) / length``. If loops determine a part of the quaternion, b contains no component along e, and `db` is
    the change of this b.
    """
    shorter = across(b, e) * np.sum(e * dx, axis=-1, keepdims=True) / length
    if not partial:
        de = across(dx, e) / length
        moved = de * np.sum(e * b, axis=-1, keepdims=True) + e * np.sum(de * b, axis=-1, keepdims=True)
        db = across(db, e) - moved
    found: Array = (db - shorter) / length
    return found


class Hessians(Room):
    """Second derivatives of weighted sums of the results of a function."""

    def __init__(self, package: Package, states: States):
        super().__init__(package)
        self.states = states

    def products(self, of: str, given: tuple[Any, ...], seeds: tuple[Any, ...], out: Any = None) -> HessianProducts:
        """See `Solver.hessian_products`; `of` is a key of `CURVED`."""
        return HessianProducts(*self._computed(of, given, seeds, out))

    def of_inverse_dynamics(
        self, given: tuple[Any, ...], seeds: tuple[Any, ...], out: Any = None
    ) -> InverseDynamicsProducts:
        """See `Solver.inverse_dynamics_hessian_products`."""
        if self.closure_names:
            given = (*given[:-1], self._of_all_speeds(given[-1]))
        return InverseDynamicsProducts(*self._computed("inverse_dynamics", given, seeds, out))

    def _of_all_speeds(self, weights: Any) -> Any:
        """Weights of all speeds, from those of independent speeds."""
        names = self.independent_speed_names
        if isinstance(weights, Mapping):
            for name in weights:
                if name in self.speed_names and name not in names:
                    raise ValueError(
                        f"weights: {name!r} is a dependent speed, along which the inverse dynamics has no force; "
                        f"choose among {', '.join(names)}"
                    )
            return weights
        given = np.asarray(weights)
        if given.shape[-1:] != (len(names),):
            raise ValueError(
                f"weights has shape {given.shape}, expected (..., {len(names)}): one for each independent speed"
            )
        found = np.zeros((*given.shape[:-1], len(self.speed_names)), given.dtype)
        found[..., [self.speed_names.index(n) for n in names]] = given
        return found

    def of_assembled(
        self, given: tuple[Any, ...], weights_q: Numbers, weights_u: Numbers, seeds: tuple[Any, ...]
    ) -> HessianProducts:
        """See `Solver.assemble_hessian_products`."""
        arrays, batch = self._arguments.take(state(*given), self._left_out)
        (along, k), batch = Seeds.take(self._arguments, dict(zip(ALONG, seeds, strict=True)), arrays, batch)
        q_new: Array = self.states.assembled(arrays, batch)
        weights = [
            self._weights(name, given, of, batch, q_new)
            for name, given, of in (("weights_q", weights_q, "q"), ("weights_u", weights_u, "u"))
        ]
        at = tuple({**arrays, "q": q_new}[n] for n in STATE)
        seed = along.get("dq")
        if seed is not None:
            self._check_complete(given, seeds, seed)
        before = {i: lengths(arrays["q"][..., i : i + 4]) for i in self._arguments.quaternions}
        if before and seed is not None:
            dq = np.array(np.broadcast_to(seed, (k, *batch, self.nq)), q_new.dtype)
            for i, length in before.items():
                dq[..., i : i + 4] = across(dq[..., i : i + 4], q_new[..., i : i + 4]) / length
            seeds = (dq, *seeds[1:])
        if self.closure_names:
            found = HessianProducts(*self._call(ASSEMBLED, (*at, *weights), seeds, None))
        else:
            found = HessianProducts(*(np.zeros((k, *batch, *self._shapes[n]), q_new.dtype) for n in STATE))
        if before and seed is not None:
            gradient = self._gradient(at, weights)
            for i, length in before.items():
                part = (..., slice(i, i + 4))
                found.q[part] = by_given(
                    found.q[part], gradient[part], q_new[part], seed[part], length, self._partial(i)
                )
        return found

    def _check_complete(self, given: tuple[Any, ...], seeds: tuple[Any, ...], dq: Array) -> None:
        """Refuses directions that would open loops by turning a quaternion of which loops determine a part. Along such
        a direction, the change of the gradient also depends on how assembly turns the quaternion back."""
        partial = [i for i in self._arguments.quaternions if self._partial(i)]
        if not partial:
            return
        complete = self.states.assemble_sensitivities(given, seeds)[2]
        for i in partial:
            part = (..., slice(i, i + 4))
            if np.abs(complete[part] - dq[part]).max(initial=0.0) > COMPLETE * np.abs(dq).max(initial=0.0):
                name = self.coordinate_names[i].rpartition(".")[0]
                raise ValueError(
                    f"dq: loops determine a part of the rotation of {name}, and this direction does not keep them closed; "
                    f"pass the dq that assemble_sensitivities returns for it"
                )

    def _partial(self, i: int) -> bool:
        """Whether loops determine some rotations of a quaternion, but not all."""
        joint = self.coordinate_names[i].rpartition(".")[0]
        free = [f"{joint}.w{axis}" in self.independent_speed_names for axis in "xyz"]
        return any(free) and not all(free)

    def _weights(self, name: str, given: Numbers, of: str, batch: tuple[int, ...], like: Array) -> Array:
        shape = (*batch, *self._shapes[of])
        if given is None:
            return np.zeros(shape, like.dtype)
        found: Array = filled(shape, self._arguments.array(name, given, of), like.dtype)
        return found

    def _gradient(self, at: tuple[Any, ...], weights: list[Array]) -> Array:
        """Gradient of the weighted sum with respect to coordinates, at the closed state, (*batch, nq)."""
        if not self.closure_names:
            return weights[0]
        found: Array = self._call(BY_COORDINATES, at, tuple(w[None] for w in weights))[0]
        return found[0]

    def _computed(self, of: str, given: tuple[Any, ...], seeds: tuple[Any, ...], out: Any) -> tuple[Array, ...]:
        try:
            found: tuple[Array, ...] = self._call(CURVED[of].wanted, given, seeds, out)
            return found
        except ValueError as error:
            message, name = str(error), CURVED[of].weights
            if not message.startswith(f"{name} "):
                raise
            raise ValueError(f"weights{message.removeprefix(name)}") from None  # the name that users know

    def matrix(self, of: str, given: tuple[Any, ...], wrt: str | Iterable[str] | None) -> Array:
        """See `Solver.hessians`."""
        known = [n for n in CURVED if n != "inverse_dynamics"]
        if of not in known:
            raise ValueError(f"of is {of!r}, expected one of {', '.join(known)}")
        names = asked_for(wrt)
        sizes = {n: self._arguments.shapes[n][0] if n != "t" else 1 for n in names}
        units: dict[str, Numbers] = {}
        at, k = 0, sum(sizes.values())
        for n, size in sizes.items():
            if size:
                units[n] = np.eye(k, size, -at)[:, 0] if n == "t" else np.eye(k, size, -at)
            at += size
        if not k:
            raise ValueError(f"wrt: the model has no {', '.join(names)}; choose others of {', '.join(JACOBIANS)}")
        found = self.products(of, given, tuple(units.get(n) for n in JACOBIANS))
        rows = [getattr(found, n)[..., None] if n == "t" else getattr(found, n) for n in names]
        return np.moveaxis(np.concatenate(rows, axis=-1), 0, -1)
