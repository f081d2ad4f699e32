"""Many motions on several threads: the integrators are compiled code, so threads run in parallel."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..html_tables import html_of
from ..runtime.standalone.arrays import Array, Numbers
from ..runtime.standalone.calls.threads import one_thread, processors
from ..runtime.standalone.errors import SimulationError
from ..runtime.standalone.trajectory.trajectory import Trajectory
from ..terminal import with_status
from .failures import FAILURES
from .given_solver import check_given


@dataclass(slots=True, eq=False)
class Motions(Sequence[Trajectory | None]):
    """Trajectories of a batch of motions; ``motions["tip_x"]`` is a series of all of them.

    Attributes
    ----------
    trajectories : list of (Trajectory or None)
        One for each motion. For a motion that ended early, the part up to its end; None if it could not begin, or was
        not begun.
    failures : dict of int to Exception
        Errors by the index of the motion, from 0.
    """

    trajectories: list[Trajectory | None]
    failures: dict[int, Exception]

    def __len__(self) -> int:
        return len(self.trajectories)

    def __iter__(self) -> Iterator[Trajectory | None]:
        return iter(self.trajectories)

    def __getitem__(self, key: Any) -> Any:
        """The i-th trajectory; for a slice, several of them; for a name, its series in all motions, see `series`."""
        return self.series(key) if isinstance(key, str) else self.trajectories[key]

    @property
    def succeeded(self) -> Any:
        """Whether each motion reached its end, array of bool (n,)."""
        return np.array([x is not None and i not in self.failures for i, x in enumerate(self.trajectories)], bool)

    def series(self, name: str) -> Array:
        """Return a series of all motions.

        Parameters
        ----------
        name : str
            Name of a series of `Trajectory`.

        Returns
        -------
        ndarray (n, nt)
            Its values; NaN after the end of a motion that failed.

        Raises
        ------
        ValueError
            If the motions were run without given times.

        Examples
        --------
        >>> motions = ordernm.simulate_many(solver, np.linspace(0.0, 1.0, 11), p={"length_1": [0.8, 1.0, 1.2]})
        >>> motions.series("tip_x").shape
        (3, 11)
        """
        return self._together(lambda x: x[name])

    def derivative(self, name: str, by: str) -> Array:
        """Return the derivative of a series in all motions.

        Parameters
        ----------
        name : str
            Name of a series of `Trajectory`.
        by : str
            One of the sensitivities.

        Returns
        -------
        ndarray (n, nt)
            Its values; NaN after the end of a motion that failed.

        Examples
        --------
        >>> motions = ordernm.simulate_many(
        ...     solver, np.linspace(0.0, 1.0, 11), p={"length_1": [0.8, 1.0, 1.2]}, sensitivities="mass_1"
        ... )
        >>> motions.derivative("tip_x", "mass_1").shape
        (3, 11)
        """
        return self._together(lambda x: x.derivative(name, by))

    def _together(self, of: Callable[[Trajectory], Array]) -> Array:
        done = {len(x) for x, well in zip(self.trajectories, self.succeeded, strict=True) if well and x is not None}
        if len(done) > 1:
            raise ValueError(
                f"the motions have between {min(done)} and {max(done)} times; simulate them at given times, (nt,), or read each "
                f"of `trajectories`"
            )
        parts = [None if x is None else of(x) for x in self.trajectories]
        nt = max([*done, *(len(x) for x in parts if x is not None)], default=0)
        found = np.full((len(parts), nt), np.nan)
        for row, part in zip(found, parts, strict=True):
            if part is not None:
                row[: len(part)] = part
        return found

    def __repr__(self) -> str:
        lines = [f"{len(self)} motions, {len(self.failures)} failed"]
        lines += [f"  {i}: {error}" for i, error in list(self.failures.items())[:5]]
        if len(self.failures) > 5:
            lines.append(f"  and {len(self.failures) - 5} more")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        ends = [self.failures.get(i) or ("" if x is None else x.ended) for i, x in enumerate(self.trajectories)]
        counts = [None if x is None else len(x) for x in self.trajectories]
        rows = ((f"{i}", str(end), n) for i, (end, n) in enumerate(zip(ends, counts, strict=True)))
        return html_of(repr(self).splitlines()[:1], ("motion", "ended", "results"), rows)


@with_status("simulating motions")
def simulate_many(
    solver: Any, t: Any, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Any = None, *,
    threads: int | None = None, progress: Callable[[int, int], None] | None = None, **options: Any,
) -> Motions:  # fmt: skip
    """Simulate a batch of motions on several threads.

    Parameters
    ----------
    solver : Solver
        The model.
    t : float or array_like (nt,)
        Times as in `Solver.simulate`, the same for all motions.
    q, u, p : array_like (n, ...) or (...), or mapping, optional
        Initial states and parameters. Each of n rows belongs to one motion; all other values are the same for all
        motions. Values of a mapping are numbers or (n,).
    inputs : list of n, array_like (n, ninputs), or inputs of Solver.simulate, optional
        Inputs over time. The first two forms differ between the motions.
    threads : int, optional
        Number of threads. Default: the number of processors that may be used.
    progress : callable, optional
        Called as ``progress(done, n)`` after each motion. A KeyboardInterrupt in it ends all motions; the results so
        far are returned.
    **options
        Further arguments of `Solver.simulate`, such as `sensitivities`, `rtol`, `method`.

    Returns
    -------
    Motions
        Trajectories in the order of the rows. Motions that fail are recorded, and the others continue.

    Raises
    ------
    ValueError
        If an argument has a wrong shape or value.

    Examples
    --------
    >>> motions = ordernm.simulate_many(solver, np.linspace(0.0, 1.0, 11), p={"length_1": [0.8, 1.0, 1.2]})
    >>> len(motions), motions["tip_x"].shape
    (3, (3, 11))
    """
    # long: the docstring describes every argument
    _check(options, threads, progress)
    check_given(solver)
    several = _rows(solver, q, u, p, inputs)
    n = len(several)
    found: list[Trajectory | None] = [None] * n
    failures: dict[int, Exception] = {}
    stop = threading.Event()

    def look(time: float, end: float) -> None:
        if stop.is_set():
            raise KeyboardInterrupt

    def run(i: int) -> None:
        try:
            with one_thread():
                found[i] = solver.simulate(t, **several[i], progress=look, **options)
        except FAILURES as error:
            failures[i] = error
            found[i] = error.trajectory if isinstance(error, SimulationError) else None

    _in_threads(run, n, threads or processors(), progress or (lambda done, of: None), stop)
    return Motions(found, dict(sorted(failures.items())))


def _check(options: Mapping[str, Any], threads: Any, progress: Any) -> None:
    """Reject options that a batch of motions cannot have, and invalid `threads` and `progress`."""
    for word in ("on_failure", "dq0", "du0"):
        if word in options:
            raise ValueError(
                f"simulate_many does not take {word}: "
                + ("failures are recorded" if word[0] == "o" else "simulate does")
            )
    if threads is not None and (not isinstance(threads, (int, np.integer)) or threads < 1):
        raise ValueError(f"threads is {threads!r}, expected a number of threads")
    if progress is not None and not callable(progress):
        raise ValueError(f"progress is {progress!r}, expected a function of two numbers")


def _in_threads(
    run: Callable[[int], None], n: int, threads: int, progress: Callable[[int, int], None], stop: threading.Event
) -> None:
    """Run motions 0 to n - 1. Errors and Ctrl-C set `stop` and skip the motions that have not begun. Errors are raised
    again; Ctrl-C is a normal end."""
    left: set[Future[None]] = set()
    with ThreadPoolExecutor(threads) as pool:
        try:
            for done in range(1, n + 1):
                if done == 1:
                    run(0)  # arguments that are wrong for all motions raise an error here; the library is compiled once
                    left = {pool.submit(run, i) for i in range(1, n)}
                else:
                    ended = next(iter(wait(left, return_when=FIRST_COMPLETED).done))
                    left.remove(ended)
                    ended.result()
                progress(done, n)
        except BaseException as error:
            stop.set()
            for future in left:
                future.cancel()
            if not isinstance(error, KeyboardInterrupt):
                raise


def _rows(solver: Any, q: Numbers, u: Numbers, p: Numbers, inputs: Any) -> list[dict[str, Any]]:
    """The arguments of each motion of a batch."""
    counts: dict[str, int] = {}
    given: dict[str, Any] = {}
    for name, value, of in (("q", q, solver.nq), ("u", u, solver.nu), ("p", p, solver.np)):
        if isinstance(value, Mapping):
            shapes = {np.shape(x) for x in value.values()} - {()}
            if len(shapes) > 1 or any(len(s) > 1 for s in shapes):
                raise ValueError(
                    f"{name} has values of shapes {sorted(shapes)}, expected numbers or arrays (n,) of one length"
                )
            given[name] = value
            if shapes:
                (counts[name],) = shapes.pop()
            continue
        given[name] = None if value is None else np.asarray(value, float)
        if value is not None and given[name].ndim == 2:
            counts[name] = len(given[name])
        elif value is not None and given[name].shape != (of,):
            raise ValueError(f"{name} has shape {given[name].shape}, expected ({of},) or (n, {of})")
    listed = isinstance(inputs, list) and inputs and not np.isscalar(inputs[0])
    if listed or (isinstance(inputs, np.ndarray) and inputs.ndim == 2):
        counts["inputs"] = len(inputs)
    if not counts:
        raise ValueError(
            "simulate_many: no argument has rows; give p (n, np), q (n, nq), u (n, nu), inputs as a list, or p={name: (n,)}"
        )
    if len(set(counts.values())) > 1:
        rows = ", ".join(f"{name} {n}" for name, n in counts.items())
        raise ValueError(f"simulate_many: arguments have different numbers of motions: {rows}")
    n = next(iter(counts.values()))

    def row(name: str, i: int) -> Any:
        value = inputs if name == "inputs" else given[name]
        if isinstance(value, Mapping):
            return {k: float(np.asarray(x, float)[i] if np.ndim(x) else x) for k, x in value.items()}
        return value[i] if name in counts else value

    return [{name: row(name, i) for name in ("q", "u", "p", "inputs")} for i in range(n)]


__all__ = ["Motions", "simulate_many"]
