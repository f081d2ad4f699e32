"""First-order equations ``y' = f(t, y)`` on the independent coordinates and speeds, for integrators of other libraries."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array, Numbers
from ..assembly.states import States
from ..calls.package import Package, state
from ..calls.room import alone
from .signals import take_inputs

SPLINES = ("BSpline", "PPoly")
"""Classes of SciPy whose objects are callable, but are signals with known derivatives."""


class Closed(NamedTuple):
    """One or several states of the whole mechanism, in the order of a solver's arguments."""

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Any


class Ode:
    """The equations of motion as ``y' = f(t, y)``, with y (n,) the independent coordinates, then the independent speeds.

    `Solver.ode` returns it. It is called as ``ode(t, y)``, as SciPy's `solve_ivp` calls its first argument. The dependent
    entries of a mechanism with loops follow from closure: the mechanism is followed from the initial state or from the last
    computed one, whichever is nearer, so it stays on its branch.

    Attributes
    ----------
    initial : ndarray (n,)
        The initial y.
    names : tuple of str
        Names of the entries of y: ``q.crank``, ``u.crank``.

    Examples
    --------
    >>> ode = solver.ode()
    >>> ode(0.0, ode.initial).shape
    (4,)
    """

    def __init__(self, package: Package, states: States, q: Numbers, u: Numbers, p: Numbers, inputs: Any, t: float):
        package._needs_all("ode")
        self._package, self._states = package, states
        self._inputs = _over_time(package, inputs)
        if q is None and u is None and not package.prescribed_names:
            q, u = states.initial_state(p)
        q, u = states.assemble(q, u, p, self._inputs(t), t)
        arrays, batch = package._arguments.take(state(q, u, p, None, t), package._left_out)
        alone(batch)
        self._known, self._p = (q, q), arrays["p"].copy()
        own = package.independent_names, package.independent_speed_names
        self._q = [package.coordinate_names.index(name) for name in own[0]]
        self._u = [package.speed_names.index(name) for name in own[1]]
        self.names = (*(f"q.{name}" for name in own[0]), *(f"u.{name}" for name in own[1]))
        self.initial = np.concatenate([q[self._q], u[self._u]])
        self._follows = len(self._q) < package.nq or len(self._u) < package.nu
        self._opened = package._opened

    def __repr__(self) -> str:
        return f"<Ode of {self._package.name}: y' = f(t, y), y = ({', '.join(self.names)})>"

    def __call__(self, t: float, y: Array) -> Array:
        """Return y' at a time and state; several states, y (n, k), are computed in one call.

        Parameters
        ----------
        t : float
            Time, s.
        y : array_like (n,) or (n, k)
            Independent coordinates and speeds.

        Returns
        -------
        ndarray (n,) or (n, k)
            Rates of the coordinates, then accelerations.

        Raises
        ------
        AssemblyError
            If the loops cannot be closed.
        """
        at = self._closed(t, y)
        rates, udot = self._package._call("coordinate_rates", at)[0], self._package._call("accelerations", at)[0]
        return np.concatenate([rates[..., self._q].T, udot[..., self._u].T])

    def jacobian(self, t: float, y: Array) -> Array:
        """Return the derivative of y' with respect to y, exact to rounding, with the loops staying closed.

        Parameters
        ----------
        t : float
            Time, s.
        y : array_like (n,)
            Independent coordinates and speeds.

        Returns
        -------
        ndarray (n, n)
            Row i holds the derivatives of ``y'[i]``.

        Examples
        --------
        >>> ode = solver.ode()
        >>> ode.jacobian(0.0, ode.initial).shape
        (4, 4)
        """
        dq, du = np.zeros((len(self.names), self._package.nq)), np.zeros((len(self.names), self._package.nu))
        k = len(self._q)
        dq[np.arange(k), self._q] = 1.0
        du[np.arange(k, len(du)), self._u] = 1.0
        at = self._closed(t, y)
        if self._follows and at.q.ndim == 1:  # the length of a quaternion in y has no influence on the assembled one
            dq, du = self._states.assemble_sensitivities(
                (self._whole(np.asarray(y, float), at.q), *at[1:]), (dq, du, None, None, None)
            )[2:]
        return self._along(at, (dq, du, None, None, None))

    def parameter_jacobian(self, t: float, y: Array) -> Array:
        """Return the derivative of y' with respect to the design parameters at constant y.

        Parameters
        ----------
        t : float
            Time, s.
        y : array_like (n,)
            Independent coordinates and speeds.

        Returns
        -------
        ndarray (n, np)
            One column for each parameter, in the order of `Solver.parameter_names`.

        Examples
        --------
        >>> ode = solver.ode()
        >>> ode.parameter_jacobian(0.0, ode.initial).shape
        (4, 6)
        """
        return self._along(self._closed(t, y), (None, None, np.eye(self._package.np), None, None))

    def state(self, t: Numbers, y: Array) -> tuple[Array, Array]:
        """Return the whole state of the mechanism, with its loops closed.

        Parameters
        ----------
        t : float or array_like (k,)
            Times, s.
        y : array_like (n,) or (n, k)
            Independent coordinates and speeds; with k columns, successive states of a motion, such as `y` of a result of
            `solve_ivp`.

        Returns
        -------
        q : ndarray (nq,) or (k, nq)
            Coordinates.
        u : ndarray (nu,) or (k, nu)
            Speeds.

        Examples
        --------
        >>> ode = four_bar.ode()
        >>> q, u = ode.state(0.0, ode.initial)
        >>> q.round(4)
        array([ 0.8   , -0.2918, -2.334 ])
        """
        return self._closed(t, y)[:2]

    # -- how -----------------------------------------------------------------------------------------------------------

    def _closed(self, t: Any, y: Array) -> Closed:
        y = np.asarray(y, float)
        if y.ndim not in (1, 2) or len(y) != len(self.names):
            raise ValueError(f"y has shape {y.shape}, expected ({len(self.names)},): {', '.join(self.names[:6])}")
        if self._package._opened is not self._opened:
            raise ValueError("the partition was changed after ode; call ode again, or change it back")
        inputs, own = self._inputs(t), y[: len(self._q)].T
        q = np.empty((*own.shape[:-1], self._package.nq))
        u = np.zeros((*own.shape[:-1], self._package.nu))
        if self._follows and q.size:
            first = own if own.ndim == 1 else own[0]
            q[...] = min(self._known, key=lambda known: float(np.abs(known[self._q] - first).max(initial=0.0)))
        q, u[..., self._u] = self._whole(y, q), y[len(self._q) :].T
        if self._follows and q.size:
            q, u = self._states.assemble(q, u, self._p, inputs, t, True if own.ndim > 1 else None)
            self._known = self._known[0], q.reshape(-1, self._package.nq)[-1].copy()
        return Closed(q, u, self._p, inputs, t)

    def _whole(self, y: Array, q: Array) -> Array:
        """All coordinates: the independent ones from y, all others from q."""
        found = q.copy()
        found[..., self._q] = y[: len(self._q)].T
        return found

    def _along(self, at: Closed, seeds: tuple[Any, ...]) -> Array:
        if at.q.ndim > 1:
            raise ValueError("y is a batch of states, expected one state; call the method once per state")
        rates = self._package._call("coordinate_rate_sensitivities", at, seeds)[1]
        udot = self._package._call("sensitivities", at, seeds)[1]
        return np.concatenate([rates[:, self._q].T, udot[:, self._u].T])


def _over_time(package: Package, given: Any) -> Callable[[Any], Array]:
    """The model's inputs as a function of time, from a user's inputs.

    Raises
    ------
    ValueError
        If prescribed motion reads a signal that is a function: its derivatives are unknown.
    """
    if callable(given) and {c.__name__ for c in type(given).__mro__}.isdisjoint(SPLINES):
        if package.moving_inputs:
            raise ValueError(
                f"inputs is a function of time, but prescribed motion reads {package.moving_inputs[0]!r} and its time "
                f"derivatives; give (times, values, 'cubic') or a spline of SciPy"
            )

        def values(t: Any) -> Array:
            rows = [
                package._arguments.take({"inputs": given(float(x))}, package._left_out)[0]["inputs"]
                for x in np.ravel(t)
            ]
            return np.reshape(rows, (*np.shape(t), package.ninputs))

        return values
    return take_inputs(package.signal_names, given, package.moving_inputs).at
