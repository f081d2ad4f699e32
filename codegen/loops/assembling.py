"""Assembly: finds coordinates that close all loops."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..model.expressions import Expression
from ..model.model import Model
from ..model.vectors import Array
from .closure import Cuts, body_frames
from .dependents import choose_dependents, ranks, whole_joints
from .ears import Partition
from .errors import AssemblyError, listed
from .geometry import Geometry, advance, evaluator, parameter_values
from .odd_axes import axes_to_check
from .paths import PoseGroups
from .rings import ROUNDING, Outcome, Ring, close, is_closed_as_given, is_settled

NEARLY = 10.0
"""Factor of the model's tolerance up to which nearly redundant conditions may stay open, since lever arms magnify
errors."""

LEAST_MOTION = 1e-3
"""Smallest component of a joint in a unit motion of all joints that counts as motion; smaller ones are rounding."""

MANY = 100
"""Largest number of loops whose joints are examined together."""

TRIES = 8
"""Number of further guesses for a ring that does not close; their distance from the given guess grows."""

GUESSES = 16
"""Number of further guesses for an ear. Its independent coordinates are fixed, so the closed state may be far away."""

SEED = 20070404
"""Seed of the random guesses, so that equal initial values lead to equal states."""


def initial_configuration(model: Model) -> tuple[Array, Array]:
    """Initial coordinates and speeds of the model at the default parameters; in loops they are guesses.

    Returns
    -------
    q : (nq,) array
        Zero where the model gives none. Quaternions have unit length; the default is the unit quaternion.
    u : (nu,) array
    """
    evaluate = evaluator(parameter_values(model, None))

    def values(names: tuple[str, ...], given: dict[str, Expression]) -> Array:
        return np.array([evaluate([given[x]])[0] if x in given else 0.0 for x in names])

    q, u = values(model.coordinate_names, model.initial_q), values(model.speed_names, model.initial_u)
    for _, place in model.quaternions:
        e = q[place]
        size = np.linalg.norm(e)
        e[:] = e / size if size > 1e-6 else (1.0, 0.0, 0.0, 0.0)
    return q, u


def assembled(geometry: Geometry, partition: Partition, q: Array, nearly: bool = False, tries: int = 0) -> Array:
    """Coordinates ``(1, nq + 1)`` that close all loops, from a guess q, by moving the dependent coordinates only.

    A loop that does not close is tried again from up to `tries` other guesses. With `nearly`, loops that their
    dependent coordinates cannot close may stay open by the model's tolerance.
    """
    for ear in partition.ears:
        geometry.follow(ear)
    dependent = [s for ear in partition.ears for s in ear.dependent]
    moving = {int(geometry.speed_body[s]) for s in dependent}
    q = advance(geometry, q, dependent, np.zeros((1, len(dependent))))  # a step of zero normalises quaternions
    if is_closed(geometry, q):
        return q
    groups = PoseGroups(geometry, q, [k for k in range(geometry.ground) if k not in moving])
    for ear in partition.ears:
        ring = Ring(groups, ear.loops, {int(geometry.speed_body[s]) for s in ear.dependent})
        movable = np.isin(ring.joints.speeds, ear.dependent)
        outcome = close(ring, q, movable, geometry.tolerance) if nearly else close(ring, q, movable)
        if not outcome.closed and tries:
            outcome, _ = _tried(ring, q, movable, np.random.default_rng(SEED), tries)
        if not outcome.closed and not (outcome.settled and outcome.residual <= NEARLY * geometry.tolerance):
            raise open_loop(ring, outcome, movable)
        q = outcome.q
        groups.found(ring.joints, q)
    return q


def is_closed(geometry: Geometry, q: Array) -> bool:
    """Whether all loops are closed to rounding at coordinates ``(1, nq + 1)``."""
    cuts = Cuts(geometry, range(len(geometry.starts)))
    residual = np.max(np.abs(cuts.place(cuts.faces(body_frames(geometry, q)), q)), axis=2)
    reach = np.linalg.norm(cuts.point, axis=2) / geometry.lengths
    # equal rotations have equal rounding errors, which add up: ROUNDING / 300 for each link of a long ladder
    deepest = np.array(
        [max(geometry.depth[i], geometry.depth[j]) for i, j in zip(geometry.starts, geometry.ends, strict=True)]
    )
    return bool(np.all(residual <= np.maximum(4.0, deepest / 100) * ROUNDING * (1 + reach)))


def first_assembly(
    geometry: Geometry,
    order: Sequence[int],
    q: Array,
    held: set[int],
    random: np.random.Generator,
    open_: set[int] | None = None,
) -> tuple[Array, list[str]]:
    """Close all loops before a partition is known: minimum-norm steps, loop by loop.

    Each loop moves joints that no earlier loop has passed: first as few joints as have to be dependent, then all. A
    loop that still does not close is closed together with its neighbours, then also with the neighbours of these, until
    no loop is left to add.

    Parameters
    ----------
    order : sequence of int
        Loops in the order of closing.
    q : (1, nq + 1) array
        Guess.
    held : set of int
        Speeds whose coordinates are kept where possible.
    open_ : set of int, optional
        If given, loops may stay open by the model's tolerance where no joint can close them further. Such loops are added
        to this set.

    Returns
    -------
    q : (1, nq + 1) array
    warnings : list of str

    Raises
    ------
    AssemblyError
    """
    warnings: list[str] = []
    groups = PoseGroups(geometry, q, [])
    for place, loop in enumerate(order):
        start, end = groups.unknown(loop)
        ring = Ring(groups, [loop], [*start, *end])
        if is_closed_as_given(ring, q):
            groups.found(ring.joints, q)
            continue
        movable = ~np.isin(ring.joints.speeds, list(held))
        outcome, tries = _closed_alone(ring, (start, end), q, movable, random, open_)
        if outcome.closed:
            groups.found(ring.joints, outcome.q)
        else:
            outcome, tries = _with_neighbours(geometry, order[: place + 1], q, held, random, ring, outcome, open_)
            groups = PoseGroups(geometry, outcome.q, geometry.passed(order[: place + 1]))
        q = outcome.q
        if tries:
            warnings.append(
                f"loop {geometry.model.loops[loop].name} does not close from the initial values given. It was closed from other "
                f"values, perhaps in another configuration than you intend: give better values under `initial`"
            )
    return q, warnings


def _closed_alone(
    ring: Ring, sides: tuple[list[int], list[int]], q: Array, movable: Array, random: np.random.Generator,
    open_: set[int] | None,
) -> tuple[Outcome, int]:  # fmt: skip
    """Closes a loop by itself, or nearly if `open_` permits it; returns also the number of further guesses."""
    near_cut = _near_cut(ring, sides, q, movable)
    outcome = close(ring, q, near_cut)
    if outcome.closed:
        return outcome, 0
    nearly = None if open_ is None else _nearly_closed(ring, q, near_cut, movable)
    if nearly is None or open_ is None:
        return _tried(ring, q, movable, random)
    open_.update(() if nearly.closed else ring.cuts.loops)
    return replace(nearly, closed=True), 0


def _nearly_closed(ring: Ring, q: Array, *movable: Array) -> Outcome | None:
    """Closes a ring except for conditions that no joint can satisfy; None if no choice of movable speeds works."""
    tolerance = ring.geometry.tolerance
    for i, joints in enumerate(movable):
        if any(np.array_equal(joints, others) for others in movable[:i]):
            continue
        outcome = close(ring, q, joints, tolerance)
        if outcome.closed or (outcome.settled and outcome.residual <= NEARLY * tolerance):
            return outcome
    return None


def is_nearly_closed(geometry: Geometry, q: Array, loops: Sequence[int]) -> bool:
    """Whether no joint can reduce the residuals of loops that share joints, to first order.

    Away from a singular configuration this holds if the open conditions are redundant within the model's tolerance.
    Near a singular configuration it can also hold for conditions that joints do change: their residual is then of
    second order in the distance from that configuration.
    """
    return is_settled(_whole_ring(geometry, q, loops), q, geometry.tolerance)


def settled_together(geometry: Geometry, q: Array, loops: Sequence[int], held: set[int]) -> Array | None:
    """Coordinates at which loops that share joints are nearly closed together; None if no such coordinates are found.
    At `q` each loop is nearly closed by itself; joints of an earlier loop may reduce what a later loop leaves open.
    """
    ring = _whole_ring(geometry, q, loops)
    if is_settled(ring, q, geometry.tolerance):
        return q
    outcome = _nearly_closed(ring, q, ~np.isin(ring.joints.speeds, list(held)))
    return None if outcome is None else outcome.q


def loose_loops(geometry: Geometry, q: Array, loops: Sequence[int]) -> list[int]:
    """The connected loops whose joints can move, to first order; all of `loops` if there are more than MANY.

    In a structure, such as a triangle of bars, nothing moves.
    """
    if len(loops) > MANY:
        return list(loops)
    ring = _whole_ring(geometry, q, loops)
    speeds = ring.joints.speeds
    E = ring.evaluate(q)[1][0] * np.where(geometry.turning[speeds], 1.0, ring.length)
    if not E.shape[1]:
        return []
    _, s, Vt = np.linalg.svd(E)
    free = Vt[int(np.sum(s > geometry.tolerance * max(s[0], geometry.tolerance))) :]
    moving = np.abs(free).max(axis=0, initial=0.0) > LEAST_MOTION
    bodies = {int(k) for k in geometry.speed_body[speeds[moving]]}
    return [i for i in loops if geometry.passed([i]) & bodies]


def _whole_ring(geometry: Geometry, q: Array, loops: Sequence[int]) -> Ring:
    """The ring of all moving joints of some loops that share no joint with other loops."""
    bodies = {k for k in geometry.passed(loops) if geometry.speeds[k]}
    return Ring(PoseGroups(geometry, q, [k for k in range(geometry.ground) if k not in bodies]), loops, bodies)


def _near_cut(ring: Ring, sides: tuple[list[int], list[int]], q: Array, movable: Array) -> Array:
    """The smallest set of movable speeds that can close a ring; speeds near the cut are taken first."""
    g, speeds = ring.geometry, ring.joints.speeds
    free = np.flatnonzero(movable)
    E = ring.evaluate(q)[1] * np.where(g.turning[speeds], 1.0, ring.length)
    rank = int(ranks(E[..., free], g.tolerance)[0])
    if rank == len(free):
        return movable
    distance = {k: d for side in sides for d, k in enumerate(side)}
    free = free[np.argsort([distance[int(k)] for k in g.speed_body[speeds[free]]], kind="stable")]
    chosen = choose_dependents(E, whole_joints(g, speeds, free), rank)
    return movable if chosen is None else np.isin(np.arange(len(speeds)), chosen)


def _tried(
    ring: Ring, q: Array, movable: Array, random: np.random.Generator, tries: int = TRIES
) -> tuple[Outcome, int]:
    """Closes a ring, with other guesses if the given one fails; returns also the number of further guesses."""
    best = close(ring, q, movable)
    speeds = ring.joints.speeds[movable]
    size = np.where(ring.geometry.turning[speeds], 1.0, ring.length)
    for i in range(tries):
        if best.closed or not len(speeds):
            return best, i
        step = 3.0 * (i + 1) / tries * random.uniform(-1, 1, (1, len(speeds))) * size
        again = close(ring, advance(ring.geometry, q, speeds, step), movable)
        if again.residual < best.residual:
            best = again
    return best, tries


def _with_neighbours(
    geometry: Geometry,
    loops: Sequence[int],
    q: Array,
    held: set[int],
    random: np.random.Generator,
    ring: Ring,
    outcome: Outcome,
    open_: set[int] | None,
) -> tuple[Outcome, int]:
    """Close the last of some loops together with loops that share joints with it, adding more and more loops.

    Held coordinates move only if nothing else helps. `ring` and `outcome` belong to the loop by itself; `open_` is as
    in `first_assembly`.
    """
    *others, last = loops
    cycles = {i: geometry.passed([i]) for i in loops}
    movable = ~np.isin(ring.joints.speeds, list(held))
    for hold in (held, set[int]()) if held else (held,):
        together: set[int] = set()
        wider = {last}
        while wider != together:
            together = wider
            bodies = set().union(*(cycles[i] for i in together))
            wider = together | {i for i in others if cycles[i] & bodies}
            if len(together) == 1 and hold is held:
                continue  # this choice has been tried by _closed_alone
            rigid = set().union(*(cycles[i] for i in others if i not in together))
            ring = Ring(PoseGroups(geometry, q, rigid), sorted(together), bodies - rigid)
            movable = ~np.isin(ring.joints.speeds, list(hold))
            outcome, tries = _tried(ring, q, movable, random)
            if outcome.closed:
                return outcome, tries
            nearly = None if open_ is None else _nearly_closed(ring, outcome.q, movable)
            if nearly is not None and open_ is not None:
                open_.update(() if nearly.closed else [last])
                return nearly, tries
    raise open_loop(ring, outcome, movable)


def open_loop(ring: Ring, outcome: Outcome, movable: Array) -> AssemblyError:
    """The error for a ring that does not close: the name of the open loop, its residual, and the remedies."""
    g = ring.geometry
    model = g.model
    owner = [(i, r) for i in ring.cuts.loops for r in g.kept[i]]
    worst = owner[int(np.argmax(np.abs(outcome.rows)))][0]
    mine = [(x, r) for x, (i, r) in zip(outcome.rows, owner, strict=True) if i == worst]
    gap = float(np.linalg.norm([x * g.lengths[worst] for x, r in mine if r < 3]))
    turned = float(np.linalg.norm([x for x, r in mine if r >= 3]))
    angle = 2 * math.asin(min(1.0, turned / 2))
    loop = model.loops[worst]
    ends = [model.bodies[k].name if k < g.ground else "ground" for k in (g.starts[worst], g.ends[worst])]
    others = [model.loops[i].name for i in ring.cuts.loops if i != worst]
    together = f", closed together with {listed(others)}," if others else ""
    moved = [model.speed_names[s] for s in ring.joints.speeds[movable]]
    rank = int(ranks(ring.evaluate(outcome.q)[1][..., movable])[0])
    if angle > 3:
        remedy = "its faces are turned by pi relative to each other: turn one of them, or reverse an axis in its body"
    elif outcome.residual <= model.loop_tolerance and rank < len(owner):
        remedy = (
            f"this is within loop_tolerance, {model.loop_tolerance:g}, which covers only conditions that no joint changes. "
            "Near this pose joints change them: links in one line are too short or too long by the residual. Change a length by "
            "a little more than the residual, or give values under `initial` away from this pose"
        )
    elif outcome.residual < 1e-3 and rank < len(owner):
        remedy = (
            "an overconstrained loop closes only if its lengths and axes fit exactly, or if its redundant conditions fit within "
            f"loop_tolerance, {model.loop_tolerance:g}: give lengths and axes with all digits, or set loop_tolerance: "
            f"{float(f'{2 * outcome.residual:.0e}'):g}"
        )
    else:
        remedy = (
            "links may be too short or too long, or other initial coordinates too far off: check lengths and the values under "
            f"`initial`, and {axes_to_check(g, [worst])}"
        )
    if loop.is_coupling:
        residual = abs(mine[0][0])
        return AssemblyError(
            f"coupling {loop.name}{together} cannot be met: a residual of {residual:.3g} remains after moving "
            f"{listed(moved) or 'nothing'}; check its ratios and offset, and the values under `initial`",
            loop.name,
            outcome.residual,
        )
    return AssemblyError(
        f"loop {loop.name} ({loop.type} joint between {ends[0]} and {ends[1]}){together} cannot be closed: "
        f"{gap:.3g} m and {angle:.3g} rad remain after moving {listed(moved) or 'nothing'} (rank {rank}, "
        f"{len(owner)} conditions); {remedy}",
        loop.name,
        outcome.residual,
    )
