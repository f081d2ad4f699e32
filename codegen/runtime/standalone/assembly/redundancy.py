"""Warnings about redundant loop conditions that parameters open, and about directions without a derivative."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Numbers
from ..calls.arguments import Seeds
from ..calls.functions import STATE, WEIGHTED, Wanted
from ..calls.room import Room
from ..calls.single_calls import Call
from ..calls.targets import Opened
from ..warning import warn
from .assembly import allowed_gaps
from .open_states import CLOSING

OPEN_SEED = 1e-7
"""Increase of the residual per unit of a direction above which the direction opens a redundant condition."""


class WatchedCalls(dict[Any, Call]):
    """Direct calls that warn first if dropped conditions have large residuals in the given state."""

    def __init__(self, redundancy: Redundancy, calls: Mapping[Any, Call]):
        super().__init__()
        self.redundancy, self.calls = weakref.proxy(redundancy), calls

    def __missing__(self, wanted: str | Wanted) -> Call:
        name, call = wanted if isinstance(wanted, str) else wanted.name, self.calls[wanted]

        def watched(given: tuple[Any, ...], seeds: tuple[Any, ...] | None = None, out: Any = None) -> Any:
            self.redundancy._look_at_state(name, given)
            return call(given, seeds, out)

        return watched


class Redundancy(Room):
    """Warns of directions that open redundant conditions, and of states in which dropped conditions are open."""

    def watch_calls(self) -> None:
        """Adds a test to direct calls of C in packages with dropped loop conditions: whether the state violates a
        dropped condition."""
        if self._opened.manifest.get("dropped"):
            self.package._calls = WatchedCalls(self, self.package._calls)

    def _look_at_state(self, name: str, given: tuple[Any, ...]) -> None:
        """Warns if a state violates dropped loop conditions by more than their tolerance."""
        opened = self._opened
        f = opened.functions.get(name)
        if f is None or name in CLOSING:
            return
        known = f.named(given)
        if known.get("q") is None:
            return
        arrays, batch, _ = self.package._taken(f, given)
        gaps = opened.target.compute(opened.functions["closure"], {"u": np.zeros(self.nu)} | dict(arrays), batch)[0]
        allowed = allowed_gaps(opened)
        excess = np.where(allowed > 0.0, np.abs(gaps) - allowed, -np.inf)
        if (excess > 0.0).any():
            worst = np.unravel_index(int(np.nanargmax(excess)), excess.shape)
            place = f" (state {[int(i) for i in worst[:-1]]} of the batch)" if batch else ""
            warn(
                f"condition {self.closure_names[int(worst[-1])]} is open by {abs(gaps[worst]):.2g}{place}, more than the "
                f"allowed {allowed.max():g}: it was dropped as redundant within loop_tolerance when the package was "
                f"generated, so {name} ignores it"
            )

    def look_at_directions(self, wanted: str | Wanted, given: tuple[Any, ...], seeds: tuple[Any, ...] | None) -> None:
        """Warns of directions along which no derivative exists."""
        opened, name = self._opened, wanted if isinstance(wanted, str) else wanted.name
        by_all = name in WEIGHTED or (name == "jacobians" and "J_p" in getattr(wanted, "returned", ("J_p",)))
        dp = np.eye(self.np) if by_all else None if seeds is None else seeds[STATE.index("p")]
        if self._watched and dp is not None and name != "closure_sensitivities" and name in opened.functions:
            known = opened.functions[name].named(given)
            if "q" in known:
                self._warn_of_opening(opened, opened.manifest["opening"], known, dp)

    def _warn_of_opening(self, opened: Opened, opening: list[int], given: Mapping[str, Any], dp: Numbers) -> None:
        """Warns of parameters that a direction changes and that open redundant conditions."""
        known = {name: given[name] for name in ("q", "u", "p") if name in given}
        arrays, batch = self._arguments.take(known, self._left_out)
        (directions, _), _ = Seeds.take(self._arguments, {"dp": dp}, arrays, batch)
        seeds = directions["dp"].reshape(-1, self.np)
        touched = [j for j in opening if np.any(seeds[:, j] != 0.0)]
        if not touched:
            return
        arrays.setdefault("u", np.zeros(self.nu))
        units = {"dp": np.eye(self.np)[touched].reshape(len(touched), *[1] * len(batch), self.np)}
        f = opened.functions["closure_sensitivities"]
        per_unit = opened.target.compute(f, arrays, batch, Seeds(units, len(touched)))[1]
        per_unit = per_unit.reshape(len(touched), -1, len(self.closure_names))
        opened_by = np.abs(np.einsum("kj,jbc->kbc", seeds[:, touched], per_unit)).max(axis=1, initial=0.0)
        unit = np.maximum(1.0, np.abs(seeds).max(axis=1))[:, None]
        opens = opened_by > np.maximum(allowed_gaps(opened), OPEN_SEED) * unit
        involved = np.any(seeds[np.any(opens, axis=1)] != 0.0, axis=0)
        worst = np.abs(per_unit).max(axis=1, initial=0.0)
        for j, row in zip(touched, worst, strict=True):
            if involved[j]:
                condition = int(np.argmax(row))
                warn(
                    f"parameter {self.parameter_names[j]} opens the redundant condition {self.closure_names[condition]} by "
                    f"{row[condition]:.2g} per unit: the loop cannot stay closed when this parameter alone changes; its "
                    f"derivatives are those of the nearest motion that keeps all conditions that dependent joints can satisfy"
                )
