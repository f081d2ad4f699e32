"""What a simulation returns: a motion over time with its outputs and their derivatives, under the names of the model."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Shape
from ..calls.arguments import some

FINISHED, INTERRUPTED = "finished", "interrupted"
"""Reasons for which a simulation ends: it came to its last time, or somebody pressed Ctrl-C."""


Later = ArrayLike | Callable[[], ArrayLike] | None

LATER: dict[str, Shape] = {"energy": (2,), "closure": ()}
"""What may be computed when it is first asked for, and its shape beside the times."""


class UnknownNameError(KeyError):
    """A trajectory has no series of that name."""

    __str__ = Exception.__str__  # a KeyError shows its text in quotes


class Trajectory:
    """A motion: ``trajectory["q.crank"]``, ``trajectory["tip_x"]`` and ``trajectory.derivative("tip_x", "length")`` over time.

    It is made of plain data, and knows neither solver nor model file::

        Trajectory(model, t, q, u, dq, du, outputs, doutputs, coordinate_names=..., speed_names=..., output_names=...,
                   parameter_names=..., input_names=..., sensitivity_names=..., coordinate_units=..., speed_units=...,
                   output_units=..., parameter_units=..., p=..., inputs=..., energy=..., closure=..., stats=...)

    Parameters
    ----------
    model : str
        Its name.
    t : (nt,)
        Times, s, as they were asked for, or those that were reached.
    q, u : (nt, nq) and (nt, nu)
        Coordinates and speeds; m, rad and their rates.
    dq, du : (k, nt, nq) and (k, nt, nu), optional
        Their derivatives, directions first; left out: k = 0.
    outputs, doutputs : (nt, noutputs) and (k, nt, noutputs), optional
        Outputs and their total derivatives. Left out only where there are no names of outputs.
    coordinate_names, speed_names, output_names, parameter_names, input_names : sequences of str
        In the order of the arrays.
    sensitivity_names : sequence of str
        What each of the k directions is a derivative with respect to: a parameter, ``q.NAME`` or ``u.NAME`` for an initial
        value, or any other word for a direction.
    coordinate_units, speed_units, output_units, parameter_units : sequences of str, optional
        As many as names, ``""`` where one is not known; left out: none is known.
    p : (np,), optional
        Design parameters of the motion.
    inputs : (ninputs,), optional
        Inputs, where they were constant.
    energy : (nt, 2), or a function that gives it, optional
        Kinetic and potential energy, J. A function is called when it is first asked for.
    closure : (nt,), or a function that gives it, optional
        The largest scaled position residual of closed loops.
    stats : mapping, optional
        How it was computed: ``method``, ``steps``, ``evaluations``, ``seconds``, ``reason`` (`FINISHED`, `INTERRUPTED` or a
        sentence), and whatever else JSON can hold; arrays and tuples become lists.

    Attributes
    ----------
    t, q, u, dq, du, outputs, doutputs, p, inputs, energy, closure, stats
        As above; what was left out of dq, du, outputs and doutputs has no entries, other things are None.
    events : tuple of Crossing
        What happened on the way; see `codegen.runtime.standalone.trajectory.events`.
    model, coordinate_names, speed_names, output_names, parameter_names, input_names, sensitivity_names
        As above, tuples.

    Raises
    ------
    ValueError
        Shapes, or numbers of names, that do not fit together.
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
        """Another motion with the same names and units; its arrays are taken as they are."""
        found = Trajectory.__new__(Trajectory)
        found.__dict__ = {**self.__dict__, **arrays, "_later": later, "stats": stats}
        return found

    # -- series by name --------------------------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """What `trajectory[name]` takes beside ``t``: ``q.NAME`` of coordinates, ``u.NAME`` of speeds, names of outputs."""
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

    __iter__ = None  # over times or over names? Python would try 0, 1, ... as names

    def __contains__(self, name: object) -> bool:
        return name == "t" or name in self._index

    def __len__(self) -> int:
        """The number of times."""
        return len(self.t)

    def q_of(self, name: str) -> Array:
        """A coordinate over time, (nt,)."""
        return self[f"q.{name}"]

    def u_of(self, name: str) -> Array:
        """A speed over time, (nt,)."""
        return self[f"u.{name}"]

    def derivative(self, name: str, by: str | int) -> Array:
        """The total derivative of a series, (nt,): of a coordinate, a speed or an output, in its unit per that of `by`.

        Parameters
        ----------
        name : str
            As of `trajectory[name]`.
        by : str or int
            One of `sensitivity_names`, or its number.
        """
        if name not in self._index:
            raise UnknownNameError(self._unknown(name))
        direction = self._direction(by)
        return self._column(name, self.dq[direction], self.du[direction], self.doutputs[direction])

    def _column(self, name: str, q: Array, u: Array, outputs: Array) -> Array:
        """A series of these, (nt, ...) each."""
        i = self._index[name]
        for x in (q, u):
            if i < x.shape[1]:
                return x[:, i]
            i -= x.shape[1]
        return outputs[:, i]

    def unit(self, name: str) -> str:
        """The unit of a series, a parameter or a sensitivity; ``""`` where it is not known."""
        if name == "t":
            return "s"
        units = (*self.coordinate_units, *self.speed_units, *self.output_units)
        return units[self._index[name]] if name in self._index else self._unit_of_sensitivity(name)

    def derivative_unit(self, name: str, by: str | int) -> str:
        """The unit of a derivative, such as ``m/kg``; ``""`` where one of the two is not known."""
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
                f"no derivative by {by!r}: the simulation has none; ask for them, such as by "
                f"simulate(..., sensitivities=({str(by)!r},))"
            )
        near = difflib.get_close_matches(str(by), known, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise UnknownNameError(f"no derivative by {by!r}; there are those by {some(known)}{hint}")

    def _unknown(self, name: str) -> str:
        """What is said of a name that is not known."""
        # crnk is near to crank, for q.crank and u.crank
        meant: dict[str, tuple[str, ...]] = {n: (n,) for n in self.names}
        meant |= {
            n: tuple(x for x in (f"q.{n}", f"u.{n}") if x in self) for n in (*self.coordinate_names, *self.speed_names)
        }
        meant |= {n: (n,) for n in (*self.output_names, "t")}
        near = [x for n in difflib.get_close_matches(str(name), meant, 1) for x in meant[n]]
        hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
        return f"no series {name!r} in the trajectory of {self.model}; there are t, {some(self.names)}{hint}"

    # -- what is computed when it is asked for -------------------------------------------------------------------------------

    @property
    def energy(self) -> Array | None:
        return self._now("energy")

    @property
    def closure(self) -> Array | None:
        return self._now("closure")

    def _now(self, name: str) -> Array | None:
        x = self._later[name]
        x = x() if callable(x) else x
        found = None if x is None else _shaped(name, x, (len(self), *LATER[name]))
        self._later[name] = found
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_later": {name: self._now(name) for name in LATER}}

    # -- how it went -------------------------------------------------------------------------------------------------------

    @property
    def final(self) -> tuple[Array, Array]:
        """The last state (q, u), (nq,) and (nu,): where another simulation may go on.

        After an event that has ended the motion it is the event's, at ``events[-1].t``.
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
        """Why it ended: `FINISHED`, `INTERRUPTED`, or a sentence."""
        return str(self.stats.get("reason", "unknown"))

    @property
    def energy_drift(self) -> float | None:
        """The largest change of total energy, relative to the energy that moves; None where energies are not there.

        That is ``max |E - E[0]|`` over the larger of the greatest kinetic energy and the range of the potential energy, which
        do not change with where potential energy is zero. It tells of integration errors where nothing drives or damps.
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
        """How far loops were open at most, in parts of their characteristic lengths, or rad; None without loops."""
        return None if self.closure is None else float(np.max(self.closure, initial=0.0))

    def lines(self) -> list[str]:
        """What `repr` says, line by line."""
        interval = f" from {self.t[0]:.6g} to {self.t[-1]:.6g} s" if len(self) else ""
        holds = [
            _counted(len(names), noun)
            for noun, names in (
                ("coordinate", self.coordinate_names),
                ("speed", self.speed_names),
                ("output", self.output_names),
            )
            if names or noun != "output"
        ]
        if self.sensitivity_names:
            holds.append(f"derivatives by {some(self.sensitivity_names)}")
        lines = [f"Trajectory of {self.model}: {_counted(len(self), 'time')}{interval}", f"  {', '.join(holds)}"]
        counts = [f"{self.stats[word]} {word}" for word in ("steps", "evaluations") if word in self.stats]
        if "seconds" in self.stats:
            counts.append(f"{self.stats['seconds']:.3g} s")
        method = f"{self.stats['method']}: " if "method" in self.stats else ""
        lines.append(f"  {method}{', '.join([*counts, f'ended: {self.ended}'])}")
        drifts = {"total energy changes by": self.energy_drift, "loops are open by": self.closure_drift}
        if told := [f"{words} {x:.2g} at most" for words, x in drifts.items() if x is not None]:
            lines.append(f"  {', '.join(told)}")
        return lines

    def __repr__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        from .html import as_html

        shown = self.output_names or self.names
        return as_html(self.lines(), self.t, [(name, self.unit(name), self[name]) for name in shown])

    # -- elsewhere ---------------------------------------------------------------------------------------------------------

    def columns(self) -> dict[str, Array]:
        """All series by the names that they have in a table: q.NAME, u.NAME, outputs, then d(NAME)/d(SENSITIVITY)."""
        found = {name: self[name] for name in self.names}
        for by in self.sensitivity_names:
            found |= {f"d({name})/d({by})": self.derivative(name, by) for name in self.names}
        return found

    def to_dataframe(self) -> Any:
        """A table of pandas's: the index t, s, and a column for each of `columns`."""
        from .table import dataframe

        return dataframe(self.t, self.columns())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything into a file, as a whole or not at all: ``.npz`` (NumPy's), or ``.parquet`` (needs pyarrow).

        `load` gives the same trajectory, bit for bit.
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
        """Read what `save` wrote.

        Raises
        ------
        TrajectoryFileError
            A ValueError: another kind of file, or a damaged one.
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
        """Curves over time, a panel for each series, with its derivatives beside it; matplotlib's figure is returned.

        Parameters
        ----------
        what : str or sequence of str, optional
            Names of series; left out: the outputs, or the coordinates where there are none.
        path : path, optional
            Where to write it: ``.svg``, ``.png`` or ``.pdf``. The same trajectory gives the same bytes.
        sensitivities : str or sequence of str, optional
            Whose derivatives are shown; left out: all, ``()``: none.
        """
        from .plot import draw

        whole = self.output_names or tuple(f"q.{name}" for name in self.coordinate_names)
        names = whole if what is None else (what,) if isinstance(what, str) else tuple(what)
        if sensitivities is None:
            by: Sequence[str | int] = self.sensitivity_names
        else:
            by = (sensitivities,) if isinstance(sensitivities, str) else tuple(sensitivities)
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


ARRAYS = ("t", "q", "u", "dq", "du", "outputs", "doutputs", "p", "inputs", "energy", "closure")
"""What a file holds as arrays."""

WORDS = (
    "model", "coordinate_names", "speed_names", "output_names", "parameter_names", "input_names", "sensitivity_names",
    "coordinate_units", "speed_units", "output_units", "parameter_units", "stats",
)  # fmt: skip
"""And as text."""


PLAIN = (str, bool, int, float)
"""Types that JSON gives back as they are."""


def _shaped(name: str, value: ArrayLike | None, shape: Shape, may_lack: bool = False) -> Array:
    """An array of floats of that shape."""
    if value is None:
        if may_lack:
            return np.zeros(shape)
        raise ValueError(f"{name} is left out, expected shape {shape}")
    found = np.asarray(value, dtype=np.float64)
    if found.shape != shape:
        raise ValueError(f"{name} has shape {found.shape}, expected {shape}")
    return found


@lru_cache(64)
def _index_of(coordinates: tuple[str, ...], speeds: tuple[str, ...], outputs: tuple[str, ...]) -> Mapping[str, int]:
    """Where series stand, by name: looked up once a model, not once a motion."""
    names = [*(f"q.{name}" for name in coordinates), *(f"u.{name}" for name in speeds), *outputs]
    index = {name: i for i, name in enumerate(names)}
    if len(index) < len(names) or "t" in index:
        raise ValueError(f"names of series must differ, and from t: {some(names)}")
    return index


def _units(of: str, units: Sequence[str], n: int) -> tuple[str, ...]:
    found = tuple(units) or ("",) * n
    if len(found) != n:
        raise ValueError(f"there are {len(found)} {of} units, expected {n}, one for each name, or none at all")
    return found


def _plain(where: str, value: Any) -> Any:
    """What JSON can hold and gives back alike: NumPy's numbers become Python's, arrays and tuples lists."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(f"{where}[{key!r}]", x) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(where, x) for x in value]
    if value is None or isinstance(value, PLAIN):
        return value
    raise ValueError(f"{where} is {value!r}; text, numbers, lists and mappings of these are allowed")


def _counted(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
