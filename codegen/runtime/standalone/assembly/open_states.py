"""Warnings about states that do not close the loops."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.arguments import some
from ..calls.functions import STATE, Function, Wanted
from ..calls.package import Package
from ..errors import SingularJointError
from ..warning import warn

CLOSING = frozenset({
    "closure", "conditions", "newton_step", "closing_step", "completion", "completion_sensitivities",
    "completion_sensitivities_transposed", "closure_sensitivities",
})  # fmt: skip
"""Functions whose states are not tested: they report residuals themselves, or belong to assembly, which has its own
warnings."""

OPEN = 1e-3
"""Residual, in characteristic lengths or rad, above which a loop counts as open. Rounded coordinates and steps of finite
differences stay below it."""

STAYS = 1e-6
"""Length of Newton's step, rad or m, up to which only redundant conditions are open, which dependent coordinates cannot close."""


class OpenStates:
    """Warns of an open loop if coordinates or parameters are given by name, or coordinates as a list: values that a user
    has typed, and has not assembled. Arrays are used without this test, which would take longer than most functions.

    Parameters
    ----------
    package : Package
    """

    def __init__(self, package: Package):
        self.package = weakref.proxy(package)

    def look(self, wanted: str | Wanted, given: tuple[Any, ...]) -> None:
        """Warns if a state that a user has typed does not close the loops."""
        package, name = self.package, wanted if isinstance(wanted, str) else wanted.name
        if name in CLOSING or not (name in package._functions or name in package._composed):
            return
        state = dict(zip(STATE, given, strict=False))
        q = state["q"]
        if isinstance(state.get("u"), Mapping):
            warn_of_dependent_speeds(package, state["u"])
        if q is not None and (not isinstance(q, np.ndarray) or isinstance(state["p"], Mapping)):
            self._look_at(state)

    def _look_at(self, state: Mapping[str, Any]) -> None:
        """Warns if a state does not close the loops."""
        package = self.package
        closure, of_newton = (package._functions.get(name) for name in ("closure", "newton_step"))
        if closure is None or of_newton is None:
            return
        dropped = package._opened.manifest.get("dropped", [])
        gaps = np.delete(np.abs(np.asarray(self._at(closure, state)[0], float)), dropped, axis=-1)
        if not (gaps > OPEN).any():
            return
        try:
            if (np.abs(np.asarray(self._at(of_newton, state)[0], float)) <= STAYS).all():
                return  # only redundant conditions are open, which assembly reports
        except SingularJointError:
            pass  # the loops are open all the same
        names = np.delete(package.closure_names, dropped)
        worst = np.unravel_index(int(np.nanargmax(gaps)), gaps.shape)
        place = f" (state {[int(i) for i in worst[:-1]]} of the batch)" if len(worst) > 1 else ""
        warn(
            f"the state does not close the loops{place}: condition {names[worst[-1]]} is open by {gaps[worst]:.2g} rad or "
            f"characteristic lengths, so the results are not those of the mechanism; call assemble first: "
            f"q, u = solver.assemble(q, u, p)"
        )

    def _at(self, f: Function, state: Mapping[str, Any]) -> tuple[Array, ...]:
        """Results of a function of positions."""
        known = {**state, "u": np.zeros(self.package.nu)}
        arrays, batch, _ = self.package._taken(f, [known[name] for name in f.order])
        found: tuple[Array, ...] = self.package._opened.target.compute(f, arrays, batch)
        return found


def warn_of_dependent_speeds(package: Package, u: Any) -> None:
    """Warns if speeds by name are dependent speeds alone, which follow from the independent ones and have no effect."""
    if not isinstance(u, Mapping):
        return
    given = np.logical_not(package._arguments.omitted("u", u))
    free = [name in package.independent_speed_names for name in package.speed_names]
    if any(free) and given.any() and not given[free].any():
        warn(
            f"u: {some([n for n, is_given in zip(package.speed_names, given, strict=True) if is_given])} follow from the "
            f"independent speeds ({some(package.independent_speed_names)}), so these values have no effect; give independent "
            f"speeds"
        )


def warn_of_moved_initial(package: Package) -> None:
    """Warns if the initial state differs from the values in the model file, because these do not close the loops."""
    manifest = package._manifest
    moved: dict[str, float] = manifest.get("moved_initial", {})
    if moved:
        q = dict(zip(package.coordinate_names, manifest["initial"]["q"], strict=True))
        changes = [f"{name} from {value:.4g} to {q[name]:.4g}" for name, value in moved.items()]
        warn(
            f"{package.name}: the loops cannot be closed with the initial values of the model; solver.initial "
            f"contains others: {some(changes)}. Give other values under `initial` of the model, and generate it again"
        )
