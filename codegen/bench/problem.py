"""Problems of the benchmark: a motion whose final state is known, or a family of models of growing size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

JOINT, SPEED = "joint ", "speed of joint "
"""Prefixes of the names of directions of single joints; the page shows only the largest error of each kind."""


@dataclass(frozen=True)
class Setting:
    """Integration method, tolerances and steps of a motion.

    Attributes
    ----------
    method : str
    rtol, atol : float
    """

    method: str
    rtol: float
    atol: float

    def __str__(self) -> str:
        same = "" if self.atol == self.rtol else f", atol {self.atol:.2g}"
        return f"{self.method} {self.rtol:.2g}{same}"


def setting_of(point: Mapping[str, Any]) -> str:
    """The setting of a point of a work-precision diagram, in words."""
    return str(Setting(point["method"], point["rtol"], point["atol"]))


@dataclass(frozen=True)
class Goal:
    """A goal for a motion: an error at its end, and a limit of the cost.

    Attributes
    ----------
    error : float
        Largest absolute error of the quantities at the end.
    evaluations : int or None
        Limit of the number of evaluations.
    seconds : float or None
        Limit of the time in C on one core.
    """

    error: float
    evaluations: int | None = None
    seconds: float | None = None

    def __str__(self) -> str:
        parts = [f"{self.error:.0e}"]
        if self.evaluations is not None:
            parts.append(f"in fewer than {self.evaluations} evaluations")
        if self.seconds is not None:
            parts.append(f"in less than {1e3 * self.seconds:g} ms")
        return " ".join(parts)


def tolerances(method: str, least: int, most: int) -> tuple[Setting, ...]:
    """Settings with rtol = atol = 10^-least, ..., 10^-most."""
    return tuple(Setting(method, 10.0**-e, 10.0**-e) for e in range(least, most + 1))


@dataclass(frozen=True)
class Motion:
    """A motion whose final state is known.

    Attributes
    ----------
    name, title : str
    text : callable
        Returns the text of the model file.
    end : float
        Final time, s; the motion begins at 0.
    quantities : tuple of str
        Names in a `Trajectory`: outputs, ``q.NAME``, ``u.NAME``.
    exact : callable
        Returns their values at the end: (len(quantities),) numbers.
    source : str
        Origin of the reference.
    settings : tuple of Setting
        Settings of the work-precision diagram, from loose to tight.
    quick : tuple of Setting
        A few cheap settings.
    within : float
        Largest error allowed for the settings of `quick`.
    goals : tuple of Goal
    start : mapping of str to float
        Initial coordinates that differ from the model's, by name.
    derivatives : callable or None
        Returns the exact derivatives at the end, (len(sensitivities), len(quantities)).
    sensitivities : tuple of str
        Parameters of these derivatives.
    """

    name: str
    title: str
    text: Callable[[], str]
    end: float
    quantities: tuple[str, ...]
    exact: Callable[[], Sequence[float]]
    source: str
    settings: tuple[Setting, ...]
    quick: tuple[Setting, ...]
    within: float
    goals: tuple[Goal, ...] = ()
    start: Mapping[str, float] = field(default_factory=dict)
    derivatives: Callable[[], Sequence[Sequence[float]]] | None = None
    sensitivities: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reference:
    """Reference accelerations, and their derivatives along given directions.

    Attributes
    ----------
    udot : (nu,) numbers
    dudot : (k, nu) numbers
        Derivatives along the first k directions of the problem.
    """

    udot: Sequence[Any]
    dudot: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class Evaluation:
    """A model at a state: accelerations and derivatives along directions.

    Attributes
    ----------
    text : str
        The model file.
    q, u : (nq,) and (nu,), or None
        State; None for the model's initial state, which closes its loops.
    dq, du, dp : (k, nq), (k, nu), (k, np)
    reference : callable or None
        Returns the reference values; None if there are none.
    directions : tuple of str
        Names of the directions; empty for arbitrary ones. Those of one joint begin with `JOINT` or `SPEED`.
    """

    text: str
    q: Array | None
    u: Array | None
    dq: Array
    du: Array
    dp: Array
    reference: Callable[[], Reference] | None
    directions: tuple[str, ...] = ()


@dataclass(frozen=True)
class Family:
    """Models of growing size, evaluated at one state each.

    Attributes
    ----------
    name, title, source : str
    unit : str
        Objects that the size counts.
    make : callable
        Returns the model of a size.
    sizes, quick : tuple of int
    within : float
        Largest relative error allowed at any size.
    """

    name: str
    title: str
    source: str
    unit: str
    make: Callable[[int], Evaluation]
    sizes: tuple[int, ...]
    quick: tuple[int, ...]
    within: float


@dataclass(frozen=True)
class Robots:
    """Robots that another program also reads and computes; the results of that program are the reference.

    Attributes
    ----------
    name, title, source : str
    models, quick : tuple of str
    within : float
        Largest relative difference allowed for any robot.
    """

    name: str
    title: str
    source: str
    models: tuple[str, ...]
    quick: tuple[str, ...]
    within: float


Problem = Motion | Family | Robots
