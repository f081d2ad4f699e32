"""Measurements that a report leaves out, with the reason and the time that they would take."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Skipped:
    """A measurement that was left out, and the reason.

    Attributes
    ----------
    what, why : str
    seconds : float or None
        Estimated time; None if time was not the reason.
    """

    what: str
    why: str
    seconds: float | None = None

    def __str__(self) -> str:
        took = "" if self.seconds is None else f"; it would have taken about {seconds_in_words(self.seconds)}"
        return f"{self.what}: {self.why}{took}"


def seconds_in_words(seconds: float) -> str:
    """A rounded time such as "40 s" or "3 h"."""
    for unit, size in (("h", 3600.0), ("min", 60.0), ("s", 1.0), ("ms", 1e-3)):
        if seconds >= 2 * size or unit == "ms":
            return f"{seconds / size:.2g} {unit}"
    raise AssertionError
