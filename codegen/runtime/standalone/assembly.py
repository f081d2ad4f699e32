"""Assembly: the loops of one state closed from a guess; where that does not lead there, from others."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Indices, normalise
from .closing_together import solve_together
from .errors import AssemblyError, SingularLoopError
from .newton import Newton, Part
from .targets import Opened
from .warning import warn

STEPS_OFF = (0.02, -0.02, 0.1, -0.1, 0.5, -0.5)
"""rad or m: how far dependent coordinates are moved off a guess at which a loop has lost rank, one after the other."""

GUESSES = 16
"""Guesses for dependent coordinates that are tried where the given one leads to no closed state, further and further off."""

FURTHEST = 3.0
"""rad or m: how far off the last of them is."""

SEVERAL = 200
"""Dependent coordinates; with more of them no other guesses are tried, they would cost too much."""

CLOSED = 1e-10
"""The largest scaled residual of a closed loop; Newton's method goes on below it as long as it gets better."""

ROUNDING = 1e-14
"""A scaled residual that Newton's method would not mend: assembly leaves such a state as it is."""

ALLOWED = 10.0
"""Tolerances of the model that a dropped condition may be open by, and by which a unit of a parameter may open it, untold."""


def allowed_gaps(opened: Opened) -> Array:
    """By how much conditions that were dropped, since they follow from others nearly, may be open; zero for the others."""
    allowed = np.zeros(len(opened.manifest["closure_names"]))
    allowed[opened.manifest.get("dropped", [])] = ALLOWED * opened.manifest.get("loop_tolerance", 0.0)
    return allowed


def _named(state: Sequence[int]) -> str:
    """Which state of a batch, for messages."""
    return f" (state {list(state)} of the batch)" if state else ""


class Assembly:
    """Closes the loops of a partition."""

    def __init__(self, opened: Opened):
        manifest = opened.manifest
        self.names: list[str] = manifest["closure_names"]
        self.allowed = allowed_gaps(opened)
        self.kept = np.setdiff1d(np.arange(len(self.names)), manifest.get("dropped", []))
        self.newton = Newton(opened, self.kept)
        self.couplings = frozenset(manifest.get("couplings", ()))
        self.loops = [self.names[k].rpartition(".")[0] for k in self.kept]  # of each condition that counts
        independent = set(manifest.get("independent_names", manifest["coordinate_names"]))
        self.dependent = np.array([i for i, n in enumerate(manifest["coordinate_names"]) if n not in independent], int)
        self.all = Part(slice(None), slice(None), set(self.loops))

    def close(self, q: Array, p: Array, state: tuple[int, ...]) -> Array:
        """Coordinates (nq,) of one state with its loops closed; `state` says which one of a batch it is.

        Raises
        ------
        AssemblyError, SingularLoopError
        """
        failure: AssemblyError | SingularLoopError
        try:
            return self._closed(q, p, state)
        except AssemblyError as error:
            failure = error
        except SingularLoopError as error:
            failure = error
            # no two of the numbers are the same, nor opposite: no symmetry that the guess may have is kept
            direction = np.sin(1.0 + np.arange(len(self.dependent)))
            for size in STEPS_OFF:
                trial = q.copy()
                trial[self.dependent] += size * direction
                normalise(trial, self.newton.quaternions)
                with contextlib.suppress(SingularLoopError, AssemblyError):
                    return self._closed(trial, p, state)
        found = self._from_elsewhere(q, p)
        if found is None:
            raise failure
        return self._closed(found, p, state)

    def close_together(self, q: Array, p: Array, states: tuple[Indices, ...], into: Array) -> NDArray[np.bool_]:
        """Close many states (n, nq) of a batch, and put those that Newton's method closes into their places; which these are.

        The others are left to `close`, which tries other guesses, and tells what is wrong.
        """
        found, gaps, flat = solve_together(self.newton, q, p)
        closed: NDArray[np.bool_] = np.logical_not(flat) & (np.abs(gaps).max(axis=1, initial=0.0) <= CLOSED)
        into[tuple(i[closed] for i in states)] = found[closed]
        if len(self.kept) < len(self.names) and closed.any():
            at = [i[closed] for i in states]
            open_by = self.newton.all_gaps(found[closed], p[closed])
            for n in np.flatnonzero(((self.allowed > 0) & (np.abs(open_by) > self.allowed)).any(axis=1)):
                self._warn_of_gaps(open_by[n], _named([int(i[n]) for i in at]))
        return closed

    def follow(self, q: Array, p: Array) -> Array:
        """What Newton's method makes of a guess that is near a closed state; no others are tried.

        Raises
        ------
        AssemblyError, SingularLoopError
        """
        return self._closed(q, p, ())

    def _closed(self, q: Array, p: Array, state: tuple[int, ...]) -> Array:
        """What Newton's method makes of a guess, as exact as it can be."""
        q, gaps = self.newton.solve(q, p, [self.all], 0.0)
        size = self.all.largest(gaps)
        where = _named(state)
        if not size <= CLOSED:
            raise self.open(int(np.argmax(np.abs(gaps))), size, where)
        if len(self.kept) < len(self.names):
            self._warn_of_gaps(self.newton.all_gaps(q, p), where)
        return q

    def open(self, condition: int, size: float, where: str) -> AssemblyError:
        """The error for so much that is left of a condition, by its number among those that count."""
        loop = self.loops[condition]
        return AssemblyError(loop, size, where, loop in self.couplings)

    def _warn_of_gaps(self, gaps: Array, where: str) -> None:
        """Conditions that were dropped since they follow from others nearly, and that are open by more than that."""
        excess = np.where(self.allowed > 0, np.abs(gaps) - self.allowed, 0.0)
        worst = int(np.argmax(excess))
        if excess[worst] > 0:
            warn(
                f"condition {self.names[worst]}, which was dropped since it follows from others but for the model's "
                f"tolerance, is open by {abs(gaps[worst]):.2g}{where}; the loop is not what it was taken for there"
            )

    def _from_elsewhere(self, q: Array, p: Array) -> Array | None:
        """A closed state with the independent coordinates of a guess that leads to none; or None where none is found.

        Loops that share no dependent coordinates are closed apart: one that does not close holds up no other.
        """
        if len(self.dependent) > SEVERAL:
            return None
        rng = np.random.default_rng(0)  # the same guess leads to the same state
        left, closed = self._parts(q, p), q.copy()
        for n in range(GUESSES + 1):
            trial = closed.copy()
            for part in left:
                guess = q[part.coordinates]
                trial[part.coordinates] = guess + FURTHEST * n / GUESSES * rng.uniform(-1.0, 1.0, guess.size)
            normalise(trial, self.newton.quaternions)
            trial, gaps = self.newton.solve(trial, p, left, CLOSED, rng)
            done = [part for part in left if part.largest(gaps) <= CLOSED]
            for part in done:
                closed[part.coordinates] = trial[part.coordinates]
            left = [part for part in left if part not in done]
            if not left:
                return closed
        return None

    def _parts(self, q: Array, p: Array) -> list[Part]:
        """Loops in sets that share no dependent coordinates, as is seen from what each coordinate changes."""
        n = len(self.dependent)
        moved = np.tile(q, (n + 1, 1))
        moved[:, self.dependent] += 0.1 * np.sin(1.0 + np.arange(n))  # off guesses that are special
        moved[1:, self.dependent] += 0.3 * np.eye(n)
        normalise(moved, self.newton.quaternions)
        gaps = self.newton.gaps(moved, np.tile(p, (n + 1, 1)))
        concerned = np.abs(gaps[1:] - gaps[0]) > 1e-9 * (1.0 + np.abs(gaps[0]))
        parts: list[tuple[set[int], set[int]]] = []  # rows, and places among the dependent coordinates
        for name in dict.fromkeys(self.loops):
            rows = {k for k, loop in enumerate(self.loops) if loop == name}
            columns = {int(i) for i in np.flatnonzero(concerned[:, sorted(rows)].any(axis=1))}
            for i in self.newton.quaternions:  # as a whole
                whole = {k for k, c in enumerate(self.dependent) if i <= c < i + 4}
                columns |= whole if columns & whole else set()
            for other in [part for part in parts if columns & part[1]]:
                parts.remove(other)
                rows, columns = rows | other[0], columns | other[1]
            parts.append((rows, columns))
        return [
            Part(np.array(sorted(rows)), self.dependent[sorted(columns)], {self.loops[k] for k in rows})
            for rows, columns in parts
        ]
