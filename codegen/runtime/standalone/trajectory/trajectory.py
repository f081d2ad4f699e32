"""The result of a simulation: a motion over time, with outputs and derivatives, under the names of the model."""
# long: each of twenty methods has a docstring with an example

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ....wording import counted, nearest, similar
from ..arrays import Array, Shape
from ..calls.arguments import name_or_names, some

FINISHED, INTERRUPTED = "finished", "interrupted"
"""Reasons for the end of a simulation: it reached the last time, or the user pressed Ctrl-C."""


Later = ArrayLike | Callable[[], ArrayLike] | None

EXPLAINED_DRIFT = 1e-6
"""Relative change of the total energy above which the summary names causes other than integration errors."""

LATER: dict[str, Shape] = {"energy": (2,), "closure": ()}
"""Values that are computed at their first use, with the shape of each at one time."""


class UnknownNameError(KeyError):
    """Raised if a trajectory has no series with the given name."""

    __str__ = Exception.__str__  # KeyError would print its text in quotes


class Trajectory:
    """A motion over time, with outputs and derivatives under the names of the model.

    ``trajectory["q.crank"]`` and ``trajectory["tip_x"]`` are series over time, ``trajectory.derivative("tip_x",
    "length")`` is a derivative. A trajectory is plain data: it needs neither solver nor model file.

    Parameters
    ----------
    model : str
        Name of the model.
    t : array_like (nt,)
        Times, s: the requested ones, as far as they were reached.
    q, u : array_like (nt, nq), (nt, nu)
        Coordinates and speeds, SI units and radians.
    dq, du : array_like (k, nt, nq), (k, nt, nu), optional
        Their derivatives, directions first. Default: k = 0.
    outputs, doutputs : array_like (nt, noutputs), (k, nt, noutputs), optional
        Outputs and their total derivatives. They may be left out only if `output_names` is empty.
    coordinate_names, speed_names, output_names, parameter_names, input_names : sequence of str
        Names in the order of the arrays.
    sensitivity_names : sequence of str, optional
        Names of the k directions: a parameter, ``q.NAME`` or ``u.NAME`` for an initial value, or any other word.
    coordinate_units, speed_units, output_units, parameter_units : sequence of str, optional
        A unit for each name, ``""`` if unknown. Default: all unknown.
    p : array_like (np,), optional
        Design parameters of the motion.
    inputs : array_like (ninputs,), optional
        Inputs, if they were constant.
    energy : array_like (nt, 2) or callable, optional
        Kinetic and potential energy, J, or a function that is called when they are first read.
    closure : array_like (nt,) or callable, optional
        Largest scaled position residual of closed loops, or a function that is called when it is first read.
    stats : mapping, optional
        Facts about the computation: ``method``, ``steps``, ``evaluations``, ``seconds``, ``reason`` and others. Arrays
        and tuples become lists.

    Attributes
    ----------
    t, q, u, dq, du, outputs, doutputs, p, inputs, energy, closure, stats
        As above. Missing dq, du, outputs and doutputs have no entries; other missing values are None.
    events : tuple of Crossing
        Events of the motion, in order.
    model, coordinate_names, speed_names, output_names, parameter_names, input_names, sensitivity_names
        As above, as tuples.

    Raises
    ------
    ValueError
        If shapes or numbers of names do not fit together.

    Examples
    --------
    >>> run = solver.simulate(np.linspace(0.0, 1.0, 11), sensitivities="length_1")
    >>> run["tip_x"].shape, run.derivative("tip_x", "length_1").shape
    ((11,), (11,))
    """

    def __init__(
        self, model: str, t: ArrayLike, q: ArrayLike, u: ArrayLike, dq: ArrayLike | None = None, du: ArrayLike | None = None,
        outputs: ArrayLike | None = None, doutputs: ArrayLike | None = None, *, coordinate_names: Sequence[str],
        speed_names: Sequence[str], output_names: Sequence[str] = (), parameter_names: Sequence[str] = (),
        input_names: Sequence[str] = (), sensitivity_names: Sequence[str] = (), coordinate_units: Sequence[str] = (),
        speed_units: Sequence[str] = (), output_units: Sequence[str] = (), parameter_units: Sequence[str] = (),
        p: ArrayLike | None = None, inputs: ArrayLike | None = None, energy: Later = None, closure: Later = None,
        stats: Mapping[str, Any] | None = None,
    ):  # fmt: skip
        self.model = str(model)
        self.coordinate_names, self.speed_names = tuple(coordinate_names), tuple(speed_names)
        self.output_names, self.parameter_names = tuple(output_names), tuple(parameter_names)
        self.input_names, self.sensitivity_names = tuple(input_names), tuple(sensitivity_names)
        nt, nq, nu, k = np.size(t), len(self.coordinate_names), len(self.speed_names), len(self.sensitivity_names)
        noutputs = len(self.output_names)
        self.t: Array = _shaped("t", t, (nt,))
        self.q: Array = _shaped("q", q, (nt, nq))
        self.u: Array = _shaped("u", u, (nt, nu))
        self.dq: Array = _shaped("dq", dq, (k, nt, nq), may_lack=not k)
        self.du: Array = _shaped("du", du, (k, nt, nu), may_lack=not k)
        self.outputs: Array = _shaped("outputs", outputs, (nt, noutputs), may_lack=not noutputs)
        self.doutputs: Array = _shaped("doutputs", doutputs, (k, nt, noutputs), may_lack=not k * noutputs)
        self.p = None if p is None else _shaped("p", p, (len(self.parameter_names),))
        self.inputs = None if inputs is None else _shaped("inputs", inputs, (len(self.input_names),))
        self.views: Any = None
        self._later: dict[str, Later] = {"energy": energy, "closure": closure}
        for name, x in self._later.items():
            if not callable(x):
                self._now(name)
        self.stats: dict[str, Any] = {
            str(name): x if type(x) in PLAIN else _plain(f"stats[{name!r}]", x) for name, x in (stats or {}).items()
        }
        self.coordinate_units = _units("coordinate", coordinate_units, nq)
        self.speed_units = _units("speed", speed_units, nu)
        self.output_units = _units("output", output_units, noutputs)
        self.parameter_units = _units("parameter", parameter_units, len(self.parameter_names))
        self.events: tuple[Any, ...] = ()
        self._index = _index_of(self.coordinate_names, self.speed_names, self.output_names)
        if len(set(self.sensitivity_names)) < k:
            raise ValueError(f"names of sensitivities must differ: {some(self.sensitivity_names)}")

    def like_this(
        self, arrays: Mapping[str, Array | None], later: Mapping[str, Later], stats: dict[str, Any]
    ) -> Trajectory:
        """Return another motion with the same names and units.

        Parameters
        ----------
        arrays : mapping of str to ndarray or None
            Arrays by attribute. They are not copied.
        later : mapping of str to array_like or callable
            ``energy`` and ``closure``.
        stats : dict
            Facts about the computation.

        Returns
        -------
        Trajectory
            The other motion.

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 11))
        >>> half = {"t": run.t[:6], "q": run.q[:6], "u": run.u[:6], "dq": run.dq[:, :6], "du": run.du[:, :6],
        ...         "outputs": run.outputs[:6], "doutputs": run.doutputs[:, :6]}
        >>> len(run.like_this(half, {"energy": None, "closure": None}, run.stats))
        6
        """
        found = Trajectory.__new__(Trajectory)
        found.__dict__ = {**self.__dict__, **arrays, "_later": later, "stats": stats}
        return found

    # -- series by name --------------------------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the series: ``q.NAME`` of coordinates, ``u.NAME`` of speeds, names of outputs."""
        return tuple(self._index)

    def __getitem__(self, name: str) -> Array:
        """A series over time, (nt,): of a coordinate, a speed or an output, see `names`; ``t`` are the times."""
        if not isinstance(name, str):
            raise UnknownNameError(
                f"{name!r} is not a name; trajectory['q.NAME'] is a series, trajectory.q[i] the coordinates at the i-th time"
            )
        if name == "t":
            return self.t
        if name not in self._index:
            raise UnknownNameError(self._unknown(name))
        return self._column(name, self.q, self.u, self.outputs)

    __iter__ = None  # iterating a trajectory is ambiguous; Python would try the names 0, 1, ...

    def __contains__(self, name: object) -> bool:
        return name == "t" or name in self._index

    def __len__(self) -> int:
        """The number of times."""
        return len(self.t)

    def q_of(self, name: str) -> Array:
        """Return a coordinate over time.

        Parameters
        ----------
        name : str
            Name of the coordinate.

        Returns
        -------
        ndarray (nt,)
            Its values, rad or m.

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 11))
        >>> run.q_of("upper")[:3].round(3)
        array([1.2  , 1.124, 0.91 ])
        """
        return self[f"q.{name}"]

    def u_of(self, name: str) -> Array:
        """Return a speed over time.

        Parameters
        ----------
        name : str
            Name of the speed.

        Returns
        -------
        ndarray (nt,)
            Its values, rad/s or m/s.

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 11))
        >>> run.u_of("upper")[:3].round(3)
        array([ 0.   , -1.515, -2.6  ])
        """
        return self[f"u.{name}"]

    def derivative(self, name: str, by: str | int) -> Array:
        """Return the total derivative of a series.

        Parameters
        ----------
        name : str
            Name of a coordinate (``q.NAME``), a speed (``u.NAME``) or an output.
        by : str or int
            One of `sensitivity_names`, or its index.

        Returns
        -------
        ndarray (nt,)
            The derivative, in the unit of the series per unit of `by`.

        Raises
        ------
        UnknownNameError
            A KeyError, if there is no such series or direction.

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 11), sensitivities="length_1")
        >>> run.derivative("tip_x", "length_1")[-1].round(3)
        np.float64(0.352)
        """
        if name not in self._index:
            raise UnknownNameError(self._unknown(name))
        direction = self._direction(by)
        return self._column(name, self.dq[direction], self.du[direction], self.doutputs[direction])

    def _column(self, name: str, q: Array, u: Array, outputs: Array) -> Array:
        """The series `name`, from coordinates, speeds and outputs, each (nt, ...)."""
        i = self._index[name]
        for x in (q, u):
            if i < x.shape[1]:
                return x[:, i]
            i -= x.shape[1]
        return outputs[:, i]

    def unit(self, name: str) -> str:
        """Return the unit of a series, a parameter or a sensitivity.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        str
            The unit, ``""`` if unknown.

        Examples
        --------
        >>> run = solver.simulate(1.0)
        >>> run.unit("tip_x"), run.unit("u.upper")
        ('m', 'rad/s')
        """
        if name == "t":
            return "s"
        units = (*self.coordinate_units, *self.speed_units, *self.output_units)
        return units[self._index[name]] if name in self._index else self._unit_of_sensitivity(name)

    def derivative_unit(self, name: str, by: str | int) -> str:
        """Return the unit of a derivative.

        Parameters
        ----------
        name : str
            Name of a series.
        by : str or int
            One of `sensitivity_names`, or its index.

        Returns
        -------
        str
            The unit, such as ``m/kg``; ``""`` if the unit of the series or of the sensitivity is unknown.

        Examples
        --------
        >>> run = solver.simulate(1.0, sensitivities="mass_1")
        >>> run.derivative_unit("tip_x", "mass_1")
        'm/kg'
        """
        above, below = self.unit(name), self._unit_of_sensitivity(self.sensitivity_names[self._direction(by)])
        if not above or not below:
            return ""
        above = f"({above})" if "/" in above else above
        return f"{above}/({below})" if any(c in below for c in " */") else f"{above}/{below}"

    def _unit_of_sensitivity(self, name: str) -> str:
        if name in self.parameter_names:
            return self.parameter_units[self.parameter_names.index(name)]
        return self.unit(name) if name in self._index else ""

    def _direction(self, by: str | int) -> int:
        known = self.sensitivity_names
        if isinstance(by, str) and by in known:
            return known.index(by)
        if not isinstance(by, str) and -len(known) <= by < len(known):
            return by % len(known)
        if not known:
            raise UnknownNameError(
                f"no derivative with respect to {by!r}: the simulation has none; ask for them, such as by "
                f"simulate(..., sensitivities=({str(by)!r},))"
            )
        raise UnknownNameError(
            f"no derivative with respect to {by!r}; there are those for {some(known)}{nearest(by, known)}"
        )

    def _unknown(self, name: str) -> str:
        """The message for the name of a series that does not exist."""
        # for a misspelt crank, suggest q.crank and u.crank
        meant: dict[str, tuple[str, ...]] = {n: (n,) for n in self.names}
        meant |= {
            n: tuple(x for x in (f"q.{n}", f"u.{n}") if x in self) for n in (*self.coordinate_names, *self.speed_names)
        }
        meant |= {n: (n,) for n in (*self.output_names, "t")}
        near = meant.get(similar(name, meant) or "", ())
        hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
        return f"no series {name!r} in the trajectory of {self.model}; there are t, {some(self.names)}{hint}"

    # -- values computed at first use --------------------------------------------------------------------------------

    @property
    def energy(self) -> Array | None:
        """Kinetic and potential energy over time, (nt, 2), J; computed when first read."""
        return self._now("energy")

    @property
    def closure(self) -> Array | None:
        """Largest scaled position residual of closed loops over time, (nt,); None without loops."""
        return self._now("closure")

    def _now(self, name: str) -> Array | None:
        x = self._later[name]
        x = x() if callable(x) else x
        found = None if x is None else _shaped(name, x, (len(self), *LATER[name]))
        self._later[name] = found
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_later": {name: self._now(name) for name in LATER}, "views": None}

    # -- end and accuracy of the motion ------------------------------------------------------------------------------

    @property
    def final(self) -> tuple[Array, Array]:
        """The last state (q, u), (nq,) and (nu,), from which another simulation may continue.

        If an event ended the motion, it is the state of the event at ``events[-1].t``.
        """
        stopped = (
            [c for c in self.events if c.event.stop and c.t >= self.t[-1]]
            if self.ended == "event" and len(self)
            else []
        )
        if stopped:
            return stopped[-1].q.copy(), stopped[-1].u.copy()
        if not len(self):
            raise IndexError(f"the trajectory of {self.model} has no times, so there is no last state")
        return self.q[-1].copy(), self.u[-1].copy()

    @property
    def ended(self) -> str:
        """Reason for the end: ``finished``, ``interrupted``, ``event``, or a sentence."""
        return str(self.stats.get("reason", "unknown"))

    @property
    def energy_drift(self) -> float | None:
        """Largest relative change of total energy, or None without energies.

        It is ``max |E - E[0]|``, divided by the greatest kinetic energy or the range of the potential energy, whichever is
        larger. If nothing drives or damps the model, it measures integration errors.
        """
        if self.energy is None:
            return None
        if not len(self):
            return 0.0
        kinetic, potential = self.energy.T
        with np.errstate(all="ignore"):
            total = kinetic + potential
            change = float(np.max(np.abs(total - total[0])))
            moves = max(float(np.max(np.abs(kinetic))), float(np.ptp(potential)))
        return 0.0 if change == 0 else change / moves if moves else float("inf")

    @property
    def closure_drift(self) -> float | None:
        """Largest residual of closed loops, in characteristic lengths or rad; None without loops."""
        return None if self.closure is None else float(np.max(self.closure, initial=0.0))

    def lines(self) -> list[str]:
        """Return the summary that `repr` shows.

        Returns
        -------
        list of str
            Its lines.

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 11))
        >>> print(run.lines()[0])
        Trajectory of double_pendulum: 11 times from 0 to 1 s
        """
        interval = f" from {self.t[0]:.6g} to {self.t[-1]:.6g} s" if len(self) else ""
        holds = [
            counted(len(names), noun)
            for noun, names in (
                ("coordinate", self.coordinate_names),
                ("speed", self.speed_names),
                ("output", self.output_names),
            )
            if names or noun != "output"
        ]
        if self.sensitivity_names:
            holds.append(f"derivatives with respect to {some(self.sensitivity_names)}")
        lines = [f"Trajectory of {self.model}: {counted(len(self), 'time')}{interval}", f"  {', '.join(holds)}"]
        counts = [f"{self.stats[word]} {word}" for word in ("steps", "evaluations") if word in self.stats]
        if "seconds" in self.stats:
            counts.append(f"{self.stats['seconds']:.3g} s")
        method = f"{self.stats['method']}: " if "method" in self.stats else ""
        lines.append(f"  {method}{', '.join([*counts, f'ended: {self.ended}'])}")
        drifts = {"total energy changes by": self.energy_drift, "loops are open by": self.closure_drift}
        if told := [f"{words} {x:.2g} at most" for words, x in drifts.items() if x is not None]:
            lines.append(f"  {', '.join(told)}")
        if (self.energy_drift or 0.0) > EXPLAINED_DRIFT:
            lines.append(
                "  (relative to the energy that is exchanged; joint forces, friction and inputs change the total energy, too)"
            )
        return lines

    def __repr__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        from .html import as_html

        shown = self.output_names or self.names
        return as_html(self.lines(), self.t, [(name, self.unit(name), self[name]) for name in shown])

    # -- tables, files, plots and views ------------------------------------------------------------------------------

    def columns(self) -> dict[str, Array]:
        """Return all series under their column names in a table.

        Returns
        -------
        dict of str to ndarray (nt,)
            ``q.NAME``, ``u.NAME``, outputs, then ``d(NAME)/d(SENSITIVITY)``.

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 11))
        >>> list(run.columns())[:3]
        ['q.upper', 'q.lower', 'u.upper']
        """
        found = {name: self[name] for name in self.names}
        for by in self.sensitivity_names:
            found |= {f"d({name})/d({by})": self.derivative(name, by) for name in self.names}
        return found

    def to_dataframe(self) -> Any:
        """Return a pandas table with the index t (s) and the columns of `columns`.

        Returns
        -------
        pandas.DataFrame
            A row for each time.

        Raises
        ------
        ImportError
            If pandas is not installed.

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 11))
        >>> run.to_dataframe().shape
        (11, 10)
        """
        from .table import dataframe

        return dataframe(self.t, self.columns())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the trajectory into a file, as a whole or not at all.

        `load` returns the same trajectory, equal in every bit.

        Parameters
        ----------
        path : path
            A name that ends in ``.npz`` (NumPy), or ``.parquet``, which needs pyarrow.

        Raises
        ------
        TrajectoryFileError
            A ValueError, if the name has another ending.
        ImportError
            If pyarrow is needed and not installed.

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 11))
        >>> run.save("run.npz")
        """
        from .events import rows_of
        from .files import write

        arrays = {name: x for name in ARRAYS if (x := getattr(self, name)) is not None}
        words: dict[str, Any] = {name: getattr(self, name) for name in WORDS}
        if self.events:
            arrays["events"] = rows_of(self.events)
            words["events"] = [astuple(c.event) for c in self.events]
        write(path, words, arrays, self.columns())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Trajectory:
        """Read a file that `save` wrote.

        Parameters
        ----------
        path : path
            The file.

        Returns
        -------
        Trajectory
            The saved motion.

        Raises
        ------
        TrajectoryFileError
            A ValueError, if the file is of another kind or damaged.

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 11))
        >>> run.save("run.npz")
        >>> bool((type(run).load("run.npz").q == run.q).all())
        True
        """
        from .events import crossings_of
        from .files import TrajectoryFileError, damaged, read

        words, arrays = read(path)
        events, rows = words.pop("events", ()), arrays.pop("events", np.empty((0, 0)))
        try:
            found = cls(**{**words, **arrays})
            sizes = (
                len(x) for x in (found.coordinate_names, found.speed_names, found.output_names, found.sensitivity_names)
            )
            found.events = crossings_of(rows, events, *sizes)
            return found
        except (TypeError, ValueError) as error:
            raise TrajectoryFileError(damaged(path, error)) from None

    def plot(
        self,
        what: str | Sequence[str] | None = None,
        path: str | os.PathLike[str] | None = None,
        sensitivities: str | Sequence[str] | None = None,
    ) -> Any:
        """Draw curves over time: a panel for each series, and its derivatives beside it.

        Parameters
        ----------
        what : str or sequence of str, optional
            Names of series. Default: the outputs, or the coordinates if there are no outputs.
        path : path, optional
            File to write: ``.svg``, ``.png`` or ``.pdf``. The same trajectory gives the same bytes.
        sensitivities : str or sequence of str, optional
            Directions whose derivatives are drawn. Default: all; ``()``: none.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.

        Raises
        ------
        ImportError
            If matplotlib is not installed.

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 11))
        >>> figure = run.plot("tip_x", "tip.svg")
        """
        from .plot import draw

        whole = self.output_names or tuple(f"q.{name}" for name in self.coordinate_names)
        names = whole if what is None else name_or_names("what", what)
        if sensitivities is None:
            by: Sequence[str | int] = self.sensitivity_names
        else:
            by = name_or_names("sensitivities", sensitivities)
        panels = [
            (
                (name, self.unit(name), self[name]),
                [
                    (
                        self.sensitivity_names[self._direction(d)],
                        self.derivative_unit(name, d),
                        self.derivative(name, d),
                    )
                    for d in by
                ],
            )
            for name in names
        ]
        title = self.model if self.ended in (FINISHED, "unknown") else f"{self.model} ({self.ended})"
        return draw(title, self.t, panels, path, cut=what is None)

    def animate(
        self,
        path: str | os.PathLike[str],
        solver: Any = None,
        *,
        view: str = "auto",
        rate: float = 25.0,
        folder: str | os.PathLike[str] = ".",
    ) -> None:
        """Write an animation of the motion, by matplotlib.

        Parameters
        ----------
        path : path
            File to write: ``.gif``, or ``.png`` for an animated PNG.
        solver : Solver, optional
            Solver of the model, generated with frames. It is needed for a trajectory that was loaded from a file.
        view : {"auto", "x", "y", "z", "corner"}, optional
            See `Solver.picture`.
        rate : float, optional
            Frames per second of motion. Each frame shows the result nearest in time.
        folder : path, optional
            Folder of the model, from which the names of mesh files start.

        Raises
        ------
        ValueError
            If the trajectory has no solver with frames, or the solver is that of another model.
        ImportError
            If matplotlib is not installed (extra ``plot``).

        Examples
        --------
        >>> run = solver.simulate(np.linspace(0.0, 0.2, 6))
        >>> run.animate("run.gif")
        """
        self._shown_by(solver).animate(self, path, view, folder, rate)

    def view(
        self,
        solver: Any = None,
        *,
        folder: str | os.PathLike[str] = ".",
        port: int = 0,
        arrows: str | Sequence[str] = (),
    ) -> Any:
        """Play the motion in a browser; moving the slider of a design parameter computes the motion again.

        Parameters
        ----------
        solver : Solver, optional
            Solver of the model, generated with frames. It is needed for a trajectory that was loaded from a file, whose view
            has no sliders.
        folder : path, optional
            Folder of the model, from which the names of mesh files start.
        port : int, optional
            Port of this machine. Default: any that is free.
        arrows : str or sequence of str, optional
            See `Solver.view`.

        Returns
        -------
        Viewer
            The view: `url` is its address, `close` ends it. A notebook displays it.

        Raises
        ------
        ValueError
            See `animate`.
        ImportError
            If viser is not installed (extra ``view``).

        Examples
        --------
        >>> run = solver.simulate(2.0)
        >>> view = run.view()  # doctest: +SKIP
        """
        return self._shown_by(solver).view(self, folder, port, arrows)

    def html(
        self, path: str | os.PathLike[str], solver: Any = None, *, folder: str | os.PathLike[str] = ".",
        arrows: str | Sequence[str] = (),
    ) -> None:  # fmt: skip
        """Write a page that plays the motion in a browser, without a server and without a network.

        Parameters
        ----------
        path : path
            File to write, ``.html``.
        solver : Solver, optional
            See `view`.
        folder : path, optional
            Folder of the model, from which the names of mesh files start.
        arrows : str or sequence of str, optional
            Arrows that the page shows; see `Solver.view`.

        Raises
        ------
        ValueError
            See `animate`; or there are no such arrows.
        ImportError
            If viser is not installed (extra ``view``).

        Warns
        -----
        RuntimeWarning
            If the motion has more than 3000 frames; some are then left out.

        Examples
        --------
        >>> run = solver.simulate(2.0)
        >>> run.html("run.html")  # doctest: +SKIP
        """
        self._shown_by(solver).html(self, path, folder, arrows)

    def _shown_by(self, solver: Any) -> Any:
        """The object that shows the trajectory in a view or a picture.

        Raises
        ------
        ValueError
            If there is no such object, or the solver belongs to another model.
        """
        if solver is None:
            if self.views is None:
                raise ValueError(
                    f"the trajectory of {self.model} has no solver with frames; generate the package with frames "
                    f"(ordernm generate MODEL --frames), or pass such a solver as solver=... for a loaded trajectory"
                )
            return self.views
        if "display" not in solver._manifest:
            raise ValueError(
                f"{solver!r} has no frames; generate the package with frames: ordernm generate MODEL --frames"
            )
        theirs = (solver.name, solver.coordinate_names, solver.parameter_names)
        if theirs != (self.model, self.coordinate_names, self.parameter_names):
            raise ValueError(
                f"the trajectory is of model {self.model} with coordinates {some(self.coordinate_names)}; the solver is of "
                f"{solver.name} with {some(solver.coordinate_names)}"
            )
        return solver._views.of_motion(self)


ARRAYS = ("t", "q", "u", "dq", "du", "outputs", "doutputs", "p", "inputs", "energy", "closure")
"""Attributes that a file stores as arrays."""

WORDS = (
    "model", "coordinate_names", "speed_names", "output_names", "parameter_names", "input_names", "sensitivity_names",
    "coordinate_units", "speed_units", "output_units", "parameter_units", "stats",
)  # fmt: skip
"""Attributes that a file stores as text."""


PLAIN = (str, bool, int, float)
"""Types that JSON preserves."""


def _shaped(name: str, value: ArrayLike | None, shape: Shape, may_lack: bool = False) -> Array:
    """An array of floats with the given shape."""
    if value is None:
        if may_lack:
            return np.zeros(shape)
        raise ValueError(f"{name} is missing; give an array of shape {shape}")
    found = np.asarray(value, dtype=np.float64)
    if found.shape != shape:
        raise ValueError(f"{name} has shape {found.shape}, expected {shape}")
    return found


@lru_cache(64)
def _index_of(coordinates: tuple[str, ...], speeds: tuple[str, ...], outputs: tuple[str, ...]) -> Mapping[str, int]:
    """Indices of series by name; computed once per model."""
    names = [*(f"q.{name}" for name in coordinates), *(f"u.{name}" for name in speeds), *outputs]
    index = {name: i for i, name in enumerate(names)}
    if len(index) < len(names) or "t" in index:
        raise ValueError(f"names of series must differ from each other and from t: {some(names)}")
    return index


def _units(of: str, units: Sequence[str], n: int) -> tuple[str, ...]:
    found = tuple(units) or ("",) * n
    if len(found) != n:
        raise ValueError(f"there are {len(found)} {of} units, expected {n}, one for each name, or none at all")
    return found


def _plain(where: str, value: Any) -> Any:
    """Converts a value to types that JSON preserves: NumPy numbers to Python numbers, arrays and tuples to lists."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(f"{where}[{key!r}]", x) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(where, x) for x in value]
    if value is None or isinstance(value, PLAIN):
        return value
    raise ValueError(f"{where} is {value!r}; text, numbers, lists and mappings of these are allowed")
