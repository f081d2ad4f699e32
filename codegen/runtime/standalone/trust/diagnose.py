"""Diagnosis of a state: rounding errors, condition numbers of mass matrix and closures, and distances from a loss of rank."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ....elementary import ELEMENTWISE, ON_ARRAYS
from ..arrays import Array
from ..calls.arguments import NO_SEEDS, Seeds
from ..calls.functions import ALONG, STATE
from ..calls.non_finite import warn_of_infinite
from ..calls.numpy_target import NumpyTarget
from ..calls.package import Package
from ..calls.room import Room, alone
from ..calls.targets import Opened
from ..calls.task import Target, Task
from ..errors import SingularJointError
from .diagnosis import ClosureCondition, Diagnosis, MassCondition
from .rounding import UNIT, NearestFunctions, can_round, spread, to_nearest

LARGEST = 1000
"""Largest number of speeds for which matrices are formed; eigenvalues and singular values take O(n^3)."""

SAMPLES = 4
"""Number of samples in which each argument changes by one unit in its last place, with random signs from a fixed
seed."""


class Diagnosing(Room):
    """Diagnosis of the accelerations and derivatives of a state."""

    def __init__(self, package: Package):
        super().__init__(package)
        self._nearest: dict[int, Target] = {}

    def diagnose(self, state: tuple[Any, ...], seeds: tuple[Any, ...], derivatives: bool) -> Diagnosis:
        """See `Solver.diagnose`."""
        if "accelerations" not in self._functions:
            raise AttributeError(self._why_not("diagnose"))
        given, along = dict(zip(STATE, state, strict=True)), dict(zip(ALONG, seeds, strict=True))
        arrays, batch = self._arguments.take(given, self._left_out)
        if any(x is not None for x in along.values()):
            names, directions, batch = self._given_directions(along, given, arrays, batch)
        else:
            names, directions = self._units() if derivatives and "sensitivities" in self._functions else ((), {})
        alone(batch)
        udot, udot_error, failure = self._rounded("accelerations", arrays)
        dudot, dudot_error, less = self._rounded("sensitivities", arrays, Seeds(directions, len(names)))
        return Diagnosis(
            udot, udot_error, self._by_arguments(arrays, udot), dudot, dudot_error, self.speed_names, names,
            self._mass_condition(arrays), *self._closure_conditions(arrays), failure or less,
        )  # fmt: skip

    # -- rounding ------------------------------------------------------------------------------------------------------

    def _rounded(self, name: str, arrays: Mapping[str, Any], directions: Seeds = NO_SEEDS) -> tuple[Array, Array, str]:
        """A function's last result, (nu,) or (k, nu), an estimate of its error, and the reason if there is no value."""
        opened = self._opened
        shape = (directions.k, self.nu) if name == "sensitivities" else (self.nu,)
        if not np.prod(shape):
            return np.zeros(shape), np.zeros(shape), ""
        f, target = opened.functions[name], self._rounding_target(opened)

        def compute() -> list[Array]:
            return target.compute(f, arrays, (), directions)

        try:
            nearest = compute()
        except SingularJointError as error:
            return np.full(shape, np.nan), np.full(shape, np.inf), str(error)
        warn_of_infinite(opened, Task(f, arrays, (), directions, nearest))
        if not can_round():
            return nearest[-1], np.full(shape, np.nan), ""
        return nearest[-1], spread(lambda: compute()[-1:], nearest[-1:])[0], ""

    def _rounding_target(self, opened: Opened) -> Target:
        """A target that is correct in any rounding mode, which NumPy's elementary functions may not be."""
        if opened.target.name != "numpy":
            return opened.target
        if opened.number not in self._nearest:
            target = NumpyTarget(opened.folder, opened.manifest)
            target.module.np = NearestFunctions()
            vars(target.module).update((name, to_nearest(getattr(ON_ARRAYS, name))) for name in ELEMENTWISE)
            self._nearest[opened.number] = target
        return self._nearest[opened.number]

    def _by_arguments(self, arrays: Mapping[str, Any], udot: Array) -> Array:
        """The largest change of udot, (nu,), due to a change of each argument by a unit in its last place."""
        signs = np.random.default_rng(0)
        moved = {
            n: np.nextafter(x, np.where(signs.random((SAMPLES, *np.shape(x))) < 0.5, -np.inf, np.inf))
            for n, x in arrays.items()
        }
        moved = {n: np.where(np.asarray(arrays[n]) == 0.0, 0.0, x) for n, x in moved.items()}
        f = self._functions["accelerations"]
        try:
            found = self._opened.target.compute(f, moved, (SAMPLES,))[0]
        except SingularJointError:
            return np.full(self.nu, np.inf)
        with np.errstate(all="ignore"):
            largest: Array = np.abs(found - udot).max(axis=0)
        return largest

    # -- directions ----------------------------------------------------------------------------------------------------

    def _given_directions(
        self, along: Mapping[str, Any], given: Mapping[str, Any], arrays: Mapping[str, Any], batch: tuple[int, ...]
    ) -> tuple[tuple[str, ...], Mapping[str, Array], tuple[int, ...]]:
        self._find(self._opened, "sensitivities")
        self.package._look_at_directions("sensitivities", (*given.values(),), (*along.values(),))
        (directions, k), batch = Seeds.take(self._arguments, along, arrays, batch)
        return tuple(f"direction {j + 1}" for j in range(k)), directions, batch

    def _units(self) -> tuple[tuple[str, ...], Mapping[str, Array]]:
        """Unit seeds of all independent variables, and their names."""
        independent = {"dq": self.independent_names, "du": self.independent_speed_names}
        named = dict(
            zip(
                ALONG,
                (self.coordinate_names, self.speed_names, self.parameter_names, self.input_names, ("t",)),
                strict=True,
            )
        )
        chosen = [
            (s, i, n) for s, every in named.items() for i, n in enumerate(every) if n in independent.get(s, every)
        ]
        found = {s: np.zeros((len(chosen), len(every))) for s, every in named.items()}
        for row, (s, i, _) in enumerate(chosen):
            found[s][row, i] = 1.0
        heads = {"dq": "q.", "du": "u.", "dp": "p.", "dinputs": "inputs.", "dt": ""}
        return tuple(heads[s] + n for s, _, n in chosen), found

    # -- conditions ----------------------------------------------------------------------------------------------------

    def _mass_condition(self, arrays: Mapping[str, Any]) -> MassCondition | None:
        names = self.independent_speed_names
        if not 0 < len(names) <= LARGEST:
            return None
        try:
            M = self._mass(arrays, [self.speed_names.index(n) for n in names])
        except SingularJointError:  # the dependent speeds are not determined
            return None
        if M is None or not np.isfinite(M).all() or not (np.diag(M) > 0.0).all():
            return None
        sizes, scale = np.linalg.eigvalsh(M), 1.0 / np.sqrt(np.diag(M))
        try:
            with np.errstate(all="ignore"):
                left = 1.0 / np.diag(np.linalg.inv(scale[:, None] * M * scale))
        except np.linalg.LinAlgError:
            left = np.zeros(len(M))
        left = np.where(left > UNIT, left, UNIT)  # rounding may make a pivot zero or negative
        worst = int(np.argmin(left))
        return MassCondition(_quotient(sizes), float(left[worst]), names[worst])

    def _mass(self, arrays: Mapping[str, Any], independent: Sequence[int]) -> Array | None:
        """The mass matrix of the independent speeds: second derivatives of the kinetic energy, which is quadratic in the
        speeds."""
        target, functions, n = self._opened.target, self._functions, len(independent)
        if "mass_matrix" in functions:
            return target.compute(functions["mass_matrix"], arrays, ())[0]
        units = np.eye(self.nu)[independent]
        given = {**arrays, "u": units}
        if f := functions.get("energy_sensitivities_transposed"):
            found = target.compute(f, given, (n,), Seeds({"denergy": np.broadcast_to([1.0, 0.0], (1, n, 2))}, 1))
            return found[f.results.index("du")][0][:, independent]
        if f := functions.get("energy_sensitivities"):
            found = target.compute(f, given, (n,), Seeds({"du": units[:, None]}, n))
            return found[f.results.index("denergy")][..., 0]
        return None

    def _closure_conditions(
        self, arrays: Mapping[str, Any]
    ) -> tuple[tuple[ClosureCondition, ...], ClosureCondition | None, float, float]:
        """Condition numbers of each closure and of all loops, the distance from a loss of rank, and the largest
        residual."""
        manifest = self._opened.manifest
        if not self.closure_names:
            return (), None, 1.0, 0.0
        loops, dropped = manifest["loops"], set(manifest.get("dropped", ()))
        of_loop: dict[str, list[int]] = {name: [] for name in loops}
        for i, name in enumerate(self.closure_names):
            if i not in dropped:
                of_loop[name.rpartition(".")[0]].append(i)
        small = self.nu <= LARGEST
        every, gap = self._closing_columns(arrays, range(self.nu) if small else ())
        found, all_rows, all_columns = [], list[int](), list[int]()
        for c in manifest["closures"]:
            names, columns = tuple(loops[i] for i in c["loops"]), c["dependent"]
            if not columns:  # a redundant loop, such as the second hinge of a door, has no dependent speeds
                continue
            rows = [i for name in names for i in of_loop[name]]
            if small:
                # displacements are scaled by the characteristic length, like linear conditions
                every[np.ix_(rows, self._slides())] *= c["length"]
                E = every[np.ix_(rows, columns)]
            else:
                E = self._closing_columns(arrays, columns)[0][rows]
                E[:, np.isin(columns, self._slides())] *= c["length"]
            found.append(self._condition(names, columns, E))
            all_rows += rows
            all_columns += columns
        if not all_columns:
            return (), None, 1.0, gap
        if not small:
            return tuple(found), None, np.nan, gap
        whole = self._condition(tuple(loops), all_columns, every[np.ix_(all_rows, all_columns)])
        sizes = np.linalg.svd(every[all_rows], compute_uv=False)
        return tuple(found), whole, _distance(sizes[: len(all_columns)]), gap

    def _slides(self) -> list[int]:
        """Indices of speeds that are linear velocities."""
        return [i for i, unit in enumerate(self._manifest["speed_units"]) if unit == "m/s"]

    def _closing_columns(self, arrays: Mapping[str, Any], speeds: Sequence[int]) -> tuple[Array, float]:
        """Derivatives of all conditions with respect to given speeds, (conditions, n), and the largest residual."""
        f, units = self._functions["closure"], np.zeros((len(speeds) + 1, self.nu))
        units[np.arange(len(speeds)), list(speeds)] = 1.0
        position, velocity = self._opened.target.compute(f, {**arrays, "u": units}, (len(units),))
        return velocity[:-1].T.copy(), float(np.abs(position[0]).max(initial=0.0))

    def _condition(self, loops: tuple[str, ...], dependent: Sequence[int], E: Array) -> ClosureCondition:
        sizes, right = np.linalg.svd(E, full_matrices=False)[1:]
        names = tuple(self.speed_names[i] for i in dependent)
        weakest = names[int(np.argmax(np.abs(right[-1])))]
        coupled = tuple(name for name in loops if name in self._manifest.get("couplings", ()))
        if len(coupled) == len(loops) == 1:  # couplings have constant ratios, hence no dead points
            sizes = sizes / sizes[0]
        return ClosureCondition(loops, names, _condition(sizes), _distance(sizes), weakest, coupled)


def _condition(sizes: Any) -> float:
    """The condition number of a closure matrix from its singular values, as in `Solver.condition`."""
    n = len(sizes)
    if not sizes[-1] > 0.0:
        return math.inf
    size = math.sqrt(max(float(np.sum(sizes**2)), n)) / n if n > 1 else 1.0
    return max(1.0, math.sqrt(float(np.sum(sizes**-2.0))) * size)


def _distance(sizes: Any) -> float:
    """The smallest singular value, divided by the largest one or by 1, whichever is larger."""
    return float(sizes[-1] / max(sizes[0], 1.0))


def _quotient(sizes: Any) -> float:
    """Ratio of the last eigenvalue to the first; infinite if the first is zero, or negative by rounding."""
    return float(sizes[-1] / sizes[0]) if sizes[0] > 0.0 else np.inf
