"""Assembly: closes the loops from a guess, on the branch of that guess.

Newton's method closes a guess near a closed state directly. For any other guess, assembly first finds a closed state that
differs from it in the independent coordinates, the parameters or the time. Continuation then leads from that state to the guess
(`following`). If there is no such state, the loops are closed along the Newton path or from other guesses, with a warning.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices, normalise
from ..calls.targets import Opened
from ..errors import AssemblyError, SingularLoopError
from ..files.manifest import ALLOWED
from ..warning import warn
from .following import FIRST, Followed, Follower, Line
from .newton import CLOSED, SURE, Newton, Parts
from .starting import Starts

STEPS_OFF = (0.02, -0.02, 0.1, -0.1, 0.5, -0.5)
"""Offsets of the dependent coordinates, rad or m, tried in turn from a guess at which a loop has lost rank."""

GUESSES = 48
"""Number of other guesses for the dependent coordinates if the given guess leads to no closed state, at increasing distances
from the given guess."""

FURTHEST = 3.0
"""Distance between the given guess and the last of the `GUESSES`, rad or m."""

SEVERAL = 200
"""Largest number of dependent coordinates with which other guesses are tried; more would take too long."""

ROUNDING = 1e-14
"""Scaled residual of the size of rounding errors; a state with a smaller residual is not changed."""

ALIAS = 3.0
"""rad, or characteristic lengths: with a larger difference in independent coordinates, a closed state may be whole turns
away."""

FAR = 1.6
"""Change of a dependent angle, about a quarter turn, in rad, above which a warning reports it."""

HALF = 0.5
"""Upper bound of the first step between two states of a path, as a fraction of their distance."""


def allowed_gaps(opened: Opened) -> Array:
    """Tolerances for the residuals of conditions that were dropped as redundant within `loop_tolerance`; zero for the
    others."""
    allowed = np.zeros(len(opened.manifest["closure_names"]))
    allowed[opened.manifest.get("dropped", [])] = ALLOWED * opened.manifest.get("loop_tolerance", 0.0)
    return allowed


class Assembly:
    """Assembly of the loops for one choice of dependent coordinates."""

    def __init__(self, opened: Opened):
        manifest = opened.manifest
        self.coordinates: list[str] = manifest["coordinate_names"]
        self.names: list[str] = manifest["closure_names"]
        self.allowed = allowed_gaps(opened)
        self.kept = np.setdiff1d(np.arange(len(self.names)), manifest.get("dropped", []))
        self.newton = Newton(opened, self.kept)
        self.couplings = frozenset(manifest.get("couplings", ()))
        self.loops = [self.names[k].rpartition(".")[0] for k in self.kept]  # the loop of each retained condition
        self.all_loops: list[str] = manifest["loops"]
        independent = set(manifest.get("independent_names", self.coordinates))
        self.dependent = np.array([i for i, n in enumerate(self.coordinates) if n not in independent], int)
        own = self._followed_coordinates(opened, independent)
        shared = np.array([i for i, n in enumerate(self.coordinates) if n in independent and i not in own], int)
        self.follower = Follower(self.newton, own, shared)
        self.timed = bool(manifest["prescribed_names"])
        self.starts = Starts(self.newton, self.follower, self.timed)
        self.whole = Parts(np.zeros(len(self.kept), int), np.zeros(len(self.coordinates), int))
        # the package's initial state is closed at the default parameters, inputs of zero and t = 0
        package = opened.package
        self._initial = np.array(package["initial"]["q"], float)
        rest = [0.0] * (len(package["input_names"]) + 1) if self.timed else []
        self._x = np.array([*package["parameters"], *rest], float)
        initial: list[float] = self._initial.tolist()
        self._others = [(i, initial[i]) for i in self.follower.others.tolist()]
        self._independents = [
            (i, initial[i], ALIAS * float(self.newton.scale[i])) for i in self.follower.independent.tolist()
        ]
        self._parts: Parts | None = None
        self.placing = (*package["parameter_names"], *((*package["input_names"], "t") if self.timed else ()))

    def _followed_coordinates(self, opened: Opened, independent: set[str]) -> Indices:
        """Indices of the independent coordinates, without those of joints that also have dependent speeds."""
        speeds = opened.manifest["speed_names"]
        moved = {speeds[s] for c in opened.manifest.get("closures", ()) for s in c["dependent"]}
        shared = {name.rpartition(".")[0] for name in moved if name not in self.coordinates}
        return np.array(
            [i for i, n in enumerate(self.coordinates) if n in independent and n.rpartition(".")[0] not in shared], int
        )

    # -- states --------------------------------------------------------------------------------------------------------

    def _of_initial(self, q: Array) -> NDArray[np.bool_]:
        """Whether guesses (..., nq) have the dependent coordinates of the initial state."""
        others = self.follower.others
        return (q[..., others] == self._initial[others]).all(axis=-1)

    def is_turned(self, q: Array, x: Array) -> NDArray[np.bool_]:
        """Whether guesses (..., nq) differ from the initial state only in independent coordinates (or the time), perhaps by
        whole turns.

        Such a guess may close the loops without being on the initial state's branch.
        """
        others = self.follower.others
        if q.ndim == 1 and len(others) and q[others[0]] != self._initial[others[0]]:
            return np.zeros((), bool)
        found = self._of_initial(q)
        if found.any():
            i = self.follower.independent
            far = (np.abs(q[..., i] - self._initial[i]) > ALIAS * self.newton.scale[i]).any(axis=-1)
            if self.timed:
                far |= (x[..., self.newton.np :] != self._x[self.newton.np :]).any(axis=-1)
            found &= far
        return found

    def may_be_turned(self, q: Array) -> bool:
        """Faster version of `is_turned` for one state (nq,). The result is true too often with prescribed motion,
        because the time is ignored."""
        numbers = q.tolist()
        for i, initial in self._others:
            if numbers[i] != initial:
                return False
        return self.timed or any(abs(numbers[i] - initial) > far for i, initial, far in self._independents)

    def close(self, q: Array, x: Array, called: Sequence[tuple[int, ...]]) -> Array:
        """Closes the loops of n guesses; returns their coordinates (n, nq). `called` are the indices of the guesses in
        the batch.

        Raises
        ------
        AssemblyError, SingularLoopError
        """
        of_initial, tried = self._of_initial(q), np.logical_not(self.is_turned(q, x))
        found, near, first = q.copy(), np.zeros(len(q), bool), np.zeros(len(q))
        if len(q) == 1 and tried[0]:
            alone, first[0] = self.newton.single(q[0], x[0])
            if alone is not None:
                found[0], near[0] = alone, True
        elif tried.any():
            found[tried], near[tried], first[tried] = self.newton.quick(q[tried], x[tried])
        sure = near & (first <= SURE)
        if not sure.all():
            far = np.flatnonzero(~sure)
            names = [_named(called[int(n)]) for n in far]
            beside = np.where(near[far, None], found[far], np.nan)
            found[far] = self._from_afar(q[far], x[far], of_initial[far], beside, names)
        return self._checked(found, x, called)

    def continued(self, q: Array, x: Array, called: Sequence[Sequence[tuple[int, ...]]]) -> Array:
        """Closed states (m, n, nq) along m paths: each state is continued from the state before it; the first is closed
        from its guess."""
        found = np.empty_like(q)
        found[:, 0] = self.close(q[:, 0], x[:, 0], [row[0] for row in called])
        for k in range(1, q.shape[1]):
            line = self._line(found[:, k - 1], x[:, k - 1], q[:, k], x[:, k])
            names = [_named(row[k]) for row in called]
            way = self._followed(found[:, k - 1], line, q[:, k], names, HALF)
            for n in np.flatnonzero(way.s < 1.0):
                raise self._ended(int(n), way, line, names[n])
            found[:, k] = self._checked(way.q, x[:, k], [row[k] for row in called])
        return found

    def follow(self, q: Array, x: Array) -> Array:
        """The closed state (nq,) near a guess on the same branch, by Newton's method alone.

        Raises
        ------
        AssemblyError, SingularLoopError
        """
        found, first = self.newton.single(q, x)
        if found is None or first > SURE:
            raise self._open(q, x, "")
        return self._checked(found[None], x[None], [()])[0]

    # -- guesses far from closed states --------------------------------------------------------------------------------

    def _from_afar(self, q: Array, x: Array, of_initial: NDArray[np.bool_], beside: Array, names: list[str]) -> Array:
        """Closes guesses (n, nq) that are not near a closed state. `beside` contains a closed state in the vicinity of each
        guess, or NaN."""
        found, left = q.copy(), np.ones(len(q), bool)
        n = np.flatnonzero(of_initial)
        if n.size:
            initial = np.tile(self._initial, (n.size, 1)), np.tile(self._x, (n.size, 1))
            found[n], left[n] = self._from(initial, q[n], x[n], [names[i] for i in n])
        n = np.flatnonzero(left)
        if n.size:
            first, x_first, closed = self.starts.find(q[n], x[n], self.parts(q[0], x[0]))
            if closed.any():
                n, start = n[closed], (first[closed], x_first[closed])
                found[n], left[n] = self._from(start, q[n], x[n], [names[i] for i in n])
        for k in np.flatnonzero(left):
            near = not np.isnan(beside[k, 0])
            found[k] = beside[k] if near else self._along_newton_path(q[k], x[k], names[k])
        return found

    def _from(
        self, start: tuple[Array, Array], q: Array, x: Array, names: list[str]
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Continues closed states to guesses (n, nq). Also returns which states did not arrive, because of lost rank or
        too great a distance.

        Raises
        ------
        AssemblyError
            If a branch ends on the way.
        """
        line = self._line(*start, q, x)
        way = self._followed(start[0], line, q, names)
        for k in np.flatnonzero(way.ended):
            raise self._ended(int(k), way, line, names[k])
        return way.q, way.s < 1.0

    def _line(self, q0: Array, x0: Array, q1: Array, x1: Array) -> Line:
        """Straight lines from closed states (q0, x0) to guesses (q1, x1)."""
        i = self.follower.independent
        last = q1.copy()
        for k in self.newton.quaternions:  # the quaternions e and -e are the same rotation: take the nearer one
            last[:, k : k + 4] *= np.where((q0 * q1)[:, k : k + 4].sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
        return Line(q0[:, i], last[:, i], x0, x1, last)

    def _followed(self, first: Array, line: Line, wanted: Array, names: Sequence[str], part: float = FIRST) -> Followed:
        """Continues closed states along lines; states that reach the end of their line are closed to rounding."""
        way = self.follower.follow(first, line, part)
        n, i = np.flatnonzero(way.s == 1.0), self.follower.independent
        if n.size:
            way.q[np.ix_(n, i)] = wanted[np.ix_(n, i)]
            way.q[n] = self.newton.path(way.q[n], line.x1[n], self.whole)[0]
        crossed = np.flatnonzero((way.s == 1.0) & (way.crossed >= 0))
        if crossed.size:
            n = crossed[0]
            more = f", and those of {len(crossed) - 1} more" if len(crossed) > 1 else ""
            warn(
                f"loop {self.all_loops[way.crossed[n]]} loses rank on the way to the guess{names[n]}{more}: branches meet there, "
                f"and assembly continued in the same direction. To choose the branch, give dependent coordinates beyond that pose"
            )
        return way

    def _along_newton_path(self, q: Array, x: Array, name: str) -> Array:
        """Closes a guess (nq,) along the Newton path, or from guesses increasingly far from it.

        Raises
        ------
        AssemblyError, SingularLoopError
        """
        parts = self.parts(q, x)
        found, gaps, flat = self.newton.path(q[None], x[None], parts)
        if not flat[0] and parts.open_by(gaps).max() <= CLOSED:
            self._warn_of_moves(q, found[0], name)
            return np.asarray(found[0])
        trials = q + (np.array(STEPS_OFF) if flat[0] else np.zeros(0))[:, None] * self._off()
        if len(trials):
            normalise(trials, self.newton.quaternions)
            found, gaps, flat_there = self.newton.path(trials, np.tile(x, (len(trials), 1)), parts)
            closed = np.flatnonzero(~flat_there & (parts.open_by(gaps).max(axis=1) <= CLOSED))
            if closed.size:
                return np.asarray(found[closed[0]])
        elsewhere = self._from_elsewhere(q, x, parts)
        if elsewhere is None:
            raise self._open(q, x, name)
        warn(
            f"the loops do not close from the guess{name}; they were closed from other values of dependent coordinates, "
            f"perhaps on another branch than the guess. Check the result, or give a guess nearer to a closed state"
        )
        return elsewhere

    def _off(self) -> Array:
        """A direction in which to leave a guess; its entries differ in magnitude, so that it has no symmetry of the
        guess."""
        direction = np.zeros(len(self.coordinates))
        others = self.follower.others
        direction[others] = np.sin(1.0 + np.arange(len(others)))
        return direction

    def _from_elsewhere(self, q: Array, x: Array, parts: Parts) -> Array | None:
        """A closed state with the guess's independent coordinates, from random dependent coordinates; None if none is found.

        Loops that share no dependent coordinates are closed separately, so a loop that fails does not affect the others.
        """
        others = self.follower.others
        if len(others) > SEVERAL:
            return None
        rng = np.random.default_rng(0)  # fixed seed: the same guess leads to the same state
        trials = np.tile(q, (GUESSES + 1, 1))
        far = FURTHEST * np.arange(GUESSES + 1)[:, None] / GUESSES
        trials[:, others] += far * rng.uniform(-1.0, 1.0, (GUESSES + 1, len(others))) * self.newton.scale[others]
        normalise(trials, self.newton.quaternions)
        found, gaps, _ = self.newton.path(trials, np.tile(x, (len(trials), 1)), parts)
        closed = parts.open_by(gaps) <= CLOSED
        if not closed.any(axis=0).all():
            return None
        first = closed.argmax(axis=0)
        together = np.where(np.isin(np.arange(len(q)), others), found[first[parts.coordinates], np.arange(len(q))], q)
        closed_q, gaps, flat = self.newton.path(together[None], x[None], parts)
        return None if flat[0] or parts.open_by(gaps).max() > CLOSED else np.asarray(closed_q[0])

    def parts(self, q: Array, x: Array) -> Parts:
        """Groups of loops that share no dependent coordinates, found from changes of the residuals near a state."""
        if self._parts is None:
            self._parts = self._found_parts(q, x)
        return self._parts

    def _found_parts(self, q: Array, x: Array) -> Parts:
        others = self.follower.others
        n = len(others)
        moved = np.tile(q, (n + 1, 1))
        moved[:, others] += 0.1 * np.sin(1.0 + np.arange(n))  # leaves special configurations, such as symmetric ones
        moved[1:, others] += 0.3 * np.eye(n)
        normalise(moved, self.newton.quaternions)
        gaps = self.newton.gaps(moved, np.tile(x, (n + 1, 1)))
        concerned = np.abs(gaps[1:] - gaps[0]) > 1e-9 * (1.0 + np.abs(gaps[0]))
        sets: list[tuple[set[int], set[int]]] = []  # conditions, and positions of coordinates in `others`
        for name in dict.fromkeys(self.loops):
            rows = {k for k, loop in enumerate(self.loops) if loop == name}
            columns = {int(i) for i in np.flatnonzero(concerned[:, sorted(rows)].any(axis=1))}
            for i in self.newton.quaternions:  # a quaternion belongs to one group
                whole = {k for k, c in enumerate(others) if i <= c < i + 4}
                columns |= whole if columns & whole else set()
            for other in [part for part in sets if columns & part[1]]:
                sets.remove(other)
                rows, columns = rows | other[0], columns | other[1]
            sets.append((rows, columns))
        of_rows, of_coordinates = np.zeros(len(self.loops), int), np.zeros(len(q), int)
        for k, (rows, columns) in enumerate(sets):
            of_rows[sorted(rows)] = k
            of_coordinates[others[sorted(columns)]] = k
        return Parts(of_rows, of_coordinates)

    # -- warnings and errors ---------------------------------------------------------------------------------------------

    def _checked(self, q: Array, x: Array, called: Sequence[tuple[int, ...]]) -> Array:
        """Returns the closed states (n, nq) and warns where dropped or redundant conditions remain open."""
        if len(self.kept) < len(self.names) or self.newton.slack is not None:
            gaps = np.abs(self.newton.all_gaps(q, x))
            self._warn_of_redundant(gaps[:, self.kept], called)
            for n in np.flatnonzero(((self.allowed > 0) & (gaps > self.allowed)).any(axis=1)):
                worst = int(np.argmax(np.where(self.allowed > 0, gaps[n] - self.allowed, 0.0)))
                warn(
                    f"condition {self.names[worst]}, which was dropped as redundant within the model's "
                    f"tolerance, is open by {gaps[n, worst]:.2g}{_named(called[int(n)])}; "
                    f"there, the generated equations do not describe the mechanism"
                )
        return q

    def _warn_of_moves(self, guess: Array, q: Array, name: str) -> None:
        """Warns of dependent coordinates that have moved far from the guess, perhaps to another branch."""
        others = self.follower.others
        moved = np.where(self.newton.slides, 0.0, np.abs(q - guess) / self.newton.scale)[others]
        worst = int(np.argmax(moved)) if len(moved) else 0
        if moved.max(initial=0.0) > FAR:
            i = others[worst]
            warn(
                f"closing the loops changed {self.coordinates[i]} from {guess[i]:.4g} to {q[i]:.4g}{name}: the guess is "
                f"far from a closed state, and the result may be on another branch. Give a guess nearer to the desired state"
            )

    def _ended(self, n: int, way: Followed, line: Line, name: str) -> AssemblyError:
        """The error for a branch that ends on the way to a guess: the state reached, and the loop."""
        loop = self.all_loops[int(np.argmin(way.rank[n]))]
        first, last = (np.concatenate(ends) for ends in ((line.q0[n], line.x0[n]), (line.q1[n], line.x1[n])))
        names = [*(self.coordinates[i] for i in self.follower.independent), *self.placing]
        change = np.abs(last - first)
        moving = [int(i) for i in np.argsort(-change, kind="stable")[:3] if change[i] > 0.0]
        began, came, wanted = (
            ", ".join(f"{names[i]} = {first[i] + s * (last[i] - first[i]):.6g}" for i in moving)
            for s in (0.0, way.s[n], 1.0)
        )
        q, x = self.follower.placed(way.q[n : n + 1], line.of(np.array([n])), np.ones(1))
        size = float(np.abs(self.newton.gaps(q, x)).max(initial=0.0))
        if not way.ended[n]:
            why = f"{wanted} is too far from {began}, or that state is singular; give intermediate states"
            return AssemblyError(loop, size, name, loop in self.couplings, why)
        why = (
            f"its residual is {size:.3g} at {wanted}. Followed from the closed state at {began}, its branch ends at "
            f"{came}, at a dead point or at the end of its reach: stay before that pose, take another path, or give "
            f"dependent coordinates on another branch"
        )
        return AssemblyError(loop, size, name, loop in self.couplings, why)

    def _open(self, q: Array, x: Array, name: str) -> AssemblyError | SingularLoopError:
        """The error for a guess (nq,) from which the loops do not close."""
        _, gaps, flat = self.newton.path(q[None], x[None], self.whole)
        if flat[0]:
            opened = self.newton.opened
            try:
                opened.target.compute(opened.functions["newton_step"], self.newton.named(q, x), ())
            except SingularLoopError as error:
                return error
        return self.open(int(np.argmax(np.abs(gaps[0]))), float(np.abs(gaps).max(initial=0.0)), name)

    def open(self, condition: int, size: float, where: str) -> AssemblyError:
        """The error for the residual of a condition; `condition` is the index among the retained conditions."""
        loop = self.loops[condition]
        tolerance = 0.0
        if self.newton.slack is not None and self.newton.slack[condition] > 0.0:
            tolerance = float(self.newton.slack[condition])
        return AssemblyError(loop, size, where, loop in self.couplings, tolerance=tolerance)

    def _warn_of_redundant(self, gaps: Array, called: Sequence[tuple[int, ...]]) -> None:
        """Warns of retained conditions (n, m) that stay open: at these parameters, these conditions are redundant only
        within `loop_tolerance`."""
        if self.newton.slack is None:
            return
        for n in np.flatnonzero((gaps > CLOSED).any(axis=1)):
            worst = int(np.argmax(gaps[n]))
            warn(
                f"redundant condition {self.names[self.kept[worst]]} stays open by {gaps[n, worst]:.2g}"
                f"{_named(called[int(n)])}: with these parameters the loop's conditions are only nearly redundant, "
                f"within loop_tolerance; results belong to the nearest closed loop. Generate with these parameters to drop it"
            )


def _named(state: Sequence[int]) -> str:
    """The index of a state in a batch as text, for messages."""
    return f" (state {list(state)} of the batch)" if state else ""
