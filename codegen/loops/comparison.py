"""How good a choice of dependents is, and which of two is the better one."""

from __future__ import annotations

import math

from ..records import dataclass

ACCEPTED = 10.0
"""How many times worse than by pivoting a condition may be: one digit of sixteen, where a cluster would cost a dense system."""

WORTH_IT = 3.0
"""Another choice has to be this many times better."""

SHORT_OF_REACH = 0.7
"""Where fewer of the random independents can be closed, another choice is looked for."""

WIDER = 0.25
"""So many more of them another choice must close."""

PRICE_OF_CLUSTERED = 0.02
"""What every dependent speed of a cluster has to gain in reach, to be worth a dense system."""

PRICE_OF_DIGIT = 0.05
"""What a digit of condition is worth in reach."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """How good the choice for a component is.

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
        """Whether another choice should be looked for."""
        return self.loss > ACCEPTED or self.reach < SHORT_OF_REACH

    @property
    def worth(self) -> float:
        """What choices of acceptable condition are compared by."""
        reach = self.reach if self.reach == self.reach else 1.0
        loss = self.loss if self.loss == self.loss else 1.0
        return reach - PRICE_OF_CLUSTERED * self.clustered - PRICE_OF_DIGIT * math.log10(max(loss, 1.0))

    def is_better(self, other: Comparison) -> bool:
        """Whether this choice is to be preferred: one of acceptable condition, and of these the one worth most."""
        if self.loss > ACCEPTED or other.loss > ACCEPTED:
            return self.loss < other.loss
        return self.worth > other.worth

    def is_clearly_better(self, other: Comparison) -> bool:
        """Whether it should replace the other choice."""
        if other.loss > ACCEPTED:
            return self.loss * WORTH_IT < other.loss
        return self.loss <= ACCEPTED and self.worth >= other.worth + WIDER
