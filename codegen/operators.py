"""The functions of a solver that other libraries differentiate: their arguments, results and derivatives."""

from __future__ import annotations

import copy
import math
import threading
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .runtime.standalone.state.derivatives import CURVED
from .wording import nearest

STATE = ("q", "u", "p", "inputs", "t")


class Derived(NamedTuple):
    """The generated functions for the derivatives of a function; empty if there is none.

    Attributes
    ----------
    result : str
    along : str
        The derivative along seeds.
    against : str
        The gradient of weighted sums of results.
    weights : str
        The seed that holds these weights.
    curved : str
        The change of that gradient along seeds.
    curving : str
        The argument of `curved` that holds the weights.
    takes : tuple of str
        Arguments, in the order of the solver's method.
    """

    result: str
    along: str
    against: str = ""
    weights: str = ""
    curved: str = ""
    curving: str = ""
    takes: tuple[str, ...] = STATE


FUNCTIONS = {
    "accelerations": Derived("udot", "sensitivities", "sensitivities_transposed", "dudot"),
    "coordinate_rates": Derived(
        "qdot", "coordinate_rate_sensitivities", "coordinate_rate_sensitivities_transposed", "dqdot"
    ),
    "outputs": Derived("outputs", "output_sensitivities", "output_sensitivities_transposed", "doutputs"),
    "energies": Derived("energy", "energy_sensitivities", "energy_sensitivities_transposed", "denergy"),
    "inverse_dynamics": Derived(
        "force", "inverse_dynamics_sensitivities", takes=("q", "u", "udot", "p", "inputs", "t")
    ),
    "driving_forces": Derived("actuation", "driving_force_sensitivities"),
    "mass_matrix": Derived("M", "mass_matrix_sensitivities", takes=("q", "p", "inputs", "t")),
    "solve_mass": Derived("x", "solve_mass_sensitivities", takes=("q", "b", "p", "inputs", "t")),
}
FUNCTIONS |= {n: FUNCTIONS[n]._replace(curved=c.wanted.name, curving=c.weights) for n, c in CURVED.items()}
"""Functions that may be differentiated, by the name of the solver's method."""


class Operator:
    """A function of a solver, with the shapes of its arguments and result.

    Operators are compared by identity, so that compiled programs are kept; use `operator`.

    Attributes
    ----------
    solver : Solver
    opened : Opened
        The partition in use when the operator was made.
    name : str
    derived : Derived
    takes : tuple of str
        Arguments, in the order of the solver's method.
    six : tuple of str
        q, u, p, inputs, t and a further argument, which is empty where there is none.
    names : tuple of str
        Arguments with entries, in the order of `takes`.
    shape : tuple of int
        Shape of the result, after batch axes; `size` is its number of entries.
    """

    def __init__(self, solver: Any, name: str):
        self.solver, self.opened, self.name = solver, solver._opened, name
        self.derived = FUNCTIONS[name]
        shapes = solver._shapes
        self.takes = self.derived.takes
        self.six = (*STATE, next((n for n in self.takes if n not in STATE), ""))
        self.sizes = {n: math.prod(shapes[n]) for n in self.takes}
        self.names = tuple(n for n in self.takes if self.sizes[n])
        self.key: str | None = None
        self.composed = name in solver._composed and name not in self.opened.functions
        self.shape = self._shape()
        self.size = math.prod(self.shape)
        self.dtype = np.dtype(self.opened.target.dtype)
        self.nan = solver.bad_states == "nan"
        self._copy: Any = None
        self.tensors: Any = None  # defaults in PyTorch
        self.wanted: dict[int, Any] = {}  # selections of gradients in PyTorch
        q, u = solver.initial
        self.defaults = {
            "q": q, "u": u, "p": solver.parameters, "inputs": np.zeros(solver.ninputs), "t": np.zeros(1),
            "udot": np.zeros(solver.nu), "b": np.zeros(solver.nu),
        }  # fmt: skip
        self.entries: dict[str, Sequence[str]] = {
            "q": solver.coordinate_names, "u": solver.speed_names, "p": solver.parameter_names,
            "inputs": solver.input_names, "udot": solver.speed_names, "b": solver.speed_names,
        }  # fmt: skip

    def _shape(self) -> tuple[int, ...]:
        """Shape of the result of one state."""
        if not self.composed:
            return tuple(self.function(self.name).shapes[0])
        method = getattr(self.solver, self.name)  # composed in Python
        q, u = self.solver.initial
        given = {"q": q, "u": u, "udot": u * 0.0, "b": u * 0.0}
        return tuple(np.shape(method(*(given[n] for n in self.takes if n in given))))

    def function(self, name: str) -> Any:
        """A generated function. If the package lacks it, an error says how to generate it."""
        return self.solver._find(self.opened, name)

    @property
    def runs(self) -> Any:
        """The solver with the operator's partition and `bad_states`; a copy if these attributes of the solver have changed."""
        solver = self.solver
        if solver.partition == self.opened.number and (solver.bad_states == "nan") == self.nan:
            return solver
        if self._copy is None:
            made = copy.copy(solver)
            made.use_partition(self.opened.number)
            made.bad_states = "nan" if self.nan else "error"
            self._copy = made
        return self._copy

    def has(self, name: str) -> bool:
        """Whether the package has a generated function."""
        return bool(name) and name in self.opened.functions

    def index(self, argument: str, entry: Any) -> int:
        """The index of a named entry of an argument."""
        known = list(self.entries.get(argument, ()))
        if entry in known:
            return known.index(entry)
        hint = nearest(entry, known)
        raise ValueError(f"{self.name}: {argument} has no entry {entry!r}; it has {', '.join(known) or 'none'}{hint}")

    def no_curvature(self) -> str:
        """The message of the error that a second derivative raises if the package does not have it."""
        if not self.derived.curved:
            return (
                f"{self.name} of {self.solver.name}: no second derivatives; the functions that have them are "
                f"{', '.join(n for n, d in FUNCTIONS.items() if d.curved)}"
            )
        return f"second derivatives of {self.name}: {self.solver._why_not(self.derived.curved)}"

    def no_third(self) -> str:
        """The message of the error that a third derivative raises."""
        return f"{self.name} of {self.solver.name}: third derivatives do not exist; differentiate at most twice"


_making = threading.Lock()


def operator(solver: Any, name: str) -> Operator:
    """The operator of a solver's function, the same object each time.

    Raises
    ------
    TypeError
        If the first argument is not a solver.
    ValueError
        If no function of this name can be differentiated.
    AttributeError
        If the package was generated without the function.
    """
    if not hasattr(solver, "_opened") or not hasattr(solver, "accelerations"):
        raise TypeError(f"expected a solver, as ordernm.load returns it, not {type(solver).__name__}")
    if name not in FUNCTIONS:
        hint = nearest(name, FUNCTIONS)
        raise ValueError(
            f"{name!r} is not a function that can be differentiated; allowed are {', '.join(FUNCTIONS)}{hint}"
        )
    with _making:
        of_solver = solver.__dict__.setdefault("_operators", {})  # kept as long as the solver
        key = name, solver.partition, solver.bad_states
        if key not in of_solver:
            of_solver[key] = Operator(solver, name)
        return of_solver[key]


SCALARS = ("float32", "float64")
"""Types of numbers that packages have."""


def wrong_type(operator: Operator, name: str, found: str, shape: tuple[int, ...]) -> TypeError:
    """The error for an argument of another type."""
    other = f", or generate the package with scalar={found!r}" if found in SCALARS else ""
    return TypeError(
        f"{operator.name} of {operator.solver.name}: {name} has type {found} and shape {shape}, expected "
        f"{operator.dtype}; convert it{other}"
    )


def given_entry(of: Operator, name: str, entry: Any, x: Any) -> Any:
    """The value of an entry in a mapping; a TypeError if it is None or a mapping, which stand for whole arguments."""
    if x is None or isinstance(x, Mapping):
        raise TypeError(f"{of.name}: {name} has {x!r} for {entry!r}, expected a number or an array; leave out defaults")
    return x


def bound(of: Operator, arguments: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments by name; a TypeError names what is missing or unknown."""
    if len(arguments) > len(of.takes):
        raise TypeError(f"{of.name} takes {', '.join(of.takes)}: {len(of.takes)} arguments, not {len(arguments)}")
    given: dict[str, Any] = dict(zip(of.takes, arguments, strict=False))
    for n, x in named.items():
        if n not in of.takes or n in given:
            what = "is given twice" if n in given else "is not an argument"
            raise TypeError(f"{of.name}: {n} {what}; arguments are {', '.join(of.takes)}")
        given[n] = x
    missing = [n for n in of.takes if n not in ("p", "inputs", "t") and given.get(n) is None]
    if missing:
        raise TypeError(f"{of.name}: {', '.join(missing)} missing; arguments are {', '.join(of.takes)}")
    return {n: 0.0 if n == "t" and given.get(n) is None else given.get(n) for n in of.takes}


def checked_batch(operator: Operator, shapes: Mapping[str, tuple[int, ...]]) -> tuple[int, ...]:
    """The batch shape of arguments with these shapes.

    Raises
    ------
    ValueError
        If an argument has the wrong number of entries, or leading axes do not broadcast.
    """
    leads = {}
    for name, shape in shapes.items():
        n = operator.sizes[name]
        if name != "t" and (not shape or shape[-1] != n):
            raise ValueError(
                f"{operator.name}: {name} has shape {tuple(shape)}, expected (..., {n}): "
                f"{', '.join(list(operator.entries[name])[:12]) or 'no entries'}"
            )
        if lead := tuple(shape) if name == "t" else tuple(shape[:-1]):
            leads[lead] = name
    if len(leads) < 2:
        return next(iter(leads), ())
    try:
        return np.broadcast_shapes(*leads)
    except ValueError:
        seen = ", ".join(f"{n} {tuple(s)}" for n, s in shapes.items())
        raise ValueError(
            f"{operator.name}: the leading (batch) axes do not broadcast: {seen}; counted from the last, they must be "
            "equal or 1"
        ) from None
