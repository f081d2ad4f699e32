"""What a problem of the benchmark is: a motion with a known end, or a family of models of growing size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

JOINT, SPEED = "joint ", "speed of joint "
"""What names of directions begin with that are one of many alike: a page has the worst of them."""


@dataclass(frozen=True)
class Setting:
    """How a motion is integrated.

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
    """What a motion is to reach: an error at its end, and with how much.

    Attributes
    ----------
    error : float
        The largest of the quantities at the end, absolute.
    evaluations : int or None
        Fewer than these.
    seconds : float or None
        In less than these, in C on one core.
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
    """A motion whose end is known.

    Attributes
    ----------
    name, title : str
    text : callable
        Gives the model file.
    end : float
        s; it begins at 0.
    quantities : tuple of str
        Names in a `Trajectory`: outputs, ``q.NAME``, ``u.NAME``.
    exact : callable
        Their values at the end: (len(quantities),) numbers.
    source : str
        Where these come from.
    settings : tuple of Setting
        Of the work-precision diagram, from loose to tight.
    quick : tuple of Setting
        A few that cost little, each with its `within`.
    within : float
        The error that all of `quick` keep.
    goals : tuple of Goal
    start : mapping of str to float
        Initial coordinates that are not the model's, by name.
    derivatives : callable or None
        Exact derivatives at the end, (len(sensitivities), len(quantities)).
    sensitivities : tuple of str
        By which parameters.
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
    """Accelerations, and their derivatives along given directions, from elsewhere.

    Attributes
    ----------
    udot : (nu,) numbers
    dudot : (k, nu) numbers
        Along the first k directions of the problem.
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
        None: the model's initial state, which closes its loops.
    dq, du, dp : (k, nq), (k, nu), (k, np)
    reference : callable or None
        Gives the exact ones; None where there are none.
    directions : tuple of str
        What the directions are; empty where they are arbitrary ones. Those of one joint begin with `JOINT` or `SPEED`.
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
        What the size counts.
    make : callable
        The model of a size.
    sizes, quick : tuple of int
    within : float
        The relative error that every size keeps.
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
    """Robots that another program reads and computes too, which is their reference.

    Attributes
    ----------
    name, title, source : str
    models, quick : tuple of str
    within : float
        The relative difference that every robot keeps.
    """

    name: str
    title: str
    source: str
    models: tuple[str, ...]
    quick: tuple[str, ...]
    within: float


Problem = Motion | Family | Robots
