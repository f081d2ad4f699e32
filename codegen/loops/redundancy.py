"""Redundant conditions of loops, exact to rounding or within the tolerance, and parameters that open them.

If the redundancy of an ear is exact to rounding, all of its conditions are met together, and none is dropped. Numbers
of few digits, such as 1.5708 for pi/2, leave a planar loop a little out of its plane. The redundant conditions can then
be met nearly, never exactly. Conditions are dropped until there are no more conditions than dependent speeds. The
choice is made once: the kept set must be well conditioned at several configurations. Conditions are taken along axes of
the start face, because the plane of a planar loop and the centre of a spherical one are fixed there.

A parameter may open redundant conditions, for instance one that shifts a revolute joint along its axis. This module
finds such parameters from small changes of the joints' frames. No derivative of the generated code is computed this
way.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field
from itertools import combinations, islice
from math import comb

import numpy as np

from ..model.expressions import Expression
from ..model.model import Coupling, Model, Vector, closure_row_names
from ..model.vectors import Array, turn
from ..records import dataclass
from .closure import Cuts
from .dependents import ranks
from .geometry import Geometry
from .ordering import Draft
from .velocities import Motion, VelocityClosure

ROUNDING = 2e-14
"""Residual of redundant conditions that counts as rounding, per unit of the distance from the base."""

SPACING = 4e-16
"""Residual that counts as rounding, per unit of the condition number of the dependents' columns: the condition number limits the
accuracy of the range of these columns."""

FAR = 2e-11
"""Value that replaces `ROUNDING` at configurations that are closed less accurately."""

OPENED = 1e-7
"""Residual per unit change of a parameter up to which the parameter does not open a redundant condition."""

ALLOWED = 10.0
"""Factor of the model's tolerance up to which a dropped condition may be open, since lever arms magnify errors."""

SUBSETS = 5000
"""Largest number of sets of conditions that are compared; beyond it, rows are eliminated one by one."""

LEAST_OFF = 1e-13
"""Angle between two axes, rad, that counts as a rounding error, so that the axes are parallel."""

AS_GOOD = 0.7
"""An earlier set of conditions is preferred if its quality exceeds this fraction of a later one's; an earlier row, if
its remainder is at least this fraction of the largest."""

WORTH_TURNING = 0.6
"""Fraction of the quality along axes of ``to`` below which conditions along axes of ``from`` are replaced."""

STEP = 2.0**-10
"""Step of a parameter, as a fraction of its magnitude or of this number, whichever is larger."""


@dataclass(slots=True)
class Redundancy:
    """The redundant conditions of a model.

    Attributes
    ----------
    dropped : dict of int to list of int
        By loop, positions of the ignored conditions among `closure_row_names`.
    gaps : set of int
        Loops whose faces may be apart, or may be moved apart by a parameter.
    opening : set of int
        Parameters that open redundant conditions.
    remarks : list of str
    """

    dropped: dict[int, list[int]] = field(default_factory=dict)
    gaps: set[int] = field(default_factory=set)
    opening: set[int] = field(default_factory=set)
    remarks: list[str] = field(default_factory=list)


def nearly_redundant(
    geometry: Geometry, drafts: Sequence[Draft], q: Array, random: np.random.Generator, rounding: float = ROUNDING
) -> list[Draft]:
    """Ears whose conditions are redundant within the tolerance but not to rounding, at a configuration ``(1, nq +
    1)``."""
    found = []
    motion = Motion(geometry, q, random.normal(size=(1, geometry.nu, 4)))
    for draft in drafts:
        closure = motion.closure(draft.loops, geometry.rows)
        if draft.rows > len(draft.dependent) and _left(geometry, closure, draft) > rounding:
            found.append(draft)
        motion.resolve(closure, draft.dependent)
    return found


def _left(geometry: Geometry, closure: VelocityClosure, draft: Draft) -> float:
    """Residuals of an ear's redundant conditions, for its motions and for its position, relative to sizes to which
    rounding errors are proportional."""
    E = closure.scaled(geometry, float(geometry.lengths[draft.loops[0]]))[0]
    A = E[:, [closure.column[s] for s in draft.dependent]]
    U, s, _ = np.linalg.svd(A)
    left = U[:, A.shape[1] :].T
    worse = 1.0 + SPACING / ROUNDING * float(s[0] / s[-1]) if len(s) else 1.0
    size = worse * max(1.0, float(np.abs(E).max(initial=0.0)))
    by_known = np.abs(left @ closure.known[0]) / np.maximum(closure.size[0], 1e-300)
    found = [np.abs(left @ E).max(initial=0.0) / size, by_known.max(initial=0.0) / worse]
    return float(max(*found, np.abs(left @ closure.position[0]).max(initial=0.0)) / (1 + closure.reach()))


def kept_rows(geometry: Geometry, draft: Draft, configurations: Sequence[Array]) -> list[tuple[int, int]]:
    """Conditions of an ear that determine its dependents best, judged at the worst configuration; as pairs of loop and
    row of six.

    Singular configurations are ignored; if all are singular, all conditions are kept. An ear without dependents keeps none.
    """
    if not draft.dependent:
        return []
    A = _columns(geometry, draft, configurations)
    names = [(i, r) for i in draft.loops for r in geometry.rows[i]]
    rank = A.shape[2]
    if not len(A):
        return names
    # angular conditions first: if they suffice, the displacement between the faces needs no condition
    order = sorted(range(len(names)), key=lambda n: (names[n][1] < 3, n))
    if comb(len(names), rank) > SUBSETS:
        return sorted(names[n] for n in _eliminated(A, order))
    whole = np.linalg.svd(A, compute_uv=False)[:, -1]
    best: tuple[int, ...] = ()
    quality = 0.0
    for subset in islice(combinations(order, rank), SUBSETS):
        found = float(np.min(np.linalg.svd(A[:, list(subset)], compute_uv=False)[:, -1] / np.maximum(whole, 1e-300)))
        if not best or found * AS_GOOD > quality:
            best, quality = subset, found
    return sorted(names[n] for n in best)


def _columns(geometry: Geometry, draft: Draft, configurations: Sequence[Array]) -> Array:
    """Columns of an ear's dependents, ``(S, rows, r)``, at the regular configurations."""
    matrices = []
    for q in configurations:
        closure = Motion(geometry, q, np.zeros((1, geometry.nu, 1))).closure(draft.loops, geometry.rows)
        E = closure.scaled(geometry, float(geometry.lengths[draft.loops[0]]))[0]
        matrices.append(E[:, [closure.column[s] for s in draft.dependent]])
    A = np.stack(matrices)
    return A[ranks(A) == A.shape[2]]


def turned_round(
    geometry: Geometry, draft: Draft, rows: Sequence[tuple[int, int]], configurations: Sequence[Array]
) -> list[int]:
    """Loops of an ear whose conditions should be taken along the axes of the other face.

    These conditions determine the dependents well in poses in which `rows` do not. For instance, a crank of a
    parallel-crank mechanism is determined in all poses by the condition across itself. The condition along the rod
    fails when crank and rod are in line.
    """
    names = [(i, r) for i in draft.loops for r in geometry.rows[i]]
    loops = [i for i in draft.loops if i not in geometry.couplings and sum(r < 3 for r in geometry.rows[i]) == 3]
    linear = sum(r < 3 for _, r in rows)
    if not loops or not 0 < linear < sum(r < 3 for _, r in names):
        return []
    other = Geometry(geometry.model.with_turned(loops), lengths=geometry.lengths)
    kept = kept_rows(other, draft, configurations)
    here, there = (
        _quality(_columns(g, draft, configurations), [names.index(row) for row in of])
        for g, of in ((geometry, rows), (other, kept))
    )
    return loops if here < WORTH_TURNING * there else []


def _quality(A: Array, rows: list[int]) -> float:
    """Quality of some rows of ``(S, rows, r)`` at the worst configuration: 1 if they determine as much as all rows."""
    if not len(A):
        return 0.0
    part, whole = (np.linalg.svd(x, compute_uv=False)[:, -1] for x in (A[:, rows], A))
    return float(np.min(part / np.maximum(whole, 1e-300)))


def _eliminated(A: Array, order: list[int]) -> list[int]:
    """As many rows of A ``(S, rows, r)`` as A has columns; each is the first in `order` with nearly the largest remainder."""
    rest, chosen = A.copy(), list[int]()
    while len(chosen) < A.shape[2]:
        size = np.min(np.linalg.norm(rest, axis=2), axis=0)
        n = next(n for n in order if size[n] >= AS_GOOD * size.max())
        chosen.append(n)
        b = rest[:, n] / np.maximum(np.linalg.norm(rest[:, n], axis=1, keepdims=True), 1e-300)
        rest = rest - (rest @ b[..., None]) * b[:, None]
        rest[:, chosen] = 0
    return chosen


def keep(geometry: Geometry, draft: Draft, rows: Sequence[tuple[int, int]]) -> None:
    """Keeps the given conditions of an ear, and drops its other conditions."""
    for i in draft.loops:
        geometry.kept[i] = [r for r in geometry.rows[i] if (i, r) in rows]


def names_of(geometry: Geometry, loop: int) -> dict[int, int]:
    """Positions of a loop's conditions among `closure_row_names`, by their row of six."""
    return {r: n for n, r in enumerate(geometry.rows[loop])}


# --- remarks ------------------------------------------------------------------------------------------------------------


def remark(geometry: Geometry, draft: Draft, q: Array) -> str:
    """Text about the dropped conditions of an ear, with the reason."""
    model = geometry.model
    dropped = [
        closure_row_names(model.loops[i])[n]
        for i in draft.loops
        for r, n in names_of(geometry, i).items()
        if r not in geometry.kept[i]
    ]
    closure = Motion(geometry, q, np.zeros((1, geometry.nu, 1))).closure(draft.loops, geometry.rows)
    names = ", ".join(model.loops[i].name for i in draft.loops)
    kept = {(j, k) for j in draft.loops for k in geometry.kept[j]}
    rows = [(i, r) for i in draft.loops for r in geometry.rows[i]]
    left = {row: abs(float(x)) for row, x in zip(rows, closure.position[0], strict=True) if row not in kept}
    largest = max(left.values(), default=0.0)
    length = float(geometry.lengths[draft.loops[0]])
    apart = max((x * length for (_, r), x in left.items() if r < 3), default=0.0)
    turned = max((x for (_, r), x in left.items() if r >= 3), default=0.0)
    fit = f"lengths fit to {apart:.1e} m, axes to {turned:.1e} rad at the initial configuration"
    shape = _shape(geometry, closure) or f"moves in a plane, where its {fit}"
    return (
        f"loop{'s' * (len(draft.loops) > 1)} {names} {shape}; dropped as redundant to that "
        f"accuracy: {', '.join(dropped)} (residual at the initial configuration {largest:.1e}; `closure` reports the residuals). "
        f"They are redundant near the initial configuration; a motion ends where one of them opens by more than "
        f"{ALLOWED * geometry.tolerance:g}"
    )


def _shape(geometry: Geometry, closure: VelocityClosure) -> str:
    """Text about the kind of motion that the joints of an ear nearly have, and about how far the joints deviate from
    it."""
    turning = geometry.turning[closure.speeds]
    w, v = closure.screws[0][0][turning], closure.screws[1][0][~turning]
    if len(w):
        axis = np.linalg.svd(w)[2][0]
        off = float(np.linalg.norm(np.cross(w[:, None], w), axis=2).max())
        off = max(off, float(np.abs(v @ axis).max(initial=0.0)))
        if off <= ALLOWED * geometry.tolerance:
            return f"taken as planar: axes agree to {off:.1e} rad" if off > LEAST_OFF else ""
        if not len(v):
            # x is the point closest to all axes
            o = closure.origins[0][turning]
            P = np.eye(3) - w[:, :, None] * w[:, None, :]
            x = np.linalg.lstsq(P.reshape(-1, 3), (P @ o[..., None]).reshape(-1), rcond=None)[0]
            off = float(np.linalg.norm((P @ (x - o)[..., None])[..., 0], axis=1).max())
            if off <= ALLOWED * geometry.tolerance * float(np.max(geometry.lengths[closure.loops])):
                return f"taken as spherical: axes meet in a point to {off:.1e} m"
    return "taken as able to move: its lengths and axes fit nearly, not exactly"


# --- parameters that open redundant conditions --------------------------------------------------------------------------


def opening(geometry: Geometry, drafts: Sequence[Draft], configurations: Sequence[Array]) -> tuple[set[int], set[int]]:
    """Parameters that open redundant conditions if they change alone, and the loops that they open."""
    model = geometry.model
    if not any(d.rows > len(d.dependent) for d in drafts):
        return set(), set()
    moving = [j for j, p in enumerate(model.parameters) if p.name in _names(model)]
    if not moving:
        return set(), set()
    changed = [[_changed(geometry, j, part * _step(model, j)) for part in (1, -1, 0.5, -0.5)] for j in moving]
    parameters, loops = set[int](), set[int]()
    for q in configurations:
        for j, draft in _opened(geometry, drafts, q, moving, changed):
            parameters.add(j)
            loops.update(draft.loops)
    return parameters, loops


def _names(model: Model) -> set[str]:
    """Names in the expressions for the poses of joints and faces."""
    found: set[str] = set()

    def place(at: Vector, rotation: Iterable[tuple[Vector, Expression]], axes: Iterable[Vector]) -> None:
        for e in (*at, *(e for axis in axes for e in axis), *(e for axis, angle in rotation for e in (*axis, angle))):
            found.update(e.names)

    for b in model.bodies:
        place(b.joint.at, b.joint.rotation, b.joint.axes)
        found.update(name for e in b.joint.factors for name in e.names)
    for x in model.loops:
        place(x.start.at, x.start.rotation, x.axes)
        place(x.end.at, x.end.rotation, ())
        if isinstance(x, Coupling):
            found.update(name for e in (x.offset, *(t.factor for t in x.terms)) for name in e.names)
        found.update(name for f in x.surfaces for name in f.value.names)
    return found


def _step(model: Model, j: int) -> float:
    return STEP * max(abs(model.parameters[j].value), STEP)


def _changed(geometry: Geometry, j: int, by: float) -> Geometry:
    """The geometry with one parameter changed by `by`, with the characteristic lengths of the given geometry."""
    values = [p.value for p in geometry.model.parameters]
    values[j] += by
    return Geometry(geometry.model, values, geometry.lengths)


def _rate(values: Sequence[Array], step: float) -> Array:
    """Rate of change by a fourth-order central difference, from values at one step and half a step to both sides."""
    whole, half = (values[0] - values[1]) / (2 * step), (values[2] - values[3]) / step
    return (4 * half - whole) / 3


def _opened(
    geometry: Geometry, drafts: Sequence[Draft], q: Array, moving: list[int], changed: list[list[Geometry]]
) -> Iterable[tuple[int, Draft]]:
    """Pairs of a parameter and an ear that it opens at a configuration, after the dependent joints have closed the ear
    as far as possible."""
    model = geometry.model
    steps = [_step(model, j) for j in moving]
    K, n = len(moving), geometry.ground
    still = Motion(geometry, q, np.zeros((1, geometry.nu, K)))
    R = still.frames[0]
    inboard = R[:, geometry.parent[:n]]
    w, v = (np.zeros((1, n + 1, 3, K)) for _ in range(2))
    for c, others in enumerate(changed):
        turned, moved = zip(*(g.all_joints.transforms(q) for g in others), strict=True)
        spin = _rate(turned, steps[c]) @ np.swapaxes(geometry.all_joints.transforms(q)[0], -1, -2)
        w[:, :n, :, c] = turn(inboard, spin[..., [2, 0, 1], [1, 2, 0]])
        v[:, :n, :, c] = turn(inboard, np.broadcast_to(_rate(moved, steps[c]), (1, n, 3)))
    motion = Motion(geometry, q, np.zeros((1, geometry.nu, K)), (w, v))
    faces = np.stack([
        _rate([_residuals(g, geometry, motion) for g in others], step) for others, step in zip(changed, steps, strict=True)
    ], axis=-1)  # fmt: skip
    for draft in drafts:
        closure = motion.closure(draft.loops, geometry.rows)
        right = closure.known[0] + np.concatenate([faces[i, geometry.rows[i]] for i in draft.loops])
        names = [(i, r) for i in draft.loops for r in geometry.rows[i]]
        kept = [m for m, (i, r) in enumerate(names) if r in geometry.kept[i]]
        A = closure.E[0][:, [closure.column[s] for s in draft.dependent]]
        x = -np.linalg.pinv(A[kept], rcond=1e-12) @ right[kept]
        motion.u[0, list(draft.dependent)] = x
        motion.groups.found(closure.bodies, motion.u)
        left = np.abs(right + A @ x).max(axis=0, initial=0.0)
        size = 1 + np.abs(right).max(axis=0, initial=0.0) + np.abs(x).max(axis=0, initial=0.0)
        allowed = OPENED * size if len(kept) == len(names) else ALLOWED * geometry.tolerance * np.ones(K)
        yield from ((j, draft) for j, opens in zip(moving, left > allowed, strict=True) if opens)


def _residuals(changed: Geometry, geometry: Geometry, motion: Motion) -> Array:
    """Position residuals ``(L, 6)`` of the loops of a changed geometry, with the bodies placed as in a motion."""
    cuts = Cuts(changed, range(len(geometry.model.loops)), geometry.rows)
    return cuts.place(cuts.faces(motion.frames), motion.q)[0]
