"""Assembly: coordinates that close all loops, speeds that keep them closed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..model.expressions import Expression
from ..model.model import Model
from .closure import Cuts, body_frames, ground_screws
from .errors import AssemblyError
from .geometry import Array, Geometry, evaluator, padded, parameter_values
from .newton import Closed, close
from .paths import PoseGroups, Ring, TwistGroups

if TYPE_CHECKING:
    from .partition import Partition

TRIES = 6
"""Guesses from which a ring that does not close is tried again, further and further from the given one."""


def initial_configuration(model: Model) -> tuple[Array, Array]:
    """The model's initial coordinates and speeds at the default parameters: a guess where loops decide.

    Returns
    -------
    q : (nq,) array
        Missing ones zero; quaternions of unit length, the unit quaternion where nothing is given.
    u : (nu,) array
    """
    evaluate = evaluator(parameter_values(model, None))

    def values(names: tuple[str, ...], given: dict[str, Expression]) -> Array:
        return np.array([evaluate([given[x]])[0] if x in given else 0.0 for x in names])

    q, u = values(model.coordinate_names, model.initial_q), values(model.speed_names, model.initial_u)
    for body, (place, _) in zip(model.bodies, model.coordinate_slices, strict=True):
        if body.joint.type in ("spherical", "free"):
            e = q[place.stop - 4 : place.stop]
            size = np.linalg.norm(e)
            e[:] = e / size if size > 1e-6 else (1.0, 0.0, 0.0, 0.0)
    return q, u


def assemble(
    model: Model,
    partition: Partition,
    q: Sequence[float] | Array,
    p: Sequence[float] | Array | None = None,
) -> Array:
    """Close all loops by moving dependent coordinates only, ear by ear, from a guess.

    Parameters
    ----------
    q : (nq,) array
        The guess; its independent entries are kept.
    p : (np,) array, optional
        The defaults if left out.

    Returns
    -------
    (nq,) array
        Closed to rounding; quaternions of dependent joints have unit length.

    Raises
    ------
    AssemblyError
        A loop stays open; the text names it and says by how much.
    """
    geometry = Geometry(model, p)
    return assembled(geometry, partition, padded(q))[0, : geometry.nq]


def assembled(geometry: Geometry, partition: Partition, q: Array) -> Array:
    """`assemble` for configurations ``(S, nq + 1)``."""
    moving = {int(geometry.speed_body[s]) for ear in partition.ears for s in ear.dependent}
    groups = PoseGroups(geometry, q, [k for k in range(geometry.ground) if k not in moving])
    for ear in partition.ears:
        geometry.lengths[list(ear.loops)] = ear.length
        ring = Ring(groups, ear.loops, {int(geometry.speed_body[s]) for s in ear.dependent})
        movable = np.tile(np.isin(ring.joints.speeds, ear.dependent).astype(float), (len(q), 1))
        outcome = close(ring, q, movable)
        if not np.all(outcome.ok):
            raise AssemblyError(open_loop(geometry, ring, outcome, movable[0]))
        q = outcome.q
        groups.found(ring.joints, q)
    return q


def open_loop(geometry: Geometry, ring: Ring, outcome: Closed, movable: Array) -> str:
    """Which loop stays open, by how much, and what to do."""
    model, worst = geometry.model, int(np.argmax(outcome.residual))
    rows = np.abs(outcome.rows[worst])
    loops = [model.loops[i] for i in ring.cuts.loops]
    owner = [(j, r) for j, i in enumerate(ring.cuts.loops) for r in geometry.rows[i]]
    gap = max(
        (x * geometry.lengths[ring.cuts.loops[j]] for x, (j, r) in zip(rows, owner, strict=True) if r < 3), default=0
    )
    angle = max((x for x, (_, r) in zip(rows, owner, strict=True) if r >= 3), default=0)
    j = owner[int(np.argmax(rows))][0]
    loop = loops[j]
    names = [
        model.bodies[i].name if i < geometry.ground else "ground" for i in (ring.cuts.starts[j], ring.cuts.ends[j])
    ]
    moved = [model.speed_names[s] for s, m in zip(ring.joints.speeds, movable, strict=True) if m]
    together = f" (closed together with {', '.join(x.name for x in loops if x is not loop)})" if len(loops) > 1 else ""
    return (
        f"loop {loop.name} ({loop.type} joint between {names[0]} and {names[1]}){together} cannot be closed: a gap of "
        f"{gap:.3g} m and {angle:.3g} rad is left after moving {shortened(moved) or 'nothing'}; lengths may be too short "
        f"or too long, or the initial values of the other coordinates too far off: check the lengths and give better "
        f"values under `initial`"
    )


def shortened(names: Sequence[str], limit: int = 6) -> str:
    """A list in words, long ones cut."""
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + more


def complete_speeds(
    model: Model,
    partition: Partition,
    q: Sequence[float] | Array,
    u: Sequence[float] | Array,
    p: Sequence[float] | Array | None = None,
) -> Array:
    """Dependent speeds from independent ones, by the velocity closure of one ear after the other.

    Parameters
    ----------
    q : (nq,) array
        Assembled.
    u : (nu,) array
        Its independent entries are kept, the others ignored.

    Returns
    -------
    (nu,) array
    """
    geometry = Geometry(model, p)
    motion = Motion(geometry, padded(q), np.asarray(u, dtype=float)[None, :, None])
    dependent = {s for ear in partition.ears for s in ear.dependent}
    bodies = {int(geometry.speed_body[s]) for s in dependent}
    motion.groups.found([k for k in range(geometry.ground) if k not in bodies], motion.u)
    for ear in partition.ears:
        geometry.lengths[list(ear.loops)] = ear.length
        motion.resolve(motion.closure(ear.loops), ear.dependent)
    return motion.u[0, :, 0]


class Motion:
    """K motions at S configurations, resolved ear by ear: the velocity level of closure.

    Attributes
    ----------
    u : (S, nu, K) array
        Speeds; dependent ones are right once their ear has been resolved.
    """

    def __init__(self, geometry: Geometry, q: Array, u: Array) -> None:
        self.geometry, self.u = geometry, u.copy()
        self.frames = body_frames(geometry, q)
        self.screws = ground_screws(geometry, q, self.frames)
        self.groups = TwistGroups(geometry, self.frames, self.screws, u.shape[-1])

    def closure(self, loops: Sequence[int]) -> VelocityClosure:
        """The velocity closure of an ear on what is known so far."""
        return VelocityClosure(self, loops)

    def resolve(self, closure: VelocityClosure, dependent: Sequence[int]) -> None:
        """Find the dependent speeds of an ear; its joints are known then."""
        columns = [closure.column[s] for s in dependent]
        others = [c for c in range(len(closure.speeds)) if c not in columns]
        right = closure.known + closure.E[..., others] @ self.u[:, closure.speeds[others]]
        if columns:
            self.u[:, list(dependent)] = -np.linalg.pinv(closure.E[..., columns], rcond=1e-12) @ right
        self.groups.found(closure.bodies, self.u)


class VelocityClosure:
    """``E u + known = 0`` for the joints of some loops that are not known yet.

    Attributes
    ----------
    bodies : list of int
        The f speeds' bodies, those near the cuts first.
    speeds : (f,) array
    column : dict of int to int
        Where a speed stands.
    E : (S, rows, f) array
    known : (S, rows, K) array
        What the known speeds contribute.
    size : (S, K) array
        How large the contributions are that `known` is the difference of.
    """

    def __init__(self, motion: Motion, loops: Sequence[int]) -> None:
        g = motion.geometry
        cuts = Cuts(g, loops)
        cuts.place(cuts.faces(motion.frames))
        w, v, sides = zip(*(motion.groups.difference(i, cuts.point[:, j]) for j, i in enumerate(loops)), strict=True)
        self.known = cuts.kept(cuts.conditions(np.stack(w, axis=1), np.stack(v, axis=1)))
        distance: dict[int, int] = {}
        for start, end in sides:
            for side in (start, end):
                for d, k in enumerate(side):
                    distance[k] = min(d, distance.get(k, d))
        self.bodies = sorted(distance, key=lambda k: distance[k])
        self.speeds = np.array([s for k in self.bodies for s in reversed(g.speeds[k])], dtype=int)
        self.column = {int(s): c for c, s in enumerate(self.speeds)}
        place = {k: i for i, k in enumerate(self.bodies)}
        sign = np.zeros((len(loops), len(self.bodies)))
        for j, (start, end) in enumerate(sides):
            sign[j, [place[k] for k in start]] = -1
            sign[j, [place[k] for k in end]] = 1
        body = g.speed_body[self.speeds]
        self.E = cuts.matrix(
            motion.screws[0][:, self.speeds],
            motion.screws[1][:, self.speeds],
            motion.frames[1][:, body],
            sign[:, [place[int(k)] for k in body]],
        )

    def scaled(self, geometry: Geometry, length: float) -> Array:
        """E with the columns of displacements per characteristic length."""
        return self.E * np.where(geometry.turning[self.speeds], 1.0, length)


def first_assembly(
    geometry: Geometry, order: Iterable[int], q: Array, held: set[int], random: np.random.Generator
) -> tuple[Array, Array, list[str]]:
    """Close all loops before it is known which coordinates depend on which: minimum-norm steps, loop by loop.

    A loop moves the joints that no earlier loop has passed; where that does not close it, those of its neighbours too,
    their loops closed with it, and so on outward.

    Parameters
    ----------
    order : iterable of int
        Loops.
    q : (S, nq + 1) array
        Guesses; the first is the model's.
    held : set of int
        Speeds whose coordinates the first configuration should keep.

    Returns
    -------
    q : (S, nq + 1) array
    ok : (S,) array
        Configurations that could be closed; the first always.
    warnings : list of str

    Raises
    ------
    AssemblyError
    """
    ok = np.ones(len(q), dtype=bool)
    warnings: list[str] = []
    groups = PoseGroups(geometry, q, [])
    done: list[int] = []
    for loop in order:
        start, end = groups.unknown(loop)
        ring = Ring(groups, [loop], [*start, *end])
        movable = _movable(ring, held, len(q))
        outcome = _tried(ring, q, movable, random)
        q = outcome.q
        if not outcome.ok[0]:
            q, wider = _closed_with_neighbours(geometry, loop, done, q, held, random, outcome, ring, movable)
            if wider:
                warnings.append(wider)
            moved = {k for i in [*done, loop] for side in geometry.cycle(i) for k in side}
            groups = PoseGroups(geometry, q, moved)
            # the other configurations have not followed; they must close anew or be left out
            cuts = Cuts(geometry, [*done, loop])
            residual = np.abs(cuts.place(cuts.faces(body_frames(geometry, q))))
            ok[1:] &= np.max(residual, axis=(1, 2))[1:] < 1e-8
        else:
            ok &= outcome.ok
            groups.found(ring.joints, q)
        done.append(loop)
    return q, ok, warnings


def _movable(ring: Ring, held: set[int], S: int) -> Array:
    """Held coordinates stay in the first configuration; the others are only there to look at ranks."""
    movable = np.ones((S, len(ring.joints.speeds)))
    movable[0, [i for i, s in enumerate(ring.joints.speeds) if int(s) in held]] = 0
    return movable


def _tried(ring: Ring, q: Array, movable: Array, random: np.random.Generator) -> Closed:
    """Close a ring, from other guesses too where the first does not lead to closure."""
    from .geometry import advance

    best = close(ring, q, movable)
    for i in range(TRIES):
        if np.all(best.ok) or not np.any(movable):
            break
        amplitude = 3.0 * (i + 1) / TRIES
        size = np.where(ring.geometry.turning[ring.joints.speeds], 1.0, np.max(ring.geometry.lengths[ring.cuts.loops]))
        step = amplitude * random.uniform(-1, 1, movable.shape) * movable * size
        again = close(
            ring, np.where(best.ok[:, None], best.q, advance(ring.geometry, q, ring.joints.speeds, step)), movable
        )
        better = again.residual < best.residual
        for name in ("q", "residual", "ok", "rows"):
            getattr(best, name)[better] = getattr(again, name)[better]
    return best


def _closed_with_neighbours(
    geometry: Geometry, loop: int, done: list[int], q: Array, held: set[int], random: np.random.Generator,
    outcome: Closed, ring: Ring, movable: Array,
) -> tuple[Array, str]:  # fmt: skip
    """Close a loop together with loops that share joints with it, more and more of them."""
    cycles = {i: {k for side in geometry.cycle(i) for k in side} for i in [*done, loop]}
    together = {loop}
    for hold in (held, set[int]()):
        while True:
            bodies = set().union(*(cycles[i] for i in together))
            wider = together | {i for i in done if cycles[i] & bodies}
            if wider != together:
                together = wider
                bodies = set().union(*(cycles[i] for i in together))
            elif hold is held and together != {loop}:
                break
            others = {k for i in done for k in cycles[i]} - bodies
            ring = Ring(PoseGroups(geometry, q, others), sorted(together), bodies)
            movable = _movable(ring, hold, len(q))
            outcome = _tried(ring, q, movable, random)
            if outcome.ok[0]:
                names = shortened([geometry.model.speed_names[s] for s in sorted(held)])
                note = (
                    ""
                    if hold is held
                    else f"loop {geometry.model.loops[loop].name} does not close at the given {names}"
                )
                return outcome.q, note
            if wider == together:
                break
    raise AssemblyError(open_loop(geometry, ring, outcome, movable[0]))
