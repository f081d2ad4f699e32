"""The quality of a choice of dependents, and which of two choices is better."""

from __future__ import annotations

import math

from ..records import dataclass

ACCEPTED = 10.0
"""Largest ratio of conditions, choice over pivoting, that is accepted: one digit of sixteen. A cluster costs a dense system."""

WORTH_IT = 3.0
"""Factor by which another choice has to be better."""

SHORT_OF_REACH = 0.7
"""Part of random independents that a choice should be able to close; otherwise another choice is sought."""

WIDER = 0.25
"""Additional part that another choice must close."""

PRICE_OF_CLUSTERED = 0.02
"""Reach that every dependent speed of a cluster has to gain, to be worth a dense system."""

PRICE_OF_DIGIT = 0.05
"""Reach that one digit of condition is worth."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Quality of the choice for a component.

    Attributes
    ----------
    loops : tuple of int
        All that share joints.
    condition, pivoted : float
        Of the columns of all dependents in the closure matrix of all these loops, at the initial configuration, and with
        the columns that a pivoted elimination takes there.
    worst, worst_pivoted : float
        The same at other assembled configurations, exceeded at a quarter of them; nan where there is no other.
    loss : float
        How many times worse the choice is than pivoting, at the initial configuration or at most others; nan where all
        are singular.
    reach : float
        For which part of random independents around the initial ones the loops close; nan for chains with more
        independent speeds than dependent ones, which no few joints near the cut can follow.
    clustered : int
        Dependent speeds of clusters.
    """

    loops: tuple[int, ...]
    condition: float
    pivoted: float
    worst: float
    worst_pivoted: float
    loss: float
    reach: float
    clustered: int

    @property
    def is_poor(self) -> bool:
        """Whether another choice should be sought."""
        return self.loss > ACCEPTED or self.reach < SHORT_OF_REACH

    @property
    def worth(self) -> float:
        """Value by which choices of acceptable condition are compared."""
        reach = self.reach if self.reach == self.reach else 1.0
        loss = self.loss if self.loss == self.loss else 1.0
        return reach - PRICE_OF_CLUSTERED * self.clustered - PRICE_OF_DIGIT * math.log10(max(loss, 1.0))

    def is_better(self, other: Comparison) -> bool:
        """Whether this choice is preferred: by its condition if one of both is not acceptable, otherwise by its value."""
        if self.loss > ACCEPTED or other.loss > ACCEPTED:
            return self.loss < other.loss
        return self.worth > other.worth

    def is_clearly_better(self, other: Comparison) -> bool:
        """Whether it should replace the other choice."""
        if other.loss > ACCEPTED:
            return self.loss * WORTH_IT < other.loss
        return self.loss <= ACCEPTED and self.worth >= other.worth + WIDER
