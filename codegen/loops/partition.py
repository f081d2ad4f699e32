"""Which speeds are dependent, and in what order the loops are closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..model.errors import nearest
from ..model.model import Model
from .assembling import Motion, VelocityClosure, assembled, first_assembly, initial_configuration, shortened
from .dependents import choose_dependents, condition, ranks
from .errors import AssemblyError, PartitionError
from .geometry import Array, Geometry, advance, padded

CONFIGURATIONS = 3
"""The initial configuration and some near it, so that a special pose does not decide on ranks."""

NEARBY = 0.05
"""rad and characteristic lengths: how far the others start from it."""

MOTIONS = 12
"""Random motions of the independents that each ear must follow: more than a loop has conditions."""

SEED = 20030617
"""Of the random numbers: the same model has the same partition."""


@dataclass(frozen=True, slots=True)
class Ear:
    """Loops that are closed together: one, or the several of a cluster.

    Attributes
    ----------
    loops : tuple of int
        Indices into `Model.loops`.
    dependent : tuple of int
        Indices of the speeds that they make dependent, in path order: outward on the start side, then outward on the end
        side; loop by loop in a cluster. As many as `rank`.
    rows : int
        Conditions that the loop joints set.
    rank : int
        How many of them are independent, for all motions that earlier ears allow.
    condition : float
        Of the closure matrix of the dependent speeds, displacements and linear conditions scaled with `length`, at the
        assembled initial configuration.
    length : float
        Characteristic length of the loops, a power of two, m: linear conditions are divided by it.
    """

    loops: tuple[int, ...]
    dependent: tuple[int, ...]
    rows: int
    rank: int
    condition: float
    length: float

    @property
    def redundant(self) -> int:
        """Conditions that follow from others."""
        return self.rows - self.rank


@dataclass(frozen=True, slots=True)
class Partition:
    """The loops in an order in which each ear closes on what is resolved already.

    Attributes
    ----------
    ears : tuple of Ear
    independent : tuple of int
        Indices of the independent speeds, ascending.
    q : tuple of float
        The assembled initial configuration that ranks were found at.
    warnings : tuple of str
        What a user should know about the choice.
    """

    ears: tuple[Ear, ...]
    independent: tuple[int, ...]
    q: tuple[float, ...] = ()
    warnings: tuple[str, ...] = field(default=())


def partition(model: Model) -> Partition:
    """Choose dependents and order the ears.

    Raises
    ------
    AssemblyError
        A loop cannot be closed.
    PartitionError
        A hint cannot be honoured, or no freedom is left.
    """
    geometry = Geometry(model)
    q0 = initial_configuration(model)[0]
    if not model.loops:
        return Partition((), tuple(range(model.nu)), tuple(float(x) for x in q0))
    held = hinted(geometry)
    order = loop_order(geometry, held)
    random = np.random.default_rng(SEED)
    guesses = np.repeat(padded(q0), CONFIGURATIONS, axis=0)
    length = np.median(geometry.lengths)
    speeds = np.arange(model.nu)
    step = random.uniform(-NEARBY, NEARBY, (CONFIGURATIONS, model.nu)) * np.where(geometry.turning, 1.0, length)
    step[0] = 0
    guesses = advance(geometry, guesses, speeds, step)
    q, ok, warnings = first_assembly(geometry, order, guesses, held, random)
    drafts = Sweep(geometry, q[ok], held, random).run([(i,) for i in order])
    ears = [_ear(geometry, draft) for draft in drafts]
    dependent = {s for ear in ears for s in ear.dependent}
    independent = tuple(s for s in range(model.nu) if s not in dependent)
    if not independent:
        raise PartitionError(
            f"no freedom left: the {len(model.loops)} loops make all {model.nu} speeds dependent; "
            f"remove a loop or give a joint one more freedom"
        )
    result = Partition(tuple(ears), independent, (), tuple(warnings))
    try:
        q_final = assembled(geometry, result, padded(q0))
    except AssemblyError as error:
        q_final = q[:1]
        warnings.append(f"{error}; the assembled configuration moves independent coordinates too")
    motion = Motion(geometry, q_final, np.zeros((1, model.nu, 1)))
    ears = [_with_condition(motion, ear) for ear in ears]
    return Partition(tuple(ears), independent, tuple(map(float, q_final[0, : model.nq])), tuple(warnings))


def hinted(geometry: Geometry) -> set[int]:
    """Speeds that the model asks to be independent; of a quaternion joint all, whichever is named."""
    model, held = geometry.model, set[int]()
    place = {name: i for i, name in enumerate(model.coordinate_names)}
    body = {i: k for k, (q, _) in enumerate(model.coordinate_slices) for i in range(q.start, q.stop)}
    for name in model.independent:
        if name not in place:
            raise PartitionError(
                f"independent: {name!r} is no coordinate of the model{nearest(name, model.coordinate_names)}"
            )
        k = body[place[name]]
        q, speeds = geometry.slices[k][0], geometry.speeds[k]
        held |= set(speeds) if geometry.whole[k] else {speeds[place[name] - q.start]}
    return held


def loop_order(geometry: Geometry, held: set[int]) -> list[int]:
    """Loops outward: always the one with the fewest freedoms that no earlier loop has passed.

    So a loop next to one that is closed comes before one that is far from it, and hinted coordinates count as known.
    """
    freedoms = [sum(s not in held for s in speeds) for speeds in geometry.speeds]
    cycles = [[k for side in geometry.cycle(i) for k in side] for i in range(len(geometry.starts))]
    passing: list[list[int]] = [[] for _ in range(geometry.ground)]
    for i, cycle in enumerate(cycles):
        for k in cycle:
            passing[k].append(i)
    left = np.array([sum(freedoms[k] for k in cycle) for cycle in cycles])
    order: list[int] = []
    passed = set[int]()
    never = np.iinfo(left.dtype).max // 2
    while len(order) < len(cycles):
        loop = int(np.argmin(left))
        order.append(loop)
        for k in cycles[loop]:
            if k not in passed:
                passed.add(k)
                left[passing[k]] -= freedoms[k]
        left[loop] = never
    return order


@dataclass(slots=True)
class Draft:
    """An ear in the making."""

    loops: tuple[int, ...]
    dependent: list[int]
    rows: int


class Sweep:
    """Ears one after the other, with random motions of the independents found so far.

    Parameters
    ----------
    q : (S, nq + 1) array
        Assembled configurations.
    held : set of int
        Speeds that must stay independent.
    """

    def __init__(self, geometry: Geometry, q: Array, held: set[int], random: np.random.Generator) -> None:
        self.geometry, self.q, self.held = geometry, q, held
        u = random.normal(size=(geometry.nu, MOTIONS))
        self.u = np.repeat(u[None], len(q), axis=0)

    def run(self, order: Sequence[tuple[int, ...]]) -> list[Draft]:
        motion = Motion(self.geometry, self.q, self.u)
        regular = np.ones(len(self.q), dtype=bool)
        drafts = []
        for loops in order:
            closure = motion.closure(loops)
            draft, regular = self.close(closure, loops, regular)
            motion.resolve(closure, draft.dependent)
            drafts.append(draft)
        return drafts

    def close(self, closure: VelocityClosure, loops: tuple[int, ...], regular: Array) -> tuple[Draft, Array]:
        g = self.geometry
        E = closure.scaled(g, float(np.max(g.lengths[list(loops)])))
        free = [c for c, s in enumerate(closure.speeds) if int(s) not in self.held]
        found = ranks(E[..., free])
        rank = int(np.max(found[regular]))
        regular = regular & (found == rank)
        if not _follows(E[..., free][regular], closure.known[regular], rank):
            names = shortened([g.model.loops[i].name for i in loops])
            raise PartitionError(f"loop {names} does not close by itself: rank {rank}")
        joints: dict[int, list[int]] = {}
        for c in free:
            s = int(closure.speeds[c])
            k = int(g.speed_body[s])
            joints.setdefault(k if g.whole[k] else -1 - s, []).append(c)
        chosen = choose_dependents(E[regular], [tuple(x) for x in joints.values()], rank)
        if chosen is None:
            names = shortened([g.model.loops[i].name for i in loops])
            raise PartitionError(f"loop {names}: quaternion joints cannot be dependent as a whole (rank {rank})")
        return Draft(loops, [int(closure.speeds[c]) for c in chosen], E.shape[1]), regular


def _follows(E: Array, known: Array, rank: int) -> bool:
    """Whether the columns of E (of this rank) can undo all that known motions do."""
    if rank == E.shape[1]:
        return True
    U = np.linalg.svd(E)[0] if E.shape[2] else np.tile(np.eye(E.shape[1]), (len(E), 1, 1))
    size = np.max(np.abs(known), axis=1, keepdims=True)
    return bool(np.max(np.abs(np.swapaxes(U[..., rank:], -1, -2) @ (known / np.maximum(size, 1e-9)))) < 1e-6)


def _ear(geometry: Geometry, draft: Draft) -> Ear:
    path: list[int] = []
    for loop in draft.loops:
        for side in geometry.cycle(loop):
            path += [s for k in reversed(side) for s in geometry.speeds[k] if s in draft.dependent and s not in path]
    length = float(np.max(geometry.lengths[list(draft.loops)]))
    return Ear(draft.loops, tuple(path), draft.rows, len(path), float("nan"), length)


def _with_condition(motion: Motion, ear: Ear) -> Ear:
    closure = motion.closure(ear.loops)
    columns = [closure.column[s] for s in ear.dependent]
    found = condition(closure.scaled(motion.geometry, ear.length)[..., columns])
    motion.groups.found(closure.bodies, motion.u)
    return Ear(ear.loops, ear.dependent, ear.rows, ear.rank, found, ear.length)


def describe(model: Model, partition: Partition) -> list[str]:
    """Readable lines about loops, ears, dependents, ranks, redundant conditions and freedoms."""
    lines = []
    for ear in partition.ears:
        names = ", ".join(model.loops[i].name for i in ear.loops)
        dependent = ", ".join(model.speed_names[s] for s in ear.dependent)
        lines.append(f"{names}: {dependent}; rank {ear.rank} of {ear.rows}, condition {ear.condition:.3g}")
    return lines
