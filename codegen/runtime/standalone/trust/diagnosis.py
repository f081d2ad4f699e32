"""The diagnosis of a state: rounding errors, condition numbers, distances from a loss of rank, and their description."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....html_tables import Markup, html_of
from ..arrays import Array
from .rounding import UNIT

ALL_DIGITS = -math.log10(UNIT)
"""Number of decimal digits of a double: 15.95."""

NEAR = 1e-4
"""Distance from a loss of rank below which the text warns; accelerations then lose four or more digits."""

OPEN = 1e-9
"""Residual of loops, relative to the distance from a loss of rank, above which the text says that dependent coordinates are
wrong."""

FEW_DIGITS = 8
"""Number of correct digits of an acceleration below which the text mentions forces that cancel."""

SHOWN = 6
"""Number of closures in the text (those with the largest condition numbers), and of speeds in a notebook."""


class MassCondition(NamedTuple):
    """The condition of the mass matrix of the independent speeds.

    Attributes
    ----------
    condition : float
        Largest eigenvalue of the mass matrix divided by the smallest, in SI units.
    left : float
        For each speed, the inertia along it with all other joints free is divided by the inertia with all others locked;
        this is the smallest of these ratios. The sweeps lose at most about ``-log10(left)`` digits.
    weakest : str
        The speed with the smallest ratio.
    """

    condition: float
    left: float
    weakest: str


class ClosureCondition(NamedTuple):
    """The condition of a closure matrix: derivatives of loop conditions with respect to the dependent speeds.

    Linear conditions and displacements are relative to the loops' characteristic length.

    Attributes
    ----------
    loops : tuple of str
        Loops and couplings that are closed together.
    dependents : tuple of str
        Speeds that they make dependent.
    condition : float
        The value of `Solver.condition`: change of dependent speeds per unit of a residual, 1 at best.
    distance : float
        Distance to the nearest matrix that has lost rank, relative to the larger of 1 and the largest singular value.
    weakest : str
        Dependent speed with the largest component in the motion that the loop conditions constrain least.
    couplings : tuple of str
        The couplings among `loops`.
    """

    loops: tuple[str, ...]
    dependents: tuple[str, ...]
    condition: float
    distance: float
    weakest: str
    couplings: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class Diagnosis:
    """Rounding errors of a state's accelerations and derivatives, and conditions. It prints as text.

    `Solver.diagnose` returns it.

    Attributes
    ----------
    udot, udot_error : ndarray (nu,)
        Accelerations, and estimates of their rounding errors, at least one unit of rounding.
    argument_error : ndarray (nu,)
        Change of the accelerations if every argument changes by a unit in its last place.
    dudot, dudot_error : ndarray (k, nu)
        Derivatives, and estimates of their rounding errors.
    speed_names, direction_names : tuple of str
        Names of the nu columns and of the k rows: ``q.crank``, or ``direction 1`` of given seeds.
    mass : MassCondition or None
        Condition of the mass matrix. None if the package has no function for this matrix, or the matrix is very large.
    closures : tuple of ClosureCondition
        One for each set of loops that are closed together.
    all_loops : ClosureCondition or None
        Condition of all loops together. It may be worse than that of each set alone.
    distance : float
        Distance of all loop conditions from a loss of rank for any choice of independents, as in `ClosureCondition`; 1
        without loops. If it is much larger than that of a closure, other independent coordinates are better.
    gap : float
        Largest residual of the loops, in the units of `closure`.
    failure : str
        Reason why accelerations or derivatives are missing; usually empty.
    unit : float
        Unit of rounding of the package's scalar type.
    """

    udot: Array
    udot_error: Array
    argument_error: Array
    dudot: Array
    dudot_error: Array
    speed_names: tuple[str, ...]
    direction_names: tuple[str, ...]
    mass: MassCondition | None
    closures: tuple[ClosureCondition, ...]
    all_loops: ClosureCondition | None
    distance: float
    gap: float
    failure: str
    unit: float = UNIT

    @property
    def at_work(self) -> Array:
        """Magnitude that the accelerations would have if forces did not cancel, (nu,)."""
        return np.fmax(np.abs(self.udot), self.argument_error / self.unit)

    @property
    def digits(self) -> Array:
        """Trustworthy decimal digits of each acceleration, (nu,), up to 15.95.

        The error of an acceleration that is zero to rounding is compared with the largest acceleration, or with `at_work`.
        """
        return trusted(self.udot[None], self.udot_error[None], self.at_work[None])[0]

    @property
    def derivative_digits(self) -> Array:
        """Trustworthy decimal digits of the derivatives along each direction, (k, nu)."""
        return trusted(self.dudot, self.dudot_error)

    @property
    def nearest(self) -> ClosureCondition | None:
        """The closure nearest to a loss of rank, or None without loops."""
        return min(self.closures, key=lambda c: c.distance, default=None)

    def lines(self) -> list[str]:
        """Return the diagnosis as lines of text.

        Returns
        -------
        list of str
            One statement a line.

        Examples
        --------
        >>> solver.diagnose(*solver.initial).lines()[0][:21]
        'udot: about 15 digits'
        """
        return list(self._lines())

    def __repr__(self) -> str:
        first, *rest = self.lines()
        return "\n".join([f"Diagnosis: {first}", *(f"  {line}" for line in rest)])

    def _repr_html_(self) -> str:
        rows = [
            (f"udot.{self.speed_names[i]}", self.udot[i], Markup(f"{self.udot_error[i]:.1e}"),
             Markup(f"{self.argument_error[i]:.1e}"), _whole(self.digits[i]))
            for i in np.argsort(self.digits, kind="stable")
        ]  # fmt: skip
        return html_of(self.lines(), ("", "value", "rounding", "by arguments", "digits"), rows, SHOWN)

    def _lines(self) -> Iterator[str]:
        if self.failure:
            yield self.failure
        if not self.failure or np.isfinite(self.udot_error).all():
            yield from self._of_rounding()
        if self.mass is not None and self.mass.condition > 1.0:
            yield self._of_inertia(self.mass)
        nearest = self.nearest
        if nearest is not None and self.gap > OPEN * nearest.distance:
            off = f"{self.gap / nearest.distance:.1g}" if nearest.distance > 0.0 else "any amount"
            yield (
                f"loops are open by {self.gap:.1g}, so dependent coordinates may be wrong by {off}: "
                f"the results are those of an impossible state; assemble it first"
            )
        yield from self._of_closures()

    def _of_rounding(self) -> Iterator[str]:
        if not np.isfinite(self.udot).all():
            yield "udot is not finite: no digits to trust"
            return
        if np.isinf(self.udot_error).any():
            yield "rounding decides whether a loop or joint is singular here: no digits of udot to trust"
            return
        digits, names = self.digits, self.speed_names
        if not len(digits):
            yield "there are no speeds, so there are no accelerations whose digits could be lost"
            return
        if not np.isfinite(self.udot_error).all():
            yield "rounding errors are not known: this machine does not support directed rounding"
            return
        i = int(np.argmin(digits))
        least = f"udot.{names[i]}, {self.udot[i]:.6g} +- {self.udot_error[i]:.1e}"
        yield f"udot: about {_whole(digits[i])} digits to trust; least of {least}"
        share = float(self.udot_error[i] / self.at_work[i]) if self.at_work[i] > 0.0 else 0.0
        if digits[i] < FEW_DIGITS and share < 10.0**-FEW_DIGITS:
            yield (
                f"udot.{names[i]} results from forces that cancel: each of them would give about {self.at_work[i]:.2g}, of which "
                f"the error is {share:.0e}"
            )
        if self.dudot.size:
            of = self.derivative_digits
            j, i = (int(x) for x in np.unravel_index(int(np.argmin(of)), of.shape))
            yield (
                f"derivatives: about {_whole(of[j, i])} digits to trust; least of udot.{names[i]} by {self.direction_names[j]}, "
                f"{self.dudot[j, i]:.6g} +- {self.dudot_error[j, i]:.1e}"
            )
        by_arguments = trusted(
            self.udot[None], np.fmax(self.argument_error, self.udot_error)[None], self.at_work[None]
        )[0]
        if by_arguments.min() < digits.min() - 1.0:
            i = int(np.argmin(by_arguments))
            yield (
                f"a unit in the last place of the arguments changes udot.{names[i]} by {self.argument_error[i]:.1e}: with "
                f"rounded arguments, about {_whole(by_arguments[i])} digits are right"
            )

    def _of_inertia(self, m: MassCondition) -> str:
        """Describes the mass matrix, and the joint whose inertia is a difference of large numbers."""
        text = (
            f"mass matrix: condition number {_number(m.condition)}, which alone costs no digits, since it is not formed"
        )
        if m.left > NEAR:
            return text
        return (
            f"{text}; but {m.weakest} keeps {m.left:.1g} of its inertia if the other joints are free, and up to "
            f"{min(-math.log10(m.left), ALL_DIGITS):.0f} digits may be lost: it is connected to much heavier bodies"
        )

    def _of_closures(self) -> Iterator[str]:
        worst = sorted(self.closures, key=lambda c: c.distance)
        for c in worst[:SHOWN]:
            joined = [name for name in c.loops if name not in c.couplings]
            parts = _listed("loop", "loops", joined), _listed("coupling", "couplings", c.couplings)
            loops = " and ".join(text for names, text in zip((joined, c.couplings), parts, strict=True) if names)
            yield (
                f"closure of {loops}: condition {_number(c.condition)}, {_away(c.distance)}; worst in {c.weakest}"
                + self._why(c)
            )
        if len(worst) > SHOWN:
            yield f"and {len(worst) - SHOWN} more closures, at worst {_away(worst[SHOWN].distance)}"
        if self.all_loops is not None and len(self.closures) > 1:
            yield f"all loops together: condition {_number(self.all_loops.condition)}, {_away(self.all_loops.distance)}"

    def _why(self, c: ClosureCondition) -> str:
        """The cause, with a remedy, of a closure near a loss of rank."""
        if c.distance > NEAR:
            return ""
        if self.distance > 100.0 * c.distance:
            return (
                f": a dead point of the chosen independent coordinates; with others it is {_away(self.distance)} "
                f"(--partitions 2, or independent: [...] in the model)"
            )
        return ": the mechanism itself is near a singular pose for any choice of independent coordinates"


def trusted(values: Array, errors: Array, at_work: Array | float = 0.0) -> Array:
    """Decimal digits of values (k, n) with errors. A value below its error counts as zero; its error is compared with the largest
    value of its row, or with the terms that cancel."""
    size = np.abs(values)
    most = np.fmax(size.max(axis=-1, keepdims=True, initial=0.0), at_work)
    with np.errstate(all="ignore"):
        found = -np.log10(errors / np.where(size > errors, size, most))
    found = np.where(errors == 0.0, ALL_DIGITS, found)
    return np.clip(np.nan_to_num(found, nan=0.0, posinf=ALL_DIGITS, neginf=0.0), 0.0, ALL_DIGITS)


def _whole(digits: float) -> int:
    """A number of digits, rounded down."""
    return math.floor(digits)


def _number(x: float) -> str:
    return f"{x:.2g}" if math.isfinite(x) else "infinite"


def _away(distance: float) -> str:
    return f"{distance:.1g} from rank loss" if distance > 0.0 else "no rank left"


def _listed(one: str, several: str, names: Sequence[str]) -> str:
    return f"{one if len(names) == 1 else several} {', '.join(names[:SHOWN])}{', ...' if len(names) > SHOWN else ''}"
