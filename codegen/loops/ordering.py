"""The order of the ears: single loops where each closes by itself, clusters elsewhere.

A loop closes by itself if the speeds of joints that no earlier loop has passed can keep it closed, for every motion
that earlier loops permit. This is tested with random motions that are propagated through the loops ordered so far: the
effect of each motion at the cut must lie in the range of the new columns. If it does not, some degree of freedom inside
earlier ears must depend on this loop. Then another order is sought: the loop moves to a place before one of these ears,
or one of these ears to a place after the loop. If there is no such order, the loops become one cluster.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field

import numpy as np

from ..model.vectors import Array
from ..records import dataclass
from .ancestry import NewJoints
from .dependents import choose_dependents, condition, divide, ranks, whole_joints
from .errors import PartitionError, listed, loops_named
from .geometry import Geometry
from .odd_axes import axes_to_check
from .tangles import untangled
from .velocities import Motion, VelocityClosure, is_lone_coupling

MOTIONS = 12
"""Number of random motions, which exceeds the number of conditions of a loop."""

FOLLOWED = 1e-8
"""Relative residual of a random motion at the cut up to which the loop counts as closed."""

NEIGHBOURS = 8
"""Number of loops that are tried in other orders: the latest ones that share joints with the stuck loop."""

WORTH_DIVIDING = 3.0
"""Factor by which dividing a quaternion joint must improve the condition number."""

Order = list[tuple[int, ...]]
"""The ears in order, each as the tuple of its loops."""


def loop_order(geometry: Geometry, held: set[int]) -> list[int]:
    """Loops in the order of first trial. The next loop is the one with the fewest new degrees of freedom; of several
    such loops, the innermost.

    So a loop next to a closed one precedes one that is far from it. Hinted coordinates count as known.
    """
    freedoms = [sum(s not in held for s in speeds) for speeds in geometry.speeds]
    cuts = list(zip(geometry.starts, geometry.ends, strict=True))
    ancestry, depth = geometry.ancestry, geometry.depth
    bases = [ancestry.meeting(a, b) for a, b in cuts]
    inmost = [depth[base] + 1 if a != b else 0 for base, (a, b) in zip(bases, cuts, strict=True)]
    sums = ancestry.sums(freedoms, geometry.model.outward)
    left = np.array([sums[a] + sums[b] - 2 * sums[base] for base, (a, b) in zip(bases, cuts, strict=True)], dtype=float)
    left += np.array(inmost) / (1 + max(depth))
    passing, new = ancestry.passing(geometry.starts, geometry.ends), NewJoints(ancestry)
    order: list[int] = []
    while len(order) < len(cuts):
        loop = int(np.argmin(left))
        order.append(loop)
        for k in new.of(*cuts[loop]):
            if freedoms[k]:
                left[passing(k)] -= freedoms[k]
        left[loop] = np.inf
    return order


@dataclass(slots=True)
class Draft:
    """An ear that one sweep has found.

    Attributes
    ----------
    loops : tuple of int
    dependent : list of int
        Dependent speeds.
    rows : int
        Number of conditions.
    condition : float
        Condition number of the dependents' scaled closure matrix at the first configuration.
    certain : bool
        Whether no configuration can have a higher rank.
    """

    loops: tuple[int, ...]
    dependent: list[int]
    rows: int
    condition: float
    certain: bool


@dataclass(slots=True)
class Open:
    """The reason why an ear does not close by itself: a text, the hinted speeds that prevent it, and the ear's
    position."""

    text: str
    refused: list[str] = field(default_factory=list)
    place: int = 0


class Sweep:
    """Builds ears one after the other, testing each with random motions of the independent speeds found so far.

    Parameters
    ----------
    q : (S, nq + 1) array
        Assembled configurations.
    held : set of int
        Speeds that must stay independent.

    Attributes
    ----------
    dividing : bool
        Whether single speeds of quaternion joints may be dependent.
    would_divide : bool
        Whether dividing quaternion joints would have helped.
    dividing_for_condition : bool
        Whether quaternion joints are also divided where whole joints suffice, if the condition number improves.
    """

    def __init__(self, geometry: Geometry, q: Array, held: set[int], random: np.random.Generator) -> None:
        self.geometry, self.q, self.held = geometry, q, held
        self.dividing = self.would_divide = self.dividing_for_condition = False
        self.unit = np.where(geometry.turning, 1.0, np.median(geometry.own_lengths))
        motions = self.unit[:, None] * random.normal(size=(1, geometry.nu, MOTIONS))
        self.motion = Motion(geometry, q, np.repeat(motions, len(q), axis=0))

    def run(self, order: Order) -> tuple[list[Draft], Open | None]:
        """The ears before the first one that does not close by itself, and why it does not close; None if all close."""
        self.motion.restart()
        self.regular = np.ones(len(self.q), dtype=bool)
        drafts: list[Draft] = []
        for place, loops in enumerate(order):
            self.geometry.lengths[list(loops)] = np.max(self.geometry.own_lengths[list(loops)])
            closure = self.motion.closure(loops)
            draft = self._draft(closure, loops)
            if isinstance(draft, Open):
                draft.place = place
                return drafts, draft
            self.motion.resolve(closure, draft.dependent)
            drafts.append(draft)
        return drafts, None

    def growth(self) -> Array:
        """Growth ``(nu,)`` of every speed in the random motions of the last run.

        The growth is the root mean square at the first configuration, displacements per characteristic length. It is about
        one for independent speeds. For a dependent speed it is the norm of its row of Y in ``x = Y s``, the factor by which
        errors may grow along the ears. It is cheap to compute for any number of loops.
        """
        rms: Array = np.sqrt(np.mean(self.motion.u[0] ** 2, axis=1)) / self.unit
        return rms

    def _draft(self, closure: VelocityClosure, loops: tuple[int, ...]) -> Draft | Open:
        """The ear of some loops, or the reason why it does not close by itself."""
        g = self.geometry
        E = closure.scaled(g, float(g.lengths[loops[0]]))
        hinted = [int(s) in self.held for s in closure.speeds]
        free, held = np.flatnonzero(~np.array(hinted, dtype=bool)), np.flatnonzero(hinted)
        found = ranks(E[..., free], g.tolerance)
        rank = int(np.max(found[self.regular]))
        # where the rank is lower, the pose is singular and gives no further information
        self.regular &= found == rank
        regular = self.regular
        if not _follows(E[regular][..., free], *closure.disturbance(held, regular), rank, g.tolerance):
            return self._why_open(closure, E[regular], free, held, rank)
        if is_lone_coupling(g, loops):
            # first the coordinate that the file expresses by other coordinates
            E, given = closure.weighed(g, float(g.lengths[loops[0]])), g.couplings[loops[0]].speeds.tolist()
            free = np.array(
                sorted(free, key=lambda c: given.index(s) if (s := closure.speeds[c]) in given else len(given))
            )
        joints = whole_joints(g, closure.speeds, free)
        chosen = choose_dependents(E[regular], joints, rank, dense=len(loops) > 1)
        if chosen is None:
            if not self.dividing:
                self.would_divide = True
                return Open(f"rank {rank} cannot be made up of whole joints")
            chosen = divide(E[regular], joints, rank)
        elif self.dividing_for_condition:
            divided = divide(E[regular], joints, rank)
            if condition(E[regular][..., divided]) * WORTH_DIVIDING < condition(E[regular][..., chosen]):
                chosen = divided
        dependent = [int(closure.speeds[c]) for c in chosen]
        return Draft(loops, dependent, E.shape[1], condition(E[:1][..., chosen]), rank == closure.possible())

    def _why_open(self, closure: VelocityClosure, E: Array, free: Array, held: Array, rank: int) -> Open:
        names = [self.geometry.model.speed_names[s] for s in closure.speeds]
        motion, size = closure.disturbance(held, self.regular)
        everything = np.concatenate([E, motion / np.maximum(size, 1e-300)[:, None]], axis=2)
        text = (
            f"its conditions have rank {int(np.max(ranks(everything, self.geometry.tolerance)))}, and "
            f"{listed([names[c] for c in free]) or 'the remaining speeds'} can meet {rank} of them"
        )
        if not len(held):
            return Open(text)
        wrong = [c for c in held if np.max(ranks(E[..., [*free, c]], self.geometry.tolerance)) > rank]
        refused = [names[c] for c in (wrong or held)]
        several = len(refused) > 1
        return Open(
            f"{text}: {listed(refused)} cannot {'all ' * several}be independent; remove "
            f"{'one of them' if several else 'it'} from `independent`",
            refused,
        )


def _follows(E: Array, known: Array, size: Array, rank: int, tolerance: float) -> bool:
    """Whether the columns of E, of the given rank, can compensate the known motions at the cut."""
    rows = E.shape[1]
    if rank == rows:
        return True
    left = np.swapaxes(np.linalg.svd(E)[0][..., rank:], -1, -2) if E.shape[2] else np.eye(rows)
    return bool(np.all(np.abs(left @ known) <= max(FOLLOWED, tolerance) * np.maximum(size, 1e-300)[:, None]))


def arrange(sweep: Sweep, loops: Sequence[int]) -> list[Draft]:
    """Ears in an order in which each closes by itself; quaternion joints are divided only if no other order exists.

    Ears that start from each other's bodies are closed together: they become a cluster with common dependents.

    Parameters
    ----------
    loops : sequence of int
        All loops, in the order in which they are tried.

    Raises
    ------
    PartitionError
    """
    order: Order = [(i,) for i in loops]
    while True:
        drafts, stuck = sweep.run(order)
        if stuck is None:
            whole = untangled(sweep.geometry, order, {s for d in drafts for s in d.dependent})
            if len(whole) == len(order):
                return drafts
            order = whole
            continue
        try:
            order = _mended(sweep, order, stuck)
        except PartitionError:
            if sweep.dividing or not sweep.would_divide:
                raise
            sweep.dividing, order = True, [(i,) for i in loops]


def _mended(sweep: Sweep, order: Order, stuck: Open) -> Order:
    """Another order in which more ears close, or in which some ears become one cluster."""
    i, ear = stuck.place, order[stuck.place]
    passed = sweep.geometry.passed_speeds(ear)
    sharing = [j for j in reversed(range(i)) if sweep.geometry.passed_speeds(order[j]) & passed]
    if not sharing:
        model = sweep.geometry.model
        names = [model.loops[k].name for k in ear]
        text = f"{stuck.text}{', or ' if stuck.refused else '; '}{axes_to_check(sweep.geometry, ear)}"
        raise PartitionError(f"{loops_named(model, ear)}: {text}", names, stuck.refused)
    for other, length in _others(order, i, sharing[:NEIGHBOURS]):
        if sweep.run(other[:length])[1] is None:
            return other
    cluster = tuple(sorted({*ear, *(k for j in sharing for k in order[j])}))
    return [x for j, x in enumerate(order[:i]) if j not in sharing] + [cluster] + order[i + 1 :]


def _others(order: Order, i: int, sharing: list[int]) -> Iterator[tuple[Order, int]]:
    """Other orders, each with the number of ears to test: first orders without a new cluster, then orders with
    a cluster around ear i."""
    before, ear, after = order[:i], order[i], order[i + 1 :]
    for j in sharing:
        yield before[:j] + [ear] + before[j:] + after, i + 1
    for j in sharing:
        yield before[:j] + before[j + 1 :] + [ear, before[j]] + after, i + 1
    for j in sharing:
        cluster = tuple(sorted((*ear, *before[j])))
        yield before[:j] + [cluster] + before[j + 1 :] + after, i
        yield before[:j] + before[j + 1 :] + [cluster] + after, i
