"""Functions of a solver for CasADi: their arguments, their generated code, and the patterns of their derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.standalone.calls.arguments import Seeds
from ..runtime.standalone.calls.functions import STATE, Function, functions_of, shapes_of
from ..runtime.standalone.calls.numpy_target import NumpyTarget
from ..runtime.standalone.calls.task import Target
from ..runtime.standalone.state.derivatives import CURVED

Pattern = NDArray[np.bool_]

SECOND = {name: c.wanted.name for name, c in CURVED.items()}
"""Functions with second derivatives, and the functions that compute these."""

BRIDGED = {
    "accelerations": ("sensitivities", "gradients"),
    "outputs": ("output_sensitivities", "output_gradients"),
    "energies": ("energy_sensitivities", "energy_gradients"),
    "coordinate_rates": ("coordinate_rate_sensitivities", "coordinate_rate_gradients"),
    "inverse_dynamics": ("inverse_dynamics_sensitivities", ""),
    "closure": ("closure_sensitivities", ""),
}
"""Functions that may become functions of CasADi, each with the members of a solver that differentiate it."""

CLOSING = "newton_step"
SEED = 271828
"""Seed of the states at which patterns are found."""


class BridgeError(ValueError):
    """A function cannot become a function of CasADi, or a problem of optimal control is not complete."""


@dataclass(frozen=True, slots=True)
class Bridged:
    """A function of CasADi.

    Attributes
    ----------
    name : str
        Name in the solver.
    value, along : Function
        The generated functions.
    back, second : Function or None
        The transpose of `along`, and Hessian products, if the package has them.
    arguments : tuple of str
    places : dict of str to tuple of int
        For arguments that hold the independent entries only: the indices of these entries in the whole array.
    sizes : dict of str to int
        Numbers of entries of the whole arrays.
    jacobian : dict of str to array of bool
        Pattern of the Jacobian, by argument.
    hessian : dict of (str, str) to array of bool
        For arguments a and b: pattern of the derivative, with respect to b, of the gradient with respect to a. Empty
        without second derivatives.
    """

    name: str
    value: Function
    along: Function
    back: Function | None
    second: Function | None
    arguments: tuple[str, ...]
    places: dict[str, tuple[int, ...]]
    sizes: dict[str, int]
    jacobian: dict[str, Pattern]
    hessian: dict[tuple[str, str], Pattern]

    @property
    def rows(self) -> int:
        """Number of entries of the result."""
        return int(self.value.shapes[0][0])

    def size(self, argument: str) -> int:
        """Number of entries of an argument of the CasADi function."""
        return len(self.places.get(argument, ())) if argument in self.places else self.sizes[argument]

    @property
    def closes(self) -> bool:
        """Whether the loops are closed from the independent coordinates."""
        return bool(self.places)


def bridged(manifest: Mapping[str, Any], target: NumpyTarget) -> dict[str, Bridged]:
    """All functions of a package that can become functions of CasADi, by name.

    Raises
    ------
    BridgeError
        If the model has no states, or numbers are not double.
    """
    name = manifest["name"]
    if not manifest["coordinate_names"]:
        raise BridgeError(f"{name}: the model has no degree of freedom, so there is no state for a function of CasADi")
    if manifest.get("scalar", "float64") != "float64":
        raise BridgeError(
            f"{name}: numbers are {manifest['scalar']}, expected float64, the numbers of CasADi; generate again"
        )
    functions = functions_of(manifest, shapes_of(manifest))
    return {n: _one(n, manifest, functions, target) for n in BRIDGED if _has(n, manifest, functions)}


def _has(name: str, manifest: Mapping[str, Any], functions: Mapping[str, Function]) -> bool:
    return name in functions and BRIDGED[name][0] in functions and bool(functions[name].shapes[0][0])


def _one(name: str, manifest: Mapping[str, Any], functions: Mapping[str, Function], target: NumpyTarget) -> Bridged:
    along, back = functions[BRIDGED[name][0]], functions.get(f"{BRIDGED[name][0]}_transposed")
    second = functions.get(SECOND.get(name, ""))
    shapes, value = shapes_of(manifest), functions[name]
    closes = CLOSING in functions and name != "closure"
    twice = second.arguments if second is not None else ()
    used = {*value.arguments, *along.arguments, *twice, *(functions[CLOSING].arguments if closes else ())}
    arguments = tuple(a for a in (*STATE, "udot") if a in used)
    sizes = {a: shapes[a][0] if a != "t" else 1 for a in arguments}
    places = _independent(manifest) if closes else {}
    places = {a: i for a, i in places.items() if a in arguments}
    jacobian, hessian = _patterns(manifest, target, value, along, second, arguments, places)
    return Bridged(name, value, along, back, second, arguments, places, sizes, jacobian, hessian)


def _independent(manifest: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """Indices of the independent coordinates and speeds.

    Raises
    ------
    BridgeError
        If a quaternion is independent in part.
    """
    q, u = manifest["coordinate_names"], manifest["speed_names"]
    own = [q.index(n) for n in manifest["independent_names"]]
    for i in manifest["quaternions"]:
        if 0 < sum(i <= k < i + 4 for k in own) < 4:
            raise BridgeError(
                f"{manifest['name']}: some entries of the quaternion of {q[i]} are independent and others are not, so they "
                f"are no states for CasADi; choose another partition, or divide the joint into revolute joints"
            )
    return {"q": tuple(own), "u": tuple(u.index(n) for n in manifest["independent_speed_names"])}


# -- patterns ----------------------------------------------------------------------------------------------------------


def _patterns(
    manifest: Mapping[str, Any],
    target: Target,
    value: Function,
    along: Function,
    second: Function | None,
    arguments: tuple[str, ...],
    places: Mapping[str, tuple[int, ...]],
) -> tuple[dict[str, Pattern], dict[tuple[str, str], Pattern]]:
    """Patterns of the Jacobian by argument, and of the change of gradients by pairs of arguments.

    If a seed is NaN, exactly those results are NaN whose statements read it, because NaN times zero is NaN. So the
    patterns hold for every state.
    """
    rows = int(value.shapes[0][0])
    jacobian = {a: np.zeros((rows, _size(manifest, a)), bool) for a in arguments}
    hessian = {}
    if second is not None:
        hessian = {
            (a, b): np.zeros((_size(manifest, a), _size(manifest, b)), bool) for a in arguments for b in arguments
        }
    for state in _states(manifest):
        for a, found in _spoiled(target, along, state, arguments).items():
            (column,) = (x for x, derived in zip(found, along.derived, strict=True) if derived)
            jacobian[a] |= column.T
        for b, found in _spoiled(target, second, state, arguments).items() if second is not None else ():
            for result, x in zip(second.results if second else (), found, strict=True):
                a = result.removeprefix("dg")
                hessian[a, b] |= x.reshape(len(x), -1).T
    every = {a: list(places.get(a, range(_size(manifest, a)))) for a in arguments}
    jacobian = {a: x[:, every[a]] for a, x in jacobian.items()}
    return jacobian, {(a, b): x[np.ix_(every[a], every[b])] for (a, b), x in hessian.items()}


def _size(manifest: Mapping[str, Any], argument: str) -> int:
    return int(np.prod(shapes_of(manifest)[argument]))


def _spoiled(
    target: Target, f: Function, state: Mapping[str, Any], arguments: tuple[str, ...]
) -> dict[str, list[Pattern]]:
    """Results that become NaN if one seed is NaN: by argument with seeds, and by direction."""
    found = {}
    for a in arguments:
        if f"d{a}" in f.seeds:
            n = f.seeds[f"d{a}"]
            seeds = {s: np.zeros((n, k)) for s, k in f.seeds.items()}
            seeds[f"d{a}"][np.arange(n), np.arange(n)] = np.nan
            found[a] = [np.isnan(x) for x in target.compute(f, state, (), Seeds(seeds, n))] if n else []
    return {a: x for a, x in found.items() if x}


def _states(manifest: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """States for the patterns: the initial pose with two sets of speeds and inputs. Other poses of closed loops would
    have to be assembled first."""
    draw = np.random.default_rng(SEED)
    shapes, weights = shapes_of(manifest), [c.weights for c in CURVED.values()]
    for _ in range(2):
        state: dict[str, Any] = {n: draw.uniform(0.5, 1.5, shapes[n]) for n in ("u", "inputs", "udot", *weights)}
        yield {
            **state,
            "q": np.array(manifest["initial"]["q"], float),
            "p": np.array(manifest["parameters"], float),
            "t": 0.0,
        }
