"""Hessians of weighted sums of results, from products with unit directions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..arrays import Array, Numbers
from ..calls.room import Room
from .derivatives import CURVED, JACOBIANS, HessianProducts, InverseDynamicsProducts, asked_for


class Hessians(Room):
    """Second derivatives of weighted sums of the results of a function."""

    def products(self, of: str, given: tuple[Any, ...], seeds: tuple[Any, ...], out: Any = None) -> HessianProducts:
        """See `Solver.hessian_products`; `of` is a key of `CURVED`."""
        return HessianProducts(*self._computed(of, given, seeds, out))

    def of_inverse_dynamics(
        self, given: tuple[Any, ...], seeds: tuple[Any, ...], out: Any = None
    ) -> InverseDynamicsProducts:
        """See `Solver.inverse_dynamics_hessian_products`."""
        return InverseDynamicsProducts(*self._computed("inverse_dynamics", given, seeds, out))

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
