"""Motion of bodies and of points fixed in bodies, with derivatives and Jacobians; the model needs no outputs for
these."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, Times
from ..calls.arguments import unknown
from ..calls.functions import Wanted, over_points
from ..calls.room import Room
from .frame_motion import FrameMotion, PointMotion, alone, frames_from, point_tangents, points_on

MOST_CHOICES = 64
"""Maximum number of selections of points that are stored."""

Bodies = str | Sequence[str] | None
"""Names of bodies: several, a single one, or None for all."""
Points = Any
"""Points as a user selects them: names of points or bodies of the model, pairs of a body and a place in its frame, or a
single such item. None: all points of the model."""


class Frames(Room):
    """Motion of bodies and of points fixed in bodies."""

    def frames(self, given: tuple[Any, ...], bodies: Bodies, accelerations: bool) -> FrameMotion:
        """See `Solver.frames`."""
        chosen, names = self._bodies(bodies)
        return self._frames(self._moving(given), accelerations, chosen, names)

    def frame_sensitivities(
        self, given: tuple[Any, ...], along: tuple[Any, ...], bodies: Bodies, accelerations: bool
    ) -> tuple[FrameMotion, FrameMotion]:
        """See `Solver.frame_sensitivities`."""
        chosen, names = self._bodies(bodies)
        given = self._moving(given)
        if accelerations or chosen is not None:
            return self._frames_along(given, along, accelerations, chosen, names)
        values, tangents = self._call("frame_sensitivities", given, along)
        return FrameMotion(names, values, None), FrameMotion(names, tangents, None)

    def frame_jacobians(self, q: Numbers, p: Numbers, inputs: Numbers, t: Times, bodies: Bodies) -> Array:
        """See `Solver.frame_jacobians`."""
        chosen, _ = self._bodies(bodies)
        tangents = self._call("frame_sensitivities", *self._at_rest_by_speeds(q, p, inputs, t))[1]
        return _last((tangents if chosen is None else tangents[..., chosen, :])[..., 12:])

    def points(self, given: tuple[Any, ...], points: Points, accelerations: bool) -> PointMotion:
        """See `Solver.points`."""
        chosen = self._chosen(points)
        given = self._moving(given)
        known = self.package._calls[chosen.values[accelerations]](given, None, None)
        if known is not None:
            return PointMotion(chosen.names, *known)
        frames = self._frames(given, accelerations, None, chosen.names)
        found = points_on(chosen.carriers(frames, False), chosen.places(given[2]), chosen.names)
        return alone(found) if chosen.single else found

    def point_sensitivities(
        self, given: tuple[Any, ...], along: tuple[Any, ...], points: Points, accelerations: bool
    ) -> tuple[PointMotion, PointMotion]:
        """See `Solver.point_sensitivities`."""
        chosen = self._chosen(points)
        given = self._moving(given)
        known = None if self._watched else self.package._calls[chosen.along[accelerations]](given, along, None)
        if known is not None:
            return PointMotion(chosen.names, *known[::2]), PointMotion(chosen.names, *known[1::2])
        values, tangents = self._frames_along(given, along, accelerations, None, chosen.names)
        frames, moved = chosen.carriers(values, False), chosen.carriers(tangents, True)
        r = chosen.places(given[2])
        found = points_on(frames, r, chosen.names)
        dr = chosen.moved_places(given[2], along[2], values.rotation.ndim - 3)
        found_along = point_tangents(frames, moved, r, dr, chosen.names)
        return (alone(found), alone(found_along)) if chosen.single else (found, found_along)

    def point_jacobians(self, q: Numbers, p: Numbers, inputs: Numbers, t: Times, points: Points) -> Array:
        """See `Solver.point_jacobians`."""
        chosen = self._chosen(points)
        known = self.package._calls[chosen.by_speeds](*self._at_rest_by_speeds(q, p, inputs, t), None)
        if known is not None:
            dframes, dvelocity = known
            return _columns(dframes.take(chosen.at, axis=-2)[..., 12:15], dvelocity)
        at = self._at_rest_by_speeds(q, p, inputs, t)
        values, tangents = self._frames_along(*at, False, None, chosen.names)
        frames, along = chosen.carriers(values, False), chosen.carriers(tangents, True)
        moved = point_tangents(frames, along, chosen.places(p), 0.0, chosen.names)
        found = _columns(along.angular_velocity, moved.velocity)
        return found[..., 0, :, :] if chosen.single else found

    # -- selections and calls ------------------------------------------------------------------------------------------

    def _moving(self, given: tuple[Any, ...]) -> tuple[Any, ...]:
        """Arguments of a state, with zero speeds if none are given."""
        return given if given[1] is not None else (given[0], self._speed_units[0], *given[2:])

    def _bodies(self, bodies: Bodies) -> tuple[Any, tuple[str, ...]]:
        """Indices of the selected bodies (a number if `bodies` is a single name), and the names of these bodies."""
        known = self._known_bodies("frames")
        if bodies is None:
            return None, known
        if isinstance(bodies, str):
            return _place(bodies, known, "bodies"), (bodies,)
        names = tuple(_several(bodies, "bodies"))
        return [_place(n, known, "bodies") for n in names], names

    def _chosen(self, points: Points) -> _Chosen:
        """The selected points; the selection is stored, because loops in a user's program repeat it."""
        key = tuple(points) if isinstance(points, list) else points
        try:
            found = self._chosen_before.get(key)
        except TypeError:  # places in this selection are lists or arrays
            key = _as_tuples(points)
            try:
                found = self._chosen_before.get(key)
            except TypeError:
                return _Chosen(self, points)
        if found is None:
            found = _Chosen(self, points)
            if len(self._chosen_before) < MOST_CHOICES:
                found.prepare()
                self._chosen_before[key] = found
        return found

    @functools.cached_property
    def _chosen_before(self) -> dict[Any, _Chosen]:
        return {}

    def _known_bodies(self, member: str) -> tuple[str, ...]:
        """Names of the model's bodies.

        Raises
        ------
        AttributeError
            If the package was generated without frames.
        """
        found = self._body_names
        if found is None:
            raise AttributeError(self._why_not(member))
        return found

    @functools.cached_property
    def _body_names(self) -> tuple[str, ...] | None:
        """Names of the model's bodies; None in a package without frames."""
        return tuple(self._manifest["bodies"]) if "bodies" in self._manifest else None

    def _frames(self, given: tuple[Any, ...], accelerations: bool, bodies: Any, names: tuple[str, ...]) -> FrameMotion:
        found = self._call("frames", given)[0]
        a = self._call("frame_accelerations", given)[0] if accelerations else None
        return frames_from(found, a, bodies, names)

    def _frames_along(
        self,
        given: tuple[Any, ...],
        along: tuple[Any, ...],
        accelerations: bool,
        bodies: Any,
        names: tuple[str, ...],
    ) -> tuple[FrameMotion, FrameMotion]:
        found = self._call("frame_sensitivities", given, along)
        a = self._call("frame_acceleration_sensitivities", given, along) if accelerations else (None, None)
        return frames_from(found[0], a[0], bodies, names), frames_from(found[1], a[1], bodies, names)

    def _at_rest_by_speeds(self, q: Numbers, p: Numbers, inputs: Numbers, t: Times) -> tuple[Any, Any]:
        """A state at rest, and unit seeds of all speeds."""
        rest, units = self._speed_units
        return (q, rest, p, inputs, t), (None, units, None, None, None)

    @functools.cached_property
    def _speed_units(self) -> tuple[Array, Array]:
        """Zero speeds, and unit vectors of all speeds."""
        return np.zeros(self.nu), np.eye(self.nu)


NOTHING = Wanted("", ())
"""A call for a function that the package lacks."""


class _Chosen:
    """A selection of points in bodies.

    Attributes
    ----------
    on : array of int
        Index of the body of each point; the ground comes after the last body.
    ground : bool
        Whether a point belongs to the ground.
    given : array (n, 3)
        Places in the bodies' frames, except where parameters move them.
    names : tuple of str
    single : bool
        Whether a single point was requested.
    moved : bool
        Whether parameters move some of the points in their bodies.
    at : int or array of int
        Same as `on`, or a single index.
    values, along : tuple of Wanted
        Single calls of C for the motion of the points, without and with accelerations; `NOTHING` for a selection that is not
        stored, or if the package lacks the functions.
    by_speeds : Wanted
        A call for derivatives of body frames and of point velocities; `NOTHING` also if a point belongs to the ground.
    """

    values = along = (NOTHING, NOTHING)
    by_speeds = NOTHING

    def __init__(self, solver: Frames, points: Points):
        self.solver = solver
        known = solver._known_bodies("points")
        self.made: list[dict[str, Any]] = solver._manifest.get("points", [])
        names = [point["name"] for point in self.made]
        self.single = isinstance(points, str) or _is_pair(points)
        asked = names if points is None else [points] if self.single else _several(points, "points")
        self.of_model: list[int] = []
        carriers: list[int] = []
        places: list[Any] = []
        called: list[str] = []
        for point in asked:
            number, at = -1, np.zeros(3)
            if isinstance(point, str) and point in names:
                number = names.index(point)
                body, at = self.made[number]["body"], self.made[number]["at"]
            elif isinstance(point, str):
                if point not in (*known, "ground"):
                    _place(point, [*names, *known], "points")
                body = known.index(point) if point in known else -1
            elif _is_pair(point):
                body = -1 if point[0] == "ground" else _place(point[0], known, "points")
                at = _vector(solver, point)
            else:
                raise ValueError(
                    f"points: {point!r} is not a point; expected the name of a point or a body, or a pair such as "
                    f"({known[0]!r}, [0, 0, 0.1])"
                )
            carriers.append(body)
            places.append(at)
            self.of_model.append(number)
            called.append(point if isinstance(point, str) else f"{point[0]} {[float(e) for e in at]}")
        self.names = tuple(called)
        self.on = np.array([b if b >= 0 else len(known) for b in carriers], int)
        self.at = int(self.on[0]) if self.single else self.on
        self.ground = -1 in carriers
        self.given = np.array(places, dtype=solver._arguments.dtype).reshape(-1, 3)
        self.moved = max(self.of_model, default=-1) >= 0 and "point_places" in solver._functions

    def prepare(self) -> None:
        """Prepares direct calls of C for the selected points."""
        functions, places = self.solver._functions, self.solver._shapes["point_places"]
        table = np.empty((len(self.on), 5))
        table[:, 0], table[:, 2:] = self.on, self.given
        table[:, 1] = self.of_model if self.moved else -1
        numbers = np.concatenate([[len(self.on)], table.reshape(-1)])
        shape = (3,) if self.single else (len(self.on), 3)

        def wanted(frames: str, accelerations: str) -> tuple[Wanted, Wanted]:
            """Two calls: for the motion of the points without and with accelerations."""
            of_frames, of_accelerations = functions.get(frames), functions.get(accelerations)
            if of_frames is None:
                return NOTHING, NOTHING
            n = 2 if of_frames.seeds else 1
            f = over_points(of_frames, None, places, shape)
            found = Wanted(frames, f.results[2 * n : 4 * n], f, numbers)
            if of_accelerations is None:
                return found, NOTHING
            f = over_points(of_frames, of_accelerations, places, shape)
            return found, Wanted(frames, f.results[2 * n : 5 * n], f, numbers)

        self.values = wanted("frames", "frame_accelerations")
        self.along = wanted("frame_sensitivities", "frame_acceleration_sensitivities")
        if self.along[0] is not NOTHING and not self.ground:
            self.by_speeds = Wanted("frame_sensitivities", ("dframes", "dvelocity"), self.along[0].function, numbers)

    def carriers(self, frames: FrameMotion, tangents: bool) -> FrameMotion:
        """The frames of the points' bodies, one per point."""
        return frames.of(self.on, self.ground, tangents)

    def places(self, p: Numbers) -> Array:
        """Places of all selected points in the frames of their bodies, (..., n, 3)."""
        if not self.moved:
            return self.given
        found = self.solver._call("point_places", (None, None, p, None, 0.0))[0]
        return self._from(found, self.given)

    def moved_places(self, p: Numbers, dp: Numbers, axes: int) -> Array | float:
        """Derivatives of the places, (k, ..., n, 3), for `axes` batch axes; 0.0 if no place moves."""
        if not self.moved or dp is None:
            return 0.0
        found = self.solver._call(
            "point_place_sensitivities", (None, None, p, None, 0.0), (None, None, dp, None, None)
        )[1]
        k, *states = found.shape[:-2]
        found = found.reshape(k, *[1] * (axes - len(states)), *states, *found.shape[-2:])
        return self._from(found, np.zeros_like(self.given))

    def _from(self, found: Array, others: Array) -> Array:
        """Places (..., npoints, 3) of all selected points: `found` for points of the model, `others` for points given
        by place."""
        parts = [
            found[..., n, :] if n >= 0 else np.broadcast_to(others[i], found[..., 0, :].shape)
            for i, n in enumerate(self.of_model)
        ]
        return np.stack(parts, axis=-2)


def _several(given: Any, what: str) -> list[Any]:
    """A single name or a list of names, as a list."""
    try:
        return list(given)
    except TypeError:
        raise ValueError(f"{what} is {given!r}, expected a name or a list of names") from None


def _as_tuples(given: Any) -> Any:
    """Lists and arrays as nested tuples, which are hashable; anything else is unchanged."""
    if isinstance(given, np.ndarray):
        given = given.tolist()
    return tuple(map(_as_tuples, given)) if isinstance(given, (list, tuple)) else given


def _is_pair(point: Any) -> bool:
    """Whether `point` is a body with a place, and not a pair of names."""
    return (
        isinstance(point, (tuple, list))
        and len(point) == 2
        and isinstance(point[0], str)
        and not isinstance(point[1], str)
        and not _is_pair(point[1])
    )


def _vector(solver: Frames, point: Any) -> Array:
    """The position in a pair (body, position), checked."""
    name = f"points: the place in {point[0]!r}"
    found = solver._arguments._numbers(name, point[1])
    if found.shape != (3,):
        raise ValueError(f"{name} has shape {found.shape}, expected (3,): x, y, z in the body's frame, m")
    if not np.isfinite(found.astype(float)).all():
        raise ValueError(f"{name} is {found}, expected finite numbers")
    return found


def _place(name: Any, known: Sequence[str], what: str) -> int:
    """Index of a name among the known names."""
    if name in known:
        return known.index(name)
    raise unknown(what, name, known)


def _columns(angular: Array, linear: Array) -> Array:
    """Jacobians (..., n, 6, nu) from derivatives with respect to each speed (nu, ..., n, 3)."""
    return _last(np.concatenate([angular, linear], axis=-1))


def _last(x: Array) -> Array:
    """An array with its first axis moved to the end."""
    return x.transpose(*range(1, x.ndim), 0)
