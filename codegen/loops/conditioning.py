"""Quality of the dependents of a whole component: the condition number of all their columns, and their reach.

Each ear gets the best dependents for itself, one ear after the other. The whole choice can still be poor: an ear may
need large speeds to follow speeds that another ear left independent. A choice that is good at the initial configuration
may also be poor at another. So the columns of all dependents are examined together, at configurations spread over the
mechanism's range. Their condition number is divided by that of the columns which a pivoted Gram-Schmidt process takes
at each configuration. The reach is the fraction of random displacements of the independents for which the loops close.
A choice whose ratio of condition numbers exceeds 10, or that closes far less often than another, is replaced,
preferably by one whose ears still close one after the other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from ..model.vectors import Array
from .comparison import ACCEPTED, Comparison
from .dependents import RANK_TOLERANCE, columns_at_all, conditions, pivoted_columns
from .errors import PartitionError
from .geometry import Geometry
from .nearby_states import NearbyStates
from .ordering import Draft, Sweep, arrange
from .velocities import is_lone_coupling

FEW = 30
"""Largest number of choices for a single loop that are all tried."""

MOST_LOOPS = 8
MOST_SPEEDS = 60
"""Largest number of loops or speeds of a component that is compared, because its closure matrix is dense."""

QUANTILE = 0.75
"""Quantile of the condition numbers that is compared: a choice may be poor at a quarter of the configurations."""

EVERY = 30
"""Largest number of loops of a model in which every component is compared; in larger models, only components with a poor ear."""

DOUBTFUL = 100.0
"""Condition number above which an ear is poorly conditioned."""

SINGULAR = 100 * RANK_TOLERANCE
"""Ratio of the smallest to the largest singular value below which a configuration is ignored."""

EXACT = 1e-9
"""Largest residual of a configuration at which dependents may be chosen."""

SERVING = 4
"""Number of configurations, besides the initial one, for which dependents are chosen jointly."""

BRANCHES = 3
"""Number of the fastest dependent speeds that are tried as independent ones, each in turn."""

ROUNDS = 2
"""Number of rounds in which fast dependent speeds are tried as independent ones."""


class Conditioning:
    """Compares choices of dependent speeds for one component.

    Parameters
    ----------
    nearby : NearbyStates
    loops : sequence of int
        In the order in which they are tried.
    held : set of int
        Speeds that must stay independent.
    rank : int
        Number of dependent speeds.
    seed : int
    """

    def __init__(self, nearby: NearbyStates, loops: Sequence[int], held: set[int], rank: int, seed: int) -> None:
        self.nearby, self.geometry, self.loops, self.held, self.rank, self.seed = (
            nearby, nearby.geometry, list(loops), held, rank, seed,
        )  # fmt: skip
        self.q, self.speeds = nearby.q, [int(s) for s in nearby.speeds]
        self.E = np.sign(nearby.E) if is_lone_coupling(nearby.geometry, self.loops) else nearby.E
        self.column = {s: c for c, s in enumerate(self.speeds)}
        self._known: dict[tuple[tuple[int, ...], int], Comparison] = {}
        sizes = np.linalg.svd(self.E, compute_uv=False)
        self.regular = sizes[:, rank - 1] > SINGULAR * sizes[:, 0]
        self.free = [c for c, s in enumerate(self.speeds) if s not in held]
        at_each = pivoted_columns(self.E[..., self.free], rank)
        self.pivoted = conditions(np.take_along_axis(self.E[..., self.free], at_each[:, None, :], axis=2))
        good = np.flatnonzero(self.regular[1:] & (nearby.residual[1:] < EXACT)) + 1
        good = good[self.pivoted[good] <= 3 * np.median(self.pivoted[good])] if len(good) else good
        self.serving = np.concatenate([[0], good[:: max(1, -(-len(good) // SERVING))]])

    def compare(self, drafts: Sequence[Draft]) -> Comparison:
        """The condition numbers of a choice, and its reach."""
        chosen = tuple(sorted(self.column[s] for d in drafts for s in d.dependent))
        return self._compare_columns(chosen, sum(len(d.dependent) for d in drafts if len(d.loops) > 1))

    def _compare_columns(self, chosen: tuple[int, ...], clustered: int) -> Comparison:
        """Condition numbers and reach of a choice of columns."""
        known = self._known.get((chosen, clustered))
        if known is not None:
            return known
        found = conditions(self.E[..., chosen])
        ratio = found / self.pivoted
        others = np.flatnonzero(self.regular[1:]) + 1
        losses = [float(ratio[0])] if self.regular[0] else []
        worst, worst_pivoted = float("nan"), float("nan")
        if len(others):
            losses.append(_exceeded(ratio[others]))
            worst, worst_pivoted = _exceeded(found[others]), _exceeded(self.pivoted[others])
        loss = max(losses, default=float("nan"))
        reach = self.nearby.reach(chosen) if len(self.speeds) <= 2 * self.rank else float("nan")
        result = self._known[chosen, clustered] = Comparison(
            tuple(sorted(self.loops)),
            float(found[0]),
            float(self.pivoted[0]),
            worst,
            worst_pivoted,
            loss,
            reach,
            clustered,
        )
        return result

    def better(self, drafts: list[Draft]) -> tuple[list[Draft], Comparison]:
        """A choice that is clearly better than the given one; the given one if there is none."""
        given = best = self.compare(drafts)
        if not given.is_poor:
            return drafts, given
        chosen = drafts
        for other in self._better_conditioned(drafts) if given.loss > ACCEPTED else self._further_reaching(given):
            found = self.compare(other)
            if found.is_better(best):
                chosen, best = other, found
            if not best.is_poor and not best.clustered:
                break
        return (chosen, best) if best.is_clearly_better(given) else (drafts, given)

    def own_choice(self) -> tuple[list[Draft], Comparison] | None:
        """A choice that is made at several configurations and improved by `better`; None if the loops cannot be
        ordered."""
        drafts = self._arranged(self.held, False)
        return self.better(drafts) if drafts is not None else None

    def _further_reaching(self, given: Comparison) -> Iterator[list[Draft]]:
        """Choices with which the loops may close more often: for a single loop the best of all choices, otherwise a
        choice that is made at several configurations. Such a choice divides no quaternion joint and adds no
        cluster."""
        g = self.geometry
        scalar = not any(g.whole[k] for k in g.speed_body[self.speeds])
        if len(self.loops) == 1 and scalar and math.comb(len(self.free), self.rank) <= FEW:
            all_choices = (tuple(x) for x in combinations(self.free, self.rank))
            acceptable = [x for x in all_choices if self._compare_columns(x, 0).loss <= ACCEPTED]
            if not acceptable:
                return
            best = max(acceptable, key=lambda x: self._compare_columns(x, 0).worth)
            dependent = {self.speeds[c] for c in best}
            other = self._arranged({s for s in self.speeds if s not in dependent}, False)
        else:
            other = self._arranged(self.held, False)
        if other is not None and self.compare(other).clustered <= given.clustered:
            yield other

    def _better_conditioned(self, drafts: list[Draft]) -> Iterator[list[Draft]]:
        """Choices that may be better conditioned; those whose ears close one after the other come first."""
        best = drafts
        for dividing in (False, True):
            other = self._arranged(self.held, dividing)
            if other is not None:
                yield other
                if self.compare(other).is_better(self.compare(best)):
                    best = other
        held = self.held
        for _ in range(ROUNDS):
            further = []
            for speed in self._worst_followers(best):
                other = self._arranged(held | {speed}, True)
                if other is not None and all(len(d.loops) == 1 for d in other):
                    further.append((self.compare(other).loss, speed, other))
                    yield other
            if not further:
                break
            _, speed, best = min(further, key=lambda x: x[:2])
            held = held | {speed}
        columns = columns_at_all(self.E[self.serving][..., self.free], self.rank)
        dependent = {self.speeds[self.free[c]] for c in columns}
        other = self._arranged({s for s in self.speeds if s not in dependent}, True)
        if other is not None:
            yield other

    def _worst_followers(self, drafts: Sequence[Draft]) -> list[int]:
        """The dependent speeds that change most per unit of the independent speeds (norm over all of these)."""
        chosen = [self.column[s] for d in drafts for s in d.dependent]
        rest = [c for c in range(len(self.speeds)) if c not in chosen]
        E = self.E[self.regular] if np.any(self.regular) else self.E
        Y = np.linalg.pinv(E[..., chosen], rcond=1e-12) @ E[..., rest]
        size = np.quantile(np.linalg.norm(Y, axis=2), QUANTILE, axis=0)
        return [self.speeds[chosen[i]] for i in np.argsort(-size, kind="stable")[:BRANCHES]]

    def _arranged(self, held: set[int], dividing: bool) -> list[Draft] | None:
        """Ears in which the speeds `held` are independent, chosen at several configurations; None if every order loses
        rank."""
        sweep = Sweep(self.geometry, self.q[self.serving], held, np.random.default_rng(self.seed))
        sweep.dividing = sweep.dividing_for_condition = dividing
        try:
            drafts = arrange(sweep, self.loops)
        except PartitionError:
            return None
        return drafts if sum(len(d.dependent) for d in drafts) == self.rank else None


def _exceeded(values: Array) -> float:
    """The upper quartile of the values, which a quarter of them exceed."""
    return float(np.quantile(values, QUANTILE, method="higher"))


def is_compared(geometry: Geometry, loops: Sequence[int], drafts: Sequence[Draft]) -> bool:
    """Whether the choice for a component is compared with pivoting."""
    if len(loops) > MOST_LOOPS or not any(d.dependent for d in drafts):
        return False
    if len(geometry.starts) > EVERY and max(d.condition for d in drafts) < DOUBTFUL:
        return False
    return len(geometry.passed_speeds(loops)) <= MOST_SPEEDS
