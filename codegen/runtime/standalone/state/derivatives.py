"""Results of `Solver.jacobians` and `Solver.gradients`."""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ....html_tables import html_of, shapes_of, shapes_text
from ....wording import nearest
from ..arrays import Array
from ..calls.functions import Wanted


@dataclass(slots=True, eq=False, repr=False)
class Jacobians:
    """Partial derivatives of udot. Those that were not requested are None.

    Attributes
    ----------
    q : ndarray (..., nu, nq)
        With respect to the coordinates.
    u : ndarray (..., nu, nu)
        With respect to the speeds.
    p : ndarray (..., nu, np)
        With respect to the design parameters.
    inputs : ndarray (..., nu, ninputs)
        With respect to the inputs.
    t : ndarray (..., nu)
        With respect to time.
    """

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Array

    def __repr__(self) -> str:
        return f"<Jacobians of udot: {shapes_text(self._named())}>"

    def _repr_html_(self) -> str:
        return html_of([repr(self)], ("by", "shape", "largest"), shapes_of(self._named()))

    def _named(self) -> list[tuple[str, Array | None]]:
        return [(n, getattr(self, n)) for n in JACOBIANS]


JACOBIANS = ("q", "u", "p", "inputs", "t")
"""Variables of differentiation, in the order of `Jacobians`."""


MATRICES = {
    asked: Wanted("jacobians", [f"J_{n}" for n in asked])
    for r in range(1, 6)
    for asked in itertools.combinations(JACOBIANS, r)
}
"""The requested results for each selection of variables."""

ARRAYS = {asked: operator.attrgetter(*asked) for asked in MATRICES}
"""Attributes of `Jacobians` that belong to the results in `MATRICES`."""


def jacobians_of(matrices: Mapping[str, Array]) -> Jacobians:
    """Jacobians with respect to some of `JACOBIANS`; the others are None."""
    found: list[Any] = [matrices.get(n) for n in JACOBIANS]
    return Jacobians(*found)


def asked_for(wrt: str | Iterable[str] | None) -> tuple[str, ...]:
    """The variables of differentiation: names in a list or separated by commas; None for all.

    Raises
    ------
    ValueError
        If a name is not in `JACOBIANS`, or no name is given.
    TypeError
        If `wrt` is neither names nor None.
    """
    if wrt is None:
        return JACOBIANS
    if isinstance(wrt, str):
        return _in_words(wrt)
    if not isinstance(wrt, Iterable):
        raise TypeError(f"wrt is {wrt!r}, expected names such as 'q, u' from {', '.join(JACOBIANS)}")
    return _in_order(list(wrt))


@functools.lru_cache(maxsize=64)  # the same selection is used in repeated calls
def _in_words(wrt: str) -> tuple[str, ...]:
    return _in_order([n.strip() for n in wrt.split(",")])


def _in_order(names: list[str]) -> tuple[str, ...]:
    for name in names:
        if name not in JACOBIANS:
            hint = nearest(name, JACOBIANS, cutoff=0.4)
            raise ValueError(
                f"wrt: udot has no derivative with respect to {name!r}{hint}; allowed are {', '.join(JACOBIANS)}"
            )
    if not names:
        raise ValueError(f"wrt is empty; allowed are {', '.join(JACOBIANS)}; leave it out for all")
    return tuple(n for n in JACOBIANS if n in names)


class Gradients(NamedTuple):
    """Gradients of k weighted sums. Entries of dependent coordinates and speeds are zero.

    Attributes
    ----------
    q : ndarray (k, ..., nq)
        With respect to the coordinates.
    u : ndarray (k, ..., nu)
        With respect to the speeds.
    p : ndarray (k, ..., np)
        With respect to the design parameters.
    inputs : ndarray (k, ..., ninputs)
        With respect to the inputs.
    t : ndarray (k, ...)
        With respect to time.
    """

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Array

    def __repr__(self) -> str:
        return f"<Gradients of {np.shape(self.q)[0]} weighted sums: {shapes_text(self._asdict().items())}>"

    def _repr_html_(self) -> str:
        return html_of([repr(self)], ("by", "shape", "largest"), shapes_of(self._asdict().items()))


class HessianProducts(NamedTuple):
    """Products of a Hessian with k directions: the changes of gradients along the directions.

    Attributes
    ----------
    q : ndarray (k, ..., nq)
        Of the gradient with respect to the coordinates.
    u : ndarray (k, ..., nu)
        Of the gradient with respect to the speeds.
    p : ndarray (k, ..., np)
        Of the gradient with respect to the design parameters.
    inputs : ndarray (k, ..., ninputs)
        Of the gradient with respect to the inputs.
    t : ndarray (k, ...)
        Of the derivative with respect to time.
    """

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Array

    def __repr__(self) -> str:
        return f"<HessianProducts along {np.shape(self.q)[0]} directions: {shapes_text(self._asdict().items())}>"

    def _repr_html_(self) -> str:
        return html_of([repr(self)], ("by", "shape", "largest"), shapes_of(self._asdict().items()))


class InverseDynamicsProducts(NamedTuple):
    """Products of a Hessian of the inverse dynamics with k directions: the changes of gradients along the directions.

    Attributes
    ----------
    q : ndarray (k, ..., nq)
        Of the gradient with respect to the coordinates.
    u : ndarray (k, ..., nu)
        Of the gradient with respect to the speeds.
    udot : ndarray (k, ..., nu)
        Of the gradient with respect to the derivatives of the speeds.
    p : ndarray (k, ..., np)
        Of the gradient with respect to the design parameters.
    inputs : ndarray (k, ..., ninputs)
        Of the gradient with respect to the inputs.
    t : ndarray (k, ...)
        Of the derivative with respect to time.
    """

    q: Array
    u: Array
    udot: Array
    p: Array
    inputs: Array
    t: Array

    def __repr__(self) -> str:
        return (
            f"<InverseDynamicsProducts along {np.shape(self.q)[0]} directions: {shapes_text(self._asdict().items())}>"
        )

    def _repr_html_(self) -> str:
        return html_of([repr(self)], ("by", "shape", "largest"), shapes_of(self._asdict().items()))


@dataclass(frozen=True, slots=True)
class Curved:
    """A function with second derivatives.

    Attributes
    ----------
    wanted : Wanted
        Changes of the gradients with respect to all arguments, including those that are zero in every state.
    weights : str
        The argument of the generated function that holds the weights of its results.
    """

    wanted: Wanted
    weights: str


def _curved(name: str, weights: str, by: Iterable[str] = JACOBIANS) -> Curved:
    return Curved(Wanted(name, [f"dg{n}" for n in by]), weights)


CURVED = {
    "accelerations": _curved("hessian_products", "b"),
    "outputs": _curved("output_hessian_products", "output_weights"),
    "energies": _curved("energy_hessian_products", "energy_weights"),
    "coordinate_rates": _curved("coordinate_rate_hessian_products", "rate_weights"),
    "inverse_dynamics": _curved(
        "inverse_dynamics_hessian_products", "force_weights", ("q", "u", "udot", "p", "inputs", "t")
    ),
}
"""Functions with second derivatives, by the method that computes their values."""
