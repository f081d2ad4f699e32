"""The quality of a choice of dependents, and which of two choices is better."""

from __future__ import annotations

import math

from ..records import dataclass

ACCEPTED = 10.0
"""Largest accepted ratio of the choice's condition number to that of pivoting. A ratio of this size costs one digit of
sixteen; a cluster would cost a dense system."""

WORTH_IT = 3.0
"""Factor by which the condition number of another choice must be smaller."""

SHORT_OF_REACH = 0.7
"""Reach (`Comparison.reach`) below which another choice is sought."""

WIDER = 0.25
"""Increase of the value (`Comparison.worth`) that another choice must offer."""

PRICE_OF_CLUSTERED = 0.02
"""Reach that a cluster must gain for each of its dependent speeds to compensate for a dense system of equations."""

PRICE_OF_DIGIT = 0.05
"""Reach that is worth as much as one digit of the condition number."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Quality of the choice of dependents in one component.

    Attributes
    ----------
    loops : tuple of int
        All loops of the component.
    condition, pivoted : float
        Condition numbers at the initial configuration: of the dependents' columns in the closure matrix of all these loops,
        and of the columns that a pivoted elimination takes there.
    worst, worst_pivoted : float
        The condition numbers that a quarter of the other assembled configurations exceed; nan if there are none.
    loss : float
        Ratio of the choice's condition number to that of pivoting: at the initial configuration, or the ratio that a
        quarter of the other configurations exceed, if this ratio is larger. nan if all configurations are singular.
    reach : float
        Fraction of random independent coordinates around the initial ones for which the loops close. nan for chains with more
        independent speeds than dependent ones, in which the joints beside the loop joint can seldom close the loop.
    clustered : int
        Number of dependent speeds in clusters.
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
        """Whether the choice is so poor that another one should be sought."""
        return self.loss > ACCEPTED or self.reach < SHORT_OF_REACH

    @property
    def worth(self) -> float:
        """Value for comparing choices whose condition numbers are acceptable."""
        reach = self.reach if self.reach == self.reach else 1.0
        loss = self.loss if self.loss == self.loss else 1.0
        return reach - PRICE_OF_CLUSTERED * self.clustered - PRICE_OF_DIGIT * math.log10(max(loss, 1.0))

    def is_better(self, other: Comparison) -> bool:
        """Whether this choice is preferred: by condition number if either choice is unacceptable, otherwise by
        value."""
        if self.loss > ACCEPTED or other.loss > ACCEPTED:
            return self.loss < other.loss
        return self.worth > other.worth

    def is_clearly_better(self, other: Comparison) -> bool:
        """Whether this choice is so much better that it should replace the other one."""
        if other.loss > ACCEPTED:
            return self.loss * WORTH_IT < other.loss
        return self.loss <= ACCEPTED and self.worth >= other.worth + WIDER
