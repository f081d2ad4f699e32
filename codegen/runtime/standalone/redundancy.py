"""Redundant conditions: parameters that open some of them, along which there is no derivative."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .arrays import Numbers
from .assembly import allowed_gaps
from .directions import take_directions
from .functions import Function
from .package import Package
from .short_calls import no_short_way
from .targets import Opened
from .warning import warn

OPEN_SEED = 1e-7
"""A direction of parameters that opens a loop by more than this, per unit, does not keep its redundant conditions."""


class WatchedDesk:
    """A desk without short ways along directions: the long way looks for those that open loops."""

    def __init__(self, desk: Any):
        self._desk = desk

    def __getattr__(self, name: str) -> Any:
        return no_short_way if name == "jacobians" or name.endswith("sensitivities") else getattr(self._desk, name)


class Redundancy(Package):
    """Warns of directions that open redundant conditions."""

    def _desk_of(self, opened: Opened) -> Any:
        desk = super()._desk_of(opened)
        return WatchedDesk(desk) if opened.manifest.get("opening") else desk

    def _look_at_directions(
        self, opened: Opened, f: Function, given: Mapping[str, Any], seeds: Mapping[str, Any]
    ) -> None:
        opening = opened.manifest.get("opening")
        if opening and seeds.get("dp") is not None and "q" in given and f.name != "closure_sensitivities":
            self._warn_of_opening(opened, opening, given, seeds["dp"])

    def _warn_of_opening(self, opened: Opened, opening: list[int], given: Mapping[str, Any], dp: Numbers) -> None:
        """Parameters that open redundant conditions, where a direction changes them."""
        known = {name: given[name] for name in ("q", "u", "p") if name in given}
        arrays, batch = self._arguments.take(known, self._left_out)
        directions, _, _ = take_directions(self._arguments, {"dp": dp}, arrays, batch)
        seeds = directions["dp"].reshape(-1, self.np)
        touched = [j for j in opening if np.any(seeds[:, j] != 0.0)]
        if not touched:
            return
        arrays.setdefault("u", np.zeros(self.nu))
        units = {"dp": np.eye(self.np)[touched].reshape(len(touched), *[1] * len(batch), self.np)}
        f = opened.functions["closure_sensitivities"]
        per_unit = opened.target.along(f, arrays, units, len(touched), batch)[1]
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
                    f"{row[condition]:.2g} per unit: the loop does not stay closed when it changes alone, and derivatives along "
                    f"it are those of the nearest motion, which keeps what the dependent joints can keep"
                )
