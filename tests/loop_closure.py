"""Numerical closure of loops with parts of `codegen.loops`: residuals, matrices and closed coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from codegen.loops.assembling import GUESSES, assembled
from codegen.loops.closure import COUPLED, Cuts, Frames, body_frames, ground_screws, shifted
from codegen.loops.ears import Partition
from codegen.loops.geometry import Geometry, padded
from codegen.loops.speed_groups import coordinates_of
from codegen.model.model import Model
from codegen.model.vectors import Array


def closure(
    model: Model,
    q: Sequence[float] | Array,
    u: Sequence[float] | Array,
    p: Sequence[float] | Array | None = None,
    lengths: Sequence[float] | Array | None = None,
) -> tuple[Array, Array]:
    """Residuals of all loops in the order of `Model.closure_names`.

    Parameters
    ----------
    q : (nq,) array
    u : (nu,) array
    p : (np,) array, optional
        The defaults if left out.
    lengths : (L,) array, optional
        By what the linear conditions of each loop are divided, m; those of `Geometry` if left out.

    Returns
    -------
    position : (m,) array
    velocity : (m,) array
        1/s.
    """
    geometry = Geometry(model, p)
    if lengths is not None:
        geometry.lengths = np.asarray(lengths, dtype=float)
    q, cuts = padded(q), Cuts(geometry, range(len(model.loops)), geometry.rows)
    frames = body_frames(geometry, q)
    position = cuts.place(cuts.faces(frames), q)
    speeds = np.asarray(u, dtype=float)[None, :, None]
    w, v = body_twists(geometry, q, frames, speeds)
    rates = difference(cuts, frames[1], w, v, speeds)
    return cuts.kept(position)[0], cuts.kept(rates)[0, :, 0]


def closure_matrix(
    model: Model,
    loop: int,
    q: Sequence[float] | Array,
    p: Sequence[float] | Array | None = None,
    length: float | None = None,
) -> tuple[tuple[int, ...], Array]:
    """The speeds of the joints on a loop's path, and the rate of the loop's scaled residual per unit of each."""
    geometry = Geometry(model, p)
    if length is not None:
        geometry.lengths[loop] = length
    q, cuts = padded(q), Cuts(geometry, [loop])
    frames = body_frames(geometry, q)
    cuts.place(cuts.faces(frames), q)
    sides = [[s for k in reversed(side) for s in geometry.speeds[k]] for side in geometry.cycle(loop)]
    speeds = [*sides[0], *sides[1]]
    w, v = ground_screws(geometry, q, frames)
    o = frames[1][:, geometry.speed_body[speeds]]
    sign = np.array([[-1.0] * len(sides[0]) + [1.0] * len(sides[1])])
    at_cut = cuts.at_cut(w[:, speeds], v[:, speeds], o)
    return tuple(speeds), cuts.matrix(w[:, speeds], at_cut, sign, speeds)[0]


def body_twists(geometry: Geometry, q: Array, frames: Frames, u: Array) -> tuple[Array, Array]:
    """Angular velocities, and velocities of the origins, of all bodies and the ground; ground frame.

    Parameters
    ----------
    u : (S, nu, K) array
        K sets of speeds for each configuration.

    Returns
    -------
    w, v : (S, n + 1, 3, K) array
    """
    n = geometry.ground
    screws = ground_screws(geometry, q, frames)
    w, v = (np.zeros((len(q), n + 1, 3, u.shape[-1])) for _ in range(2))
    for total, screw in zip((w, v), screws, strict=True):
        for s, k in enumerate(geometry.speed_body):
            total[:, k] += screw[:, s, :, None] * u[:, s, None, :]
    o, base = frames[1], np.array(geometry.parent)
    while len(open_ := np.flatnonzero(base != n)):
        b = base[open_]
        v[:, open_] += shifted(w[:, b], v[:, b], o[:, open_] - o[:, b])
        w[:, open_] += w[:, b]
        base[open_] = base[b]
    return w, v


def difference(cuts: Cuts, o: Array, w: Array, v: Array, u: Array) -> Array:
    """Velocity residuals ``(S, l, 6, K)`` from the motion of all bodies: origins ``(S, n, 3)``, twists ``(S, n, 3, K)``.

    Speeds are ``u (S, nu, K)``.
    """
    at = [shifted(w[:, b], v[:, b], cuts.point - o[:, b]) for b in (cuts.starts, cuts.ends)]
    found = cuts.conditions(w[:, cuts.ends] - w[:, cuts.starts], at[1] - at[0])
    for n, coupled in cuts.couplings:
        found[:, n, COUPLED] = np.einsum("t,stk->sk", coupled.factors, u[:, coupled.speeds])
    return found


def assemble(
    model: Model,
    partition: Partition,
    q: Sequence[float] | Array,
    p: Sequence[float] | Array | None = None,
) -> Array:
    """Close all loops by moving dependent coordinates only, ear by ear, from a guess.

    An ear that does not close from there is tried from other dependents, further and further off, the same each time.

    Parameters
    ----------
    q : (nq,) array
        The guess; its independent entries are kept. A quaternion or position of which some speeds are dependent is moved
        along those only: rotation and displacement in child axes.
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
    geometry = Geometry(model.with_turned(partition.turned), p)
    return assembled(geometry, partition, padded(q), tries=GUESSES)[0, : geometry.nq]


def independent_coordinates(model: Model, partition: Partition) -> tuple[int, ...]:
    """Indices of the independent coordinates, ascending; all coordinates of a split rotation or displacement count."""
    dependent, _ = coordinates_of(model, partition.dependent)
    return tuple(sorted({*range(model.nq)} - {*dependent}))
