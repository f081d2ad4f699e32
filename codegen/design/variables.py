"""Variables of an optimisation or fit as numbers of order one: parameters, initial values and inputs of a motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.standalone.arrays import Array, Numbers
from ..runtime.standalone.calls.arguments import some
from ..runtime.standalone.calls.named_entries import Entry, apart, look_up_all, names_of
from ..runtime.standalone.motion.signals import Interval, take_inputs


@dataclass(frozen=True, eq=False)
class Variable:
    """Bounds, scale and start of a design variable.

    Attributes
    ----------
    lower, upper : float, or array_like (count,) for a whole input
        Bounds in the unit of the variable. None or an infinite number: no bound.
    scale : float, optional
        Size of a significant change. Default: half the distance of the bounds; without bounds, the size of the start,
        or 1 if that is zero.
    start : float, or array_like (count,), optional
        Start of the search. Default: the value in the given motion.

    Examples
    --------
    >>> start = ordernm.Variable(0.5, 1.5, start=0.9)
    >>> start.lower, start.upper
    (0.5, 1.5)
    """

    lower: ArrayLike | None = None
    upper: ArrayLike | None = None
    scale: float | None = None
    start: ArrayLike | None = None


Wanted = Sequence[str] | str | Mapping[str, Any]
"""Names, or a mapping from names to ``None``, ``(lower, upper)`` or a `Variable`."""


class Variables:
    """Variables of a motion as numbers of order one.

    An optimiser sees x = (value - origin)/scale; the values are in the model's units.

    Attributes
    ----------
    names : tuple of str
        Names. A whole input is listed as its values, ``inputs.NAME[0]`` and so on, a vector as its entries,
        ``hard_point.x`` and so on.
    start, lower, upper, origin, scale : ndarray (n,)
        Start, bounds, origin and scale, in the model's units.
    """

    def __init__(
        self,
        solver: Any,
        wanted: Wanted,
        q: Numbers = None,
        u: Numbers = None,
        p: Numbers = None,
        inputs: Any = None,
        interval: Interval | None = None,
    ):
        self.solver = solver
        self._p: Array = solver._arguments.take({"p": p}, solver._left_out)[0]["p"]
        if self._p.ndim != 1:
            raise ValueError(f"p has shape {self._p.shape}, expected ({solver.np},): one motion at a time")
        self._inputs = take_inputs(solver.signal_names, inputs, solver.moving_inputs, interval)
        self._q, self._u = (_by_name(n, x, names) for n, x, names in
                            (("q", q, solver.coordinate_names), ("u", u, solver.speed_names)))  # fmt: skip
        asked = _asked(wanted)
        groups = [self._expanded(name) for name in asked]
        self.names: tuple[str, ...] = tuple(n for g in groups for n in g)
        self._places = self._looked_up()
        self._begin = interval[0] if interval else 0.0
        begin = self._inputs.at(self._begin), self._begin
        self._start_state = solver.assemble(self._q or None, self._u or None, self._p, *begin)
        given = np.array([self._value(place) for place in self._places])
        n = len(self.names)
        self.start, self.lower, self.upper, self.scale = given, np.full(n, -np.inf), np.full(n, np.inf), np.ones(n)
        self.origin = np.zeros(n)
        first = 0
        for (name, v), group in zip(asked.items(), groups, strict=True):
            self._set(name, v, slice(first, first + len(group)))
            first += len(group)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def x0(self) -> Array:
        """The start as an optimiser sees it, (n,)."""
        return (self.start - self.origin) / self.scale

    @property
    def x_bounds(self) -> tuple[Array, Array]:
        """The lower and upper bounds as an optimiser sees them, (n,) each."""
        return (self.lower - self.origin) / self.scale, (self.upper - self.origin) / self.scale

    def values(self, x: ArrayLike) -> Array:
        """Return the values of an optimiser's x.

        Parameters
        ----------
        x : array_like (n,)
            Numbers of order one.

        Returns
        -------
        ndarray (n,)
            Values in the model's units.

        Raises
        ------
        ValueError
            If x has another shape, or numbers that are not finite.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> f.variables.values([0.5])
        array([1.25])
        """
        array = np.asarray(x, float)
        if array.shape != (len(self),):
            raise ValueError(
                f"x has shape {array.shape}, expected ({len(self)},): a number for each of {some(self.names)}"
            )
        if not np.isfinite(array).all():
            i = int(np.argmin(np.isfinite(array)))
            raise ValueError(f"x[{i}] ({self.names[i]}) is {array[i]}, expected finite numbers")
        return self.origin + self.scale * array

    def x(self, values: ArrayLike | Mapping[str, float]) -> Array:
        """Return an optimiser's x for given values.

        Parameters
        ----------
        values : array_like (n,), or mapping of str to float
            Values in the model's units. Values that a mapping leaves out are those of the start.

        Returns
        -------
        ndarray (n,)
            Numbers of order one.

        Raises
        ------
        ValueError
            If a name is unknown.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> f.variables.x({"length_1": 1.25})
        array([0.5])
        """
        if isinstance(values, Mapping):
            unknown = [n for n in values if n not in self.names]
            if unknown:
                raise ValueError(f"{unknown[0]!r} is not a variable; the variables are {some(self.names)}")
            values = [values.get(n, s) for n, s in zip(self.names, self.start, strict=True)]
        found: Array = (np.asarray(values, float) - self.origin) / self.scale
        return found

    def unit(self, i: int) -> str:
        """Return the unit of a variable.

        Parameters
        ----------
        i : int
            Index of the variable.

        Returns
        -------
        str
            The unit, ``""`` if unknown.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> f.variables.unit(0)
        'm'
        """
        kind, at, _ = self._places[i]
        word = {"p": "parameter", "q": "coordinate", "u": "speed"}.get(kind)
        units = self.solver._manifest.get(f"{word}_units", ()) if word else ()
        return units[at] if units else ""

    # -- the motion that belongs to an x -------------------------------------------------------------------------------

    def motion(self, x: ArrayLike, derivatives: bool = True) -> dict[str, Any]:
        """Return the arguments of the motion at an x.

        Parameters
        ----------
        x : array_like (n,)
            Numbers of order one.
        derivatives : bool, optional
            Include the derivatives dq0 and du0 of the initial state.

        Returns
        -------
        dict
            q, u, p and inputs of `Solver.simulate`, with dq0 and du0.

        Raises
        ------
        AssemblyError
            If the initial state cannot be closed.
        SingularLoopError
            If a loop has lost rank there.

        Examples
        --------
        >>> from ordernm.runtime import Final
        >>> f = ordernm.objective(solver, 1.0, Final("tip_x"), {"length_1": (0.5, 1.5)})
        >>> f.variables.motion([0.5])["p"]
        array([1.25, 0.8 , 1.5 , 1.  , 2.  , 0.05])
        """
        values, solver = self.values(x), self.solver
        p, inputs = self._p.copy(), dict[tuple[int, int], float]()
        q, u = dict(self._q), dict(self._u)
        for value, (kind, at, row) in zip(values, self._places, strict=True):
            match kind:
                case "p":
                    p[at] = value
                case "q":
                    q[solver.coordinate_names[at]] = value
                case "u":
                    u[solver.speed_names[at]] = value
                case _:
                    inputs[at, row or 0] = value
        spline = self._inputs.changed(inputs)
        if not q and not u:
            return {"q": None, "u": None, "p": p, "inputs": spline}
        begin = spline.at(self._begin), self._begin
        first_q, first_u = solver.assemble(q or None, u or None, p, *begin)
        found = {"q": first_q, "u": first_u, "p": p, "inputs": spline}
        if derivatives and self.names:
            found |= self._derivatives(first_q, first_u, p, begin, q, u)
        return found

    def _derivatives(
        self, q: Array, u: Array, p: Array, begin: tuple[Array, float], given_q: Iterable[str], given_u: Iterable[str]
    ) -> dict[str, Array]:
        """Derivatives of the initial state with respect to the variables, (n, nq) and (n, nu), including derivatives
        of the model's formulas."""
        solver, n = self.solver, len(self)
        dq, du, dp = np.zeros((n, solver.nq)), np.zeros((n, solver.nu)), np.zeros((n, solver.np))
        for i, (kind, at, _) in enumerate(self._places):
            if kind == "p":
                dp[i, at] = 1.0
        found = solver._states.first_sensitivities(p, dp)
        if found is not None:
            dq, du = (x.copy() for x in found)
            dq[:, [solver.coordinate_names.index(name) for name in given_q]] = 0.0
            du[:, [solver.speed_names.index(name) for name in given_u]] = 0.0
        for i, (kind, at, _) in enumerate(self._places):
            if kind in "qu":
                (dq if kind == "q" else du)[i, at] = 1.0
        _, _, dq, du = solver.assemble_sensitivities(q, u, p, *begin, dq=dq, du=du, dp=dp)
        return {"dq0": dq, "du0": du}

    # -- the names of the variables ------------------------------------------------------------------------------------

    def _expanded(self, name: str) -> list[str]:
        """Expand names: a whole input becomes its values, a vector its entries."""
        of = name.removeprefix("inputs.")
        if of != name and of in self.solver.signal_names:
            count = self._inputs.counts()[self.solver.signal_names.index(of)]
            return [f"{name}[{i}]" for i in range(count or 1)]
        return list(apart(names_of(self.solver), (name,)))

    def _looked_up(self) -> list[Entry]:
        """The places to which the names refer; an input has one value per name."""
        if not self.names:
            raise ValueError("there are no variables; name some, such as a parameter, q0.NAME or inputs.NAME")
        try:
            return look_up_all(names_of(self.solver), self.names, self._inputs.counts())
        except ValueError as error:
            raise ValueError(str(error).replace("sensitivities", "variables", 1)) from None

    def _value(self, place: Entry) -> float:
        """The value of a variable in the given motion."""
        if place.of == "inputs":
            return self._inputs.value(place.at, place.row or 0)
        return float({"p": self._p, "q": self._start_state[0], "u": self._start_state[1]}[place.of][place.at])

    def _set(self, name: str, v: Variable, at: slice) -> None:
        """Set bounds, scale and start of a variable, or of a whole input."""
        for word, place in (("lower", self.lower), ("upper", self.upper), ("start", self.start)):
            given = getattr(v, word)
            if given is None:
                continue
            try:
                place[at] = np.asarray(given, float)
            except (TypeError, ValueError):
                count = at.stop - at.start
                raise ValueError(f"variables: {word} of {name} is {given!r}, expected a number" +
                                 (f", or {count} of them" if count > 1 else "")) from None  # fmt: skip
            if np.isnan(place[at]).any():
                raise ValueError(f"variables: {word} of {name} is not a number")
            if word == "start" and np.isinf(place[at]).any():
                raise ValueError(f"variables: start of {name} is {given!r}, expected a finite number")
        lower, upper, start = self.lower[at], self.upper[at], self.start[at]
        if (lower >= upper).any():
            raise ValueError(
                f"variables: the bounds of {name} are {lower[0]:g} and {upper[0]:g}; the first must be smaller"
            )
        outside = (start < lower) | (start > upper)
        if outside.any():
            i = int(np.argmax(outside))
            raise ValueError(
                f"variables: {self.names[at.start + i]} starts at {start[i]:g}, outside of its bounds {lower[i]:g} and "
                f"{upper[i]:g}; give a start within them by Variable(lower, upper, start=...), or change the motion"
            )
        bounded = bool(np.isfinite(lower).all() and np.isfinite(upper).all())
        if bounded:
            self.origin[at] = (lower + upper) / 2
        if v.scale is not None:
            if not (isinstance(v.scale, (int, float, np.number)) and 0 < v.scale < np.inf):
                raise ValueError(f"variables: the scale of {name} is {v.scale!r}, expected a positive number")
            self.scale[at] = v.scale
        elif bounded:
            self.scale[at] = (upper - lower) / 2
        else:
            self.scale[at] = float(np.abs(start).max()) or 1.0


def _asked(wanted: Wanted) -> dict[str, Variable]:
    """The requested variables, by name."""
    if isinstance(wanted, str):
        return {wanted: Variable()}
    if not isinstance(wanted, Iterable):
        raise ValueError(f"variables are {wanted!r}, expected names, or a mapping of names to bounds")
    if not isinstance(wanted, Mapping):
        names = list(wanted)
        twice = [n for i, n in enumerate(names) if n in names[:i]]
        if twice:
            raise ValueError(f"variables name {twice[0]!r} twice")
        return {name: Variable() for name in names}
    found = {}
    for name, given in wanted.items():
        if given is None or isinstance(given, Variable):
            found[name] = given or Variable()
        elif isinstance(given, (tuple, list)) and len(given) == 2:
            found[name] = Variable(*given)
        else:
            raise ValueError(
                f"variables: {name} has {given!r}; allowed are None, (lower, upper) and Variable(lower, upper, scale=, start=)"
            )
    return found


def _by_name(label: str, given: Numbers, names: Sequence[str]) -> dict[str, float]:
    """A state by names; empty if nothing is given."""
    if given is None:
        return {}
    if isinstance(given, Mapping):
        return {str(n): float(np.asarray(x)) for n, x in given.items()}
    values = np.asarray(given, float)
    if values.shape != (len(names),):
        raise ValueError(f"{label} has shape {values.shape}, expected ({len(names)},): one motion at a time")
    return dict(zip(names, values.tolist(), strict=True))


__all__ = ["Variable", "Variables", "Wanted"]
