"""Warnings about parameters that make a mass, an inertia or an armature negative."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.arguments import some
from ..calls.formulas import value_of
from ..calls.functions import STATE, Wanted
from ..calls.package import Package
from ..warning import warn

ROUNDING = 1e-12
"""Size of a negative principal moment, relative to the largest entry of the inertia, below which it is a rounding error."""


class NegativeMasses:
    """Warns of parameters that make a mass, a principal moment or an armature negative.

    Motions are always tested. Functions of a state are tested if parameters are given by name: values that a user has typed.
    Arrays are used without this test, which would take longer than most functions. Nearly always, all parameters in question
    are positive, and the quantities are products and sums of them; then no expression is evaluated.

    Parameters
    ----------
    package : Package
    """

    def __init__(self, package: Package):
        self.package = weakref.proxy(package)
        self.quantities = package._manifest["masses"]
        names = package.parameter_names
        simple, other = ({n for x in self.quantities if x["simple"] == k for n in x["names"]} for k in (True, False))
        self.simple, self.other = ([i for i, n in enumerate(names) if n in of] for of in (simple, other))
        self.doubtful = other | {n.rpartition(".")[0] for n in simple | other}
        self.names = simple

    def look(self, wanted: str | Wanted, given: tuple[Any, ...]) -> None:
        """Warns of parameters by name of a function of a state."""
        p = given[STATE.index("p")]
        if isinstance(p, Mapping) and any(
            name in self.doubtful or (name in self.names and not (type(x) in (float, int) and x > 0))
            for name, x in p.items()
        ):
            self.test(self.package._arguments.array("p", p, "p", self.package._arguments.defaults["p"]))

    def test(self, p: Array) -> None:
        """Warns if parameters (..., np) make a quantity negative, and names the first one."""
        default = self.package._arguments.defaults["p"]
        if (p[..., self.simple] > 0).all() and (p[..., self.other] == default[self.other]).all():
            return
        known = {name: np.asarray(p[..., i], float) for i, name in enumerate(self.package.parameter_names)}
        for quantity in self.quantities:
            value = _least(np.broadcast_arrays(*(value_of(tree, known) for tree in quantity["values"])))
            if (value < 0).any():
                worst = np.unravel_index(int(np.nanargmin(value)), value.shape)
                place = f" (entry {[int(i) for i in worst]} of the batch)" if worst else ""
                warn(
                    f"p: {quantity['what']} is {value[worst]:.6g}{place}, and must be at least 0; accelerations may have the "
                    f"wrong sign; check {some(quantity['names'])}"
                )
                return


def _least(values: Sequence[Array]) -> Array:
    """A number, or the smallest principal moment of an inertia xx, yy, zz, xy, xz, yz; 0 for rounding errors of moments."""
    if len(values) == 1:
        return np.asarray(values[0])
    entries = np.stack(values)
    scale = np.abs(entries).max(axis=0)
    if not entries[3:].any():
        least = entries[:3].min(axis=0)
    else:
        with np.errstate(all="ignore"):
            scaled = np.where(np.isfinite(scale) & (scale > 0), entries / scale, 0.0)
        matrices = np.moveaxis(scaled[[0, 3, 4, 3, 1, 5, 4, 5, 2]], 0, -1).reshape(*scale.shape, 3, 3)
        least = np.linalg.eigvalsh(matrices)[..., 0] * scale
    return np.where(least < -ROUNDING * scale, least, 0.0)
