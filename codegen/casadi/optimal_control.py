"""Optimal control: direct collocation at Gauss-Legendre points, design parameters among the variables, solved by IPOPT."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..runtime.standalone.arrays import Array, Numbers
from ..wording import nearest
from .bridged import BridgeError
from .functions import imported, needs_second, ode
from .optimum import NotSolvedError, Optimum

if TYPE_CHECKING:
    from ..runtime import Solver

Named = Mapping[str, Any]
Bounds = Mapping[str, tuple[float, float]]
HESSIANS = ("exact", "limited-memory")


class _Variable(NamedTuple):
    """A matrix of variables: its shape, the bounds and the guess of each entry, and the unit of each row."""

    shape: tuple[int, ...]
    low: Array
    high: Array
    guess: Array
    scale: Array


class Collocation:
    """A problem of optimal control, made by `collocation`.

    Attributes
    ----------
    nlp : dict
        Variables x, parameters p, objective f and constraints g, as `casadi.nlpsol` takes them.
    names : tuple of str
        Names of the state's entries.

    Examples
    --------
    >>> import ordernm.casadi
    >>> problem = ordernm.casadi.collocation(solver, 1.0, 2, start={"q.upper": 0.1})
    >>> problem.names
    ('q.upper', 'q.lower', 'u.upper', 'u.lower')
    """

    def __init__(
        self,
        solver: Solver,
        duration: float | tuple[float, float],
        segments: int,
        degree: int,
        cost: Callable[[Named], Any] | None,
        end_cost: Callable[[Named], Any] | None,
        path: Callable[[Named], Any] | None,
        start: Named,
        end: Named,
        bounds: Bounds,
        design: Bounds,
        p: Numbers,
    ):
        self.solver, self.segments, self.degree = solver, segments, degree
        self.names = (
            *(f"q.{n}" for n in solver.independent_names), *(f"u.{n}" for n in solver.independent_speed_names),
        )  # fmt: skip
        self.input_names = tuple(f"inputs.{n}" for n in solver.input_names)
        self._check(duration, segments, degree, start, end, bounds, design)
        self._p = _parameters(solver, p)
        self._design = [solver.parameter_names.index(n) for n in design]
        self._fixed = [i for i in range(solver.np) if i not in self._design]
        self._f = self._motion()
        self._variables = self._declared(duration, start, end, bounds, design)
        self.nlp = self._stated(duration, cost, end_cost, path)

    def _motion(self) -> Any:
        """The function ``y' = f(y, p, inputs, t)``."""
        return ode(self.solver)

    def _check(
        self, duration: Any, segments: int, degree: int, start: Named, end: Named, bounds: Named, design: Named
    ) -> None:
        """Raise an error that describes the first wrong argument."""
        for what, number, most in (("segments", segments, 10**6), ("degree", degree, 9)):
            if not isinstance(number, (int, np.integer)) or not 1 <= number <= most:
                raise BridgeError(f"{what} is {number!r}, expected a whole number from 1 to {most}")
        times = duration if isinstance(duration, tuple) else (duration, duration)
        if len(times) != 2 or not 0 < times[0] <= times[1] < np.inf:
            raise BridgeError(
                f"duration is {duration!r}, expected seconds above 0, or (least, most) for a free duration"
            )
        _known("start", start, self.names)
        _known("end", end, self.names)
        _known("bounds", bounds, (*self.names, *self.input_names))
        _known("design", design, self.solver.parameter_names)
        for what, given in (("bounds", bounds), ("design", design)):
            for name, pair in given.items():
                if not isinstance(pair, tuple) or len(pair) != 2 or not pair[0] <= pair[1]:
                    raise BridgeError(f"{what}[{name!r}] is {pair!r}, expected (least, greatest)")

    def _declared(
        self, duration: Any, start: Named, end: Named, bounds: Bounds, design: Bounds
    ) -> dict[str, _Variable]:
        """Bounds, guesses and units of all variables."""
        n, points = len(self.names), self.segments * self.degree
        initial = dict(zip(self.names, _initial(self.solver), strict=True))
        first = np.array([start.get(x, initial[x]) for x in self.names], float)
        last = np.array([end.get(x, start.get(x, initial[x])) for x in self.names], float)
        low, high = np.array([bounds.get(x, (-np.inf, np.inf)) for x in self.names], float).reshape(n, 2).T
        at, tau = np.arange(self.segments + 1) / self.segments, self._tau()
        inner = ((np.arange(self.segments)[:, None] + tau) / self.segments).ravel()
        ends = _repeated(low, len(at)), _repeated(high, len(at))
        for column, given in ((0, start), (-1, end)):
            for i, name in enumerate(self.names):
                if name in given:
                    ends[0][i, column] = ends[1][i, column] = given[name]
        unit = _unit(np.stack([first, last, low, high]))
        inputs = np.array([bounds.get(x, (-np.inf, np.inf)) for x in self.input_names], float).reshape(-1, 2).T
        chosen = np.array(list(design.values()), float).reshape(-1, 2).T
        times = np.array(duration if isinstance(duration, tuple) else (duration, duration), float)
        inner_low, inner_high = _repeated(low, points), _repeated(high, points)
        least, most = (_repeated(x, points) for x in inputs)
        chosen_low, chosen_high = chosen[:, :, None]
        p = self._p[self._design]
        return {
            "ends": _Variable((n, len(at)), ends[0], ends[1], _line(first, last, at), unit),
            "points": _Variable((n, points), inner_low, inner_high, _line(first, last, inner), unit),
            "inputs": _Variable(least.shape, least, most, np.clip(np.zeros_like(least), least, most), _unit(inputs)),
            "design": _Variable(
                chosen_low.shape,
                chosen_low,
                chosen_high,
                np.clip(p[:, None], chosen_low, chosen_high),
                _unit(p[None], 0.0),
            ),
            "duration": _Variable((1, 1), times[:1, None], times[1:, None], np.full((1, 1), times.mean()), times[1:]),
        }

    def _tau(self) -> Array:
        return np.array(imported().collocation_points(self.degree, "legendre"))

    def _stated(self, duration: Any, cost: Any, end_cost: Any, path: Any) -> dict[str, Any]:
        """The nonlinear program, on variables divided by their units."""
        casadi, n, d = imported(), len(self.names), self.degree
        sizes = [int(np.prod(v.shape)) for v in self._variables.values()]
        x = casadi.MX.sym("x", sum(sizes))
        parts = casadi.vertsplit(x, np.cumsum([0, *sizes]).tolist())
        of = {
            name: casadi.reshape(part, *v.shape) * casadi.repmat(casadi.DM(v.scale), 1, v.shape[1])
            for (name, v), part in zip(self._variables.items(), parts, strict=True)
        }
        fixed = casadi.MX.sym("p", len(self._fixed))
        every = casadi.vertcat(of["design"], fixed)
        order = [*self._design, *self._fixed]
        p = every[[order.index(i) for i in range(self.solver.np)]] if order else every
        h = of["duration"] / self.segments
        t = h * casadi.DM((np.arange(self.segments)[:, None] + self._tau()).reshape(1, -1))
        given = {"y": of["points"], "inputs": of["inputs"], "p": casadi.repmat(p, 1, self.segments * d), "t": t}
        rates = self._f.map(self.segments * d)(*(given[a] for a in self._f.name_in()))
        C, D, B = casadi.collocation_coeff(self._tau().tolist())
        defects, objective = [], 0.0
        unit = casadi.DM(self._variables["ends"].scale)
        for k in range(self.segments):
            states = casadi.horzcat(of["ends"][:, k], of["points"][:, k * d : (k + 1) * d])
            slope = casadi.mtimes(states, C) - h * rates[:, k * d : (k + 1) * d]
            jump = of["ends"][:, k + 1] - casadi.mtimes(states, D)
            defects.append(casadi.vec(casadi.horzcat(slope, jump) / casadi.repmat(unit, 1, d + 1)))
        if cost is not None:
            integrand = self._at_points(cost, of, p, t)
            objective = h * casadi.dot(casadi.repmat(B, self.segments, 1), casadi.vec(integrand))
        if end_cost is not None:
            last = {"y": of["ends"][:, -1], "p": p, "t": of["duration"], "inputs": of["inputs"][:, -1]}
            objective = objective + end_cost(self._view(last))
        limits = self._at_points(path, of, p, t) if path is not None else casadi.MX(0, 1)
        self._equations = n * (d + 1) * self.segments
        return {"x": x, "p": fixed, "f": objective, "g": casadi.vertcat(*defects, casadi.vec(limits))}

    def _at_points(self, given: Callable[[Named], Any], of: Named, p: Any, t: Any) -> Any:
        """A user's function at all points, one column for each."""
        casadi = imported()
        sizes = {"y": len(self.names), "inputs": len(self.input_names), "p": self.solver.np, "t": 1}
        at = {n: casadi.MX.sym(n, k) for n, k in sizes.items()}
        value = given(self._view(at))
        value = casadi.vertcat(*value) if isinstance(value, (list, tuple)) else value
        points = self.segments * self.degree
        f = casadi.Function("at_points", list(at.values()), [value])
        return f.map(points)(of["points"], of["inputs"], casadi.repmat(p, 1, points), t)

    def _view(self, at: Named) -> dict[str, Any]:
        """The variables of a user's function, by name: vectors q, u, inputs, p, y and t, and their entries."""
        k = len(self.solver.independent_names)
        found = dict(at) | {"q": at["y"][:k], "u": at["y"][k:]}
        found |= {n: at["y"][i] for i, n in enumerate(self.names)}
        found |= {n: at["inputs"][i] for i, n in enumerate(self.input_names)}
        return found | {f"p.{n}": at["p"][i] for i, n in enumerate(self.solver.parameter_names)}

    def solve(
        self,
        *,
        hessian: str = "exact",
        guess: Optimum | None = None,
        tolerance: float = 1e-10,
        most_iterations: int = 1000,
        options: Named | None = None,
    ) -> Optimum:
        """Return the optimum that IPOPT finds.

        Parameters
        ----------
        hessian : {"exact", "limited-memory"}, optional
            Exact second derivatives, or the quasi-Newton approximation of IPOPT.
        guess : Optimum, optional
            Start of the search: an optimum of a problem of the same model. Default: straight lines from start to end.
        tolerance : float, optional
            IPOPT's `tol`.
        most_iterations : int, optional
            Largest number of iterations.
        options : mapping, optional
            Further options of IPOPT, such as ``{"print_level": 5}``.

        Returns
        -------
        Optimum
            The solution, and derivatives of its value with respect to the parameters that are not variables.

        Raises
        ------
        BridgeError
            If `hessian` is "exact", and the solver has no second derivatives.
        NotSolvedError
            If IPOPT does not find an optimum.

        Examples
        --------
        >>> import ordernm.casadi
        >>> problem = ordernm.casadi.collocation(
        ...     solver, 0.2, 2, cost=lambda x: x["u.lower"] ** 2, start={"q.upper": 0.1, "q.lower": 0.2, "u.upper": 0.0}
        ... )
        >>> problem.solve(hessian="limited-memory", tolerance=1e-6).value < 1.0
        True
        """
        return self._solved(self._nlp(hessian, tolerance, most_iterations, options or {}), self._given(guess))

    def prepared(self, **settings: Any) -> Callable[[], Optimum]:
        """Return a function that solves the problem. CasADi forms the derivatives now, once for all calls of it.

        Parameters
        ----------
        **settings : dict
            Keyword arguments of `solve`.

        Returns
        -------
        callable
            Without arguments; it returns the Optimum.

        Raises
        ------
        BridgeError
            As in `solve`.

        Examples
        --------
        >>> import ordernm.casadi
        >>> problem = ordernm.casadi.collocation(solver, 0.2, 2, start={"q.upper": 0.1, "q.lower": 0.2})
        >>> callable(problem.prepared(hessian="limited-memory"))
        True
        """
        guess = self._given(settings.pop("guess", None))
        every = {n: x.default for n, x in inspect.signature(self.solve).parameters.items() if n != "guess"}
        unknown = settings.keys() - every.keys()
        if unknown:
            raise TypeError(
                f"{sorted(unknown)[0]!r} is not an argument of solve, which takes guess, {', '.join(every)}"
            )
        given = every | settings
        nlp = self._nlp(given["hessian"], given["tolerance"], given["most_iterations"], given["options"] or {})
        return lambda: self._solved(nlp, guess)

    def _nlp(self, hessian: str, tolerance: float, most_iterations: int, options: Named) -> Any:
        """IPOPT with the problem and its derivatives."""
        if hessian not in HESSIANS:
            raise BridgeError(f"hessian is {hessian!r}; allowed are {' and '.join(map(repr, HESSIANS))}")
        if hessian == "exact":
            needs_second(self.solver, "accelerations", "hessian='exact'")
            if self.solver._opened.manifest["quaternions"]:  # their rates are products of quaternions and speeds
                needs_second(self.solver, "coordinate_rates", "hessian='exact'")
        more = {
            "tol": tolerance, "max_iter": most_iterations, "print_level": 0, "sb": "yes", "hessian_approximation": hessian,
            **options,
        }  # fmt: skip
        settings = {"ipopt": more, "print_time": False, "error_on_fail": False}
        return imported().nlpsol("optimum", "ipopt", self.nlp, settings)

    def _given(self, guess: Optimum | None) -> dict[str, Array]:
        """Guess, bounds and parameters of the nonlinear program."""
        low, high, first = (
            np.concatenate([getattr(v, n).ravel("F") / _every(v) for v in self._variables.values()])
            for n in ("low", "high", "guess")
        )
        limits = np.zeros(self.nlp["g"].shape[0])
        least = limits.copy()
        least[self._equations :] = -np.inf
        first = first if guess is None else self._from(guess)
        return {"x0": first, "lbx": low, "ubx": high, "lbg": least, "ubg": limits, "p": self._p[self._fixed]}

    def _solved(self, nlp: Any, given: Named) -> Optimum:
        """Calls IPOPT.

        Raises
        ------
        NotSolvedError
        """
        began = time.perf_counter()
        found = nlp(**given)
        optimum = self._optimum(found, nlp.stats(), time.perf_counter() - began)
        if not nlp.stats()["success"]:
            raise NotSolvedError(
                f"IPOPT stopped with {optimum.status} after {optimum.iterations} iterations; give another guess, more "
                f"segments, or options={{'print_level': 5}} to see why",
                optimum,
            )
        return optimum

    def _from(self, guess: Optimum) -> Array:
        """Values of all variables from another solution, at the same fractions of the duration."""
        if guess.y.shape[1:] != (len(self.names),) or guess.p.shape != self._p.shape:
            raise BridgeError(
                f"guess has {guess.y.shape[1]} states and {guess.p.size} parameters, expected {len(self.names)} and "
                f"{self.solver.np}: an optimum of this model"
            )
        ends = np.arange(self.segments + 1) / self.segments
        points = ((np.arange(self.segments)[:, None] + self._tau()) / self.segments).ravel()
        t, at = guess.t / guess.duration, guess.input_times / guess.duration
        of = {
            "ends": np.array([np.interp(ends, t, y) for y in guess.y.T]),
            "points": np.array([np.interp(points, t, y) for y in guess.y.T]),
            "inputs": np.array([np.interp(points, at, x) for x in guess.inputs.T]).reshape(
                self._variables["inputs"].shape
            ),
            "design": guess.p[self._design][:, None],
            "duration": np.array([[guess.duration]]),
        }
        return np.concatenate([of[n].ravel("F") / _every(v) for n, v in self._variables.items()])

    def _optimum(self, found: Named, stats: Named, seconds: float) -> Optimum:
        """The solution in the user's units."""
        x = np.array(found["x"]).ravel()
        of, at = {}, 0
        for name, v in self._variables.items():
            n = int(np.prod(v.shape))
            of[name] = x[at : at + n].reshape(v.shape, order="F") * v.scale[:, None]
            at += n
        duration = float(of["duration"][0, 0])
        ends = np.arange(self.segments + 1) * duration / self.segments
        inner = ((np.arange(self.segments)[:, None] + self._tau()) * duration / self.segments).ravel()
        t = np.concatenate([ends, inner])
        order = np.argsort(t, kind="stable")
        p = self._p.copy()
        p[self._design] = of["design"][:, 0]
        names, gradients = self.solver.parameter_names, -np.array(found["lam_p"]).ravel()
        return Optimum(
            float(found["f"]), duration, t[order], np.concatenate([of["ends"], of["points"]], axis=1).T[order], inner,
            of["inputs"].T, p, {names[i]: float(p[i]) for i in self._design},
            {names[i]: float(g) for i, g in zip(self._fixed, gradients, strict=True)},
            int(stats["iter_count"]), seconds, str(stats["return_status"]),
        )  # fmt: skip


def collocation(
    solver: Solver,
    duration: float | tuple[float, float],
    segments: int,
    *,
    degree: int = 4,
    cost: Callable[[Named], Any] | None = None,
    end_cost: Callable[[Named], Any] | None = None,
    path: Callable[[Named], Any] | None = None,
    start: Named | None = None,
    end: Named | None = None,
    bounds: Bounds | None = None,
    design: Bounds | None = None,
    p: Numbers = None,
) -> Collocation:
    """State a problem of optimal control for direct collocation.

    In each of the equal segments, the state is a polynomial whose derivative satisfies the equations of motion at the
    Gauss-Legendre points. The inputs at these points, the design parameters and a free duration are variables, too.

    Parameters
    ----------
    solver : Solver
        An open package. With `hessian_products` among its functions, second derivatives are exact.
    duration : float or (float, float)
        Duration, s, or its bounds if it is free.
    segments : int
        Number of segments.
    degree : int, optional
        Number of points in each segment, at most 9.
    cost : callable, optional
        The integrand of the objective. It takes a dict of CasADi's expressions: vectors ``q``, ``u``, ``inputs``, ``p``, and
        entries such as ``q.crank``, ``u.crank``, ``inputs.motor`` and ``p.length``.
    end_cost : callable, optional
        A function of the last state and of the last inputs, which is added to the objective.
    path : callable, optional
        Returns expressions that must not exceed zero at any point.
    start, end : mapping of str to float, optional
        Values of entries of the state, such as ``{"q.crank": 0.8}``; others are free.
    bounds : mapping of str to (float, float), optional
        Bounds of states and inputs.
    design : mapping of str to (float, float), optional
        Parameters that are variables, with their bounds.
    p : array_like or mapping, optional
        Values of all parameters. Default: the default parameters.

    Returns
    -------
    Collocation
        The problem; its method `solve` calls IPOPT.

    Raises
    ------
    BridgeError
        A ValueError, if a name is unknown or an argument is wrong.
    ImportError
        If CasADi is missing.

    Examples
    --------
    >>> import ordernm.casadi
    >>> problem = ordernm.casadi.collocation(solver, (0.5, 2.0), 4, start={"q.upper": 0.1}, design={"length_1": (0.5, 2.0)})
    >>> problem.nlp["g"].shape  # 4 segments of 4 points with a continuity condition, 4 states
    (80, 1)
    """
    # long: the docstring describes every argument
    return Collocation(
        solver, duration, segments, degree, cost, end_cost, path, start or {}, end or {}, bounds or {}, design or {}, p
    )


def _known(what: str, given: Iterable[str], allowed: Iterable[str]) -> None:
    names = tuple(allowed)
    for name in given:
        if name not in names:
            raise BridgeError(
                f"{what} has the unknown name {name!r}; allowed are {', '.join(names) or 'none'}{nearest(name, names)}"
            )


def _parameters(solver: Solver, p: Numbers) -> Array:
    """All parameters; those that a mapping leaves out have their defaults."""
    if p is None or not solver.np:
        return solver.parameters
    found = solver._arguments.array("p", p, "p", solver.parameters)
    if found.ndim != 1:
        raise BridgeError(f"p has shape {found.shape}, expected one set of parameters, ({solver.np},)")
    return found.copy()


def _initial(solver: Solver) -> Array:
    """The independent coordinates and speeds of the model's initial state."""
    q, u = solver.initial
    own = [solver.coordinate_names.index(n) for n in solver.independent_names]
    return np.concatenate([q[own], u[[solver.speed_names.index(n) for n in solver.independent_speed_names]]])


def _repeated(of: Array, n: int) -> Array:
    return np.repeat(np.asarray(of, float)[:, None], n, axis=1)


def _line(first: Array, last: Array, at: Array) -> Array:
    return first[:, None] + (last - first)[:, None] * at


def _unit(values: Array, least: float = 1.0) -> Array:
    """The largest finite magnitude in each column, at least `least`; 1 for zero."""
    largest = np.where(np.isfinite(values), np.abs(values), 0.0).max(axis=0, initial=least)
    return np.where(largest > 0.0, largest, 1.0)


def _every(v: _Variable) -> Array:
    """The unit of each entry, column by column."""
    return np.tile(v.scale, v.shape[1])


__all__ = ["Collocation", "NotSolvedError", "Optimum", "collocation"]
