"""Hessians of weighted sums of udot, from products with unit directions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..arrays import Array, Numbers
from ..calls.room import Room
from .derivatives import HESSIAN_PRODUCTS, JACOBIANS, HessianProducts, asked_for


class Hessians(Room):
    """Second derivatives of weighted sums of udot."""

    def products(self, given: tuple[Any, ...], seeds: tuple[Any, ...], out: Any = None) -> HessianProducts:
        """See `Solver.hessian_products`."""
        try:
            return HessianProducts(*self._call(HESSIAN_PRODUCTS, given, seeds, out))
        except ValueError:
            self._arguments.array("weights", given[-1], "weights")  # whose message has the name that users know
            raise

    def matrix(self, given: tuple[Any, ...], wrt: str | Iterable[str] | None) -> Array:
        """See `Solver.hessians`."""
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
        found = self.products(given, tuple(units.get(n) for n in JACOBIANS))
        rows = [getattr(found, n)[..., None] if n == "t" else getattr(found, n) for n in names]
        return np.moveaxis(np.concatenate(rows, axis=-1), 0, -1)
