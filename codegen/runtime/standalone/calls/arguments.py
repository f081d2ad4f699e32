"""Checks and broadcasts arguments: finite numbers of the right shape, in order or by name, with batch axes."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ....wording import nearest
from ..arrays import Array, Shape, dtype_of, is_finite, once
from .functions import names_of

SMALLEST_QUATERNION = 1e-6
"""The smallest norm of a quaternion that is accepted."""

MOST_AXES = 29
"""Maximum number of batch axes: NumPy allows 32, and results have up to three more."""

LARGE = 1024
"""Length of an array above which the C code tests for finite numbers while it reads the array."""

LeftOut = Callable[[str, Mapping[str, Any]], Array | float]
"""A function that returns the values of omitted entries, given the argument's name and all arguments."""


class Arguments:
    """Checks the arguments of the functions of a model.

    Attributes
    ----------
    names : dict of str to tuple of str
        Names of the entries of each argument.
    shapes : dict of str to tuple of int
        See `functions.shapes_of`.
    defaults : dict of str to array
        Default values: parameters (np,) and inputs (ninputs,).
    quaternions : tuple of int
        Index of the first component of each quaternion in q.
    """

    dtype: Any = np.dtype(np.float64)
    kind: Callable[[Any], Any] = float
    """The scalar type, of arrays and of single numbers."""
    _largest = float(np.finfo(float).max)
    is_finite: Callable[[Any], bool] = staticmethod(is_finite)
    finite: Callable[[Any], Any] = staticmethod(np.isfinite)
    """Two tests for finite numbers: `is_finite` for a one-dimensional array, and `finite` for each entry."""

    def __init__(self, manifest: Mapping[str, Any], shapes: Mapping[str, Shape]):
        self.names = names_of(manifest)
        self.shapes = shapes
        numbers = dtype_of(manifest)
        self.defaults = {"p": np.array(manifest["parameters"], numbers), "inputs": np.zeros(shapes["inputs"], numbers)}
        if "scalar" in manifest:
            self.dtype, self._largest = numbers, float(np.finfo(numbers).max)
        self.quaternions: tuple[int, ...] = tuple(manifest["quaternions"])

    def lenient(self) -> Arguments:
        """A copy that accepts non-finite numbers, and quaternions of any norm."""
        found = copy.copy(self)
        found.is_finite, found.finite, found.quaternions = lambda x: True, lambda x: np.ones((), bool), ()
        return found

    def take(
        self, given: Mapping[str, Any], left_out: LeftOut, unseen: list[Unseen] | None = None
    ) -> tuple[dict[str, Any], Shape]:
        """Checks arguments; returns the checked arrays and the batch shape that all share.

        If `unseen` is given, large arrays are appended to this list, and this function does not test their numbers.
        """
        arrays: dict[str, Any] = {}
        batch: Shape = ()
        for name, value in given.items():
            if value is None and name in self.defaults:
                arrays[name] = self.defaults[name]
                continue
            if name == "t":
                if type(value) is float and abs(value) <= self._largest:
                    arrays[name] = value
                    continue
                value = self.array(name, value, name)
                arrays[name] = value if value.ndim else self.kind(value[()])
                lead = value.shape
            else:
                rest = left_out(name, given) if isinstance(value, Mapping) else 0.0
                arrays[name] = value = self.array(name, value, name, rest, unseen)
                lead = value.shape[:-1]
            if lead and lead != batch:
                batch = broadcast(batch, lead, arrays) if batch else lead
        if self.quaternions and "q" in arrays:
            self._check_quaternions(arrays["q"])
        return arrays, batch

    def array(
        self, name: str, value: Any, of: str, rest: Array | float = 0.0, unseen: list[Unseen] | None = None
    ) -> Array:
        """An array of finite numbers whose last axis has the names of argument `of`; raises ValueError otherwise.

        `rest` are the values of entries that a mapping leaves out. For `unseen` see `take`.
        """
        n = self.shapes[of]
        if type(value) is not np.ndarray or value.dtype != self.dtype:
            value = self._named(name, value, of, rest) if isinstance(value, Mapping) else self._numbers(name, value)
        if not value.flags.aligned:  # the C code needs aligned arrays
            value = value.copy()
        if value.ndim > MOST_AXES + (1 if name == of else 2):
            raise ValueError(
                f"{name} has {value.ndim} axes, expected at most {MOST_AXES} for the states of a batch; reshape these "
                f"into fewer, such as by reshape(-1, n)"
            )
        if n:
            if value.ndim == 0 or value.shape[-1] != n[0]:
                if not n[0]:
                    raise ValueError(f"{name} has shape {value.shape}, but {has_none(name)}")
                shape = f"(k, ..., {n[0]})" if name != of else f"(..., {n[0]})"
                raise ValueError(
                    f"{name} has shape {value.shape}, expected {shape}: one number for each of {some(self.names[of])}"
                )
            if value.ndim == 1:
                if not value.flags.c_contiguous:
                    value = np.ascontiguousarray(value)
                if self.is_finite(value):
                    return value
        if unseen is not None and value.size >= LARGE and n:
            unseen.append(Unseen(self, name, value, of))
        else:
            self.look(name, value, of)
        return value

    def look(self, name: str, value: Array, of: str) -> None:
        """Raises ValueError if a number is not finite."""
        finite = self.finite(once(value))
        if not finite.all():
            place = tuple(int(i) for i in np.argwhere(~np.broadcast_to(finite, value.shape))[0])
            where = f"[{', '.join(map(str, place))}]" if place else ""
            which = f" ({self.names[of][place[-1]]})" if self.shapes[of] else ""
            raise ValueError(f"{name}{where}{which} is {value[place]}, expected finite numbers")

    def _named(self, name: str, given: Mapping[str, Any], of: str, rest: Array | float) -> Array:
        """An array from a mapping of some of its entries; the others have the values `rest`."""
        if of not in self.names:
            raise ValueError(f"{name} is a mapping, expected numbers of shape (...)")
        names = self.names[of]
        given = self._single(name, given, names)
        for n in given:
            if n not in names:
                raise unknown(name, n, names)
        columns = {n: self._numbers(f"{name}[{n!r}]", x) for n, x in given.items()}
        try:
            lead = np.broadcast_shapes(np.shape(rest)[:-1], *(x.shape for x in columns.values()))
        except ValueError:
            shapes = ", ".join(f"{n} {x.shape}" for n, x in columns.items())
            raise ValueError(f"{name}: shapes do not broadcast: {shapes}") from None
        result = np.empty((*lead, len(names)), self.dtype)
        result[...] = rest
        for n, x in columns.items():
            result[..., names.index(n)] = x
        return result

    def omitted(self, name: str, given: Any) -> Array:
        """Which entries (n,) a user leaves to the model: those that a mapping omits; all if nothing is given."""
        if not isinstance(given, Mapping):
            return np.full(self.shapes[name], given is None)
        found: Any = np.isnan(self._named(name, given, name, np.nan)).reshape(-1, *self.shapes[name]).all(axis=0)
        return found

    def _single(self, name: str, given: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
        """Splits vectors given under the name of a joint with several degrees of freedom, or of a vector, into named
        entries."""
        result: dict[str, Any] = {}
        for n, x in given.items():
            group = [] if n in names else [m for m in names if m.startswith(f"{n}.")]
            if not group:
                result[n] = x
                continue
            numbers = self._numbers(f"{name}[{n!r}]", x)
            if numbers.shape[-1:] != (len(group),):
                raise ValueError(
                    f"{name}[{n!r}] has shape {numbers.shape}, expected (..., {len(group)}): {', '.join(group)}"
                )
            result.update({m: numbers[..., i] for i, m in enumerate(group)})
        return result

    def _numbers(self, name: str, value: Any) -> Array:
        """Converts to an array of floats; raises ValueError for text, complex numbers and ragged lists."""
        if np.ma.is_masked(value):  # numpy.asarray would take the values under the mask
            raise ValueError(f"{name} has masked entries, expected real numbers; fill them first, such as by filled()")
        try:
            array = np.asarray(value)
            if array.dtype.kind in "biufO":
                with np.errstate(over="ignore"):  # infinite numbers are rejected later
                    return array.astype(self.dtype)
        except (TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{name}: {error}; expected an array of real numbers") from None
        raise ValueError(f"{name} holds {array.dtype}, expected real numbers")

    def _check_quaternions(self, q: Array) -> None:
        q = once(q)
        for i in self.quaternions:
            e = q[..., i : i + 4]
            with np.errstate(all="ignore"):  # squares of entries beyond 1e154 overflow
                square = e.dot(e) if e.ndim == 1 else np.einsum("...i,...i", e, e).min(initial=math.inf)
            if square < SMALLEST_QUATERNION**2:
                names = ", ".join(self.names["q"][i : i + 4])
                raise ValueError(
                    f"q: the quaternion ({names}) has length {math.sqrt(square):.3g}, expected at least "
                    f"{SMALLEST_QUATERNION:g}; no rotation is (1, 0, 0, 0)"
                )


class Unseen(NamedTuple):
    """An argument or seed whose numbers have not been tested yet.

    Attributes
    ----------
    arguments : Arguments
    name : str
        Its name in messages.
    value : array
    of : str
        The argument, or the argument to which a seed belongs.
    """

    arguments: Arguments
    name: str
    value: Array
    of: str

    def look(self) -> None:
        """Raises ValueError if a number is not finite."""
        self.arguments.look(self.name, self.value, self.of)


class Seeds(NamedTuple):
    """Seeds: directions of differentiation.

    Attributes
    ----------
    of : mapping of str to array (k, ..., n)
        Seeds by name, such as ``dq``; ``dt`` is (k, ..., 1). Missing ones are zero.
    k : int
        Number of directions.
    """

    of: Mapping[str, Array]
    k: int

    @classmethod
    def take(
        cls,
        arguments: Arguments,
        given: Mapping[str, Any],
        arrays: Mapping[str, Any],
        batch: Shape,
        called: Mapping[str, str] = MappingProxyType({}),
        unseen: list[Unseen] | None = None,
    ) -> tuple[Seeds, Shape]:
        """Checks seeds; returns them with all axes of the batch, and the batch shape common to seeds and arguments.

        Parameters
        ----------
        given : mapping
            Seeds as the user passed them, or None.
        arrays : mapping
            The arguments, already checked.
        batch : tuple of int
            Their batch shape.
        called : mapping of str to str
            Names of seeds in messages, where users know them by other names.
        unseen : list of Unseen, optional
            See `Arguments.take`.
        """
        seeds: dict[str, Array] = {}
        for name, value in given.items():
            if value is None:
                continue
            of = name[1:]
            seed = arguments.array(called.get(name, name), value, of, unseen=unseen)
            if of == "t":
                seed = seed[..., None]
            seeds[name] = seed[None] if seed.ndim == 1 else seed
        if not seeds:
            if called:
                names = [called[n] for n in given]
                raise ValueError(f"no weights given; give {' or '.join(names)}, sums first: (k, ..., n)")
            raise ValueError(
                f"no seed given; give at least one of {', '.join(given)}, directions first: dq (k, ..., nq)"
            )
        counts = {name: len(seed) for name, seed in seeds.items()}
        k = next(iter(counts.values()))
        if any(c != k for c in counts.values()):
            seen = ", ".join(f"{name} {c}" for name, c in counts.items())
            raise ValueError(
                f"the seeds have different numbers of directions: {seen}; the first axes must have equal lengths"
            )
        for seed in seeds.values():
            if seed.shape[1:-1] != batch:
                batch = broadcast(batch, seed.shape[1:-1], {**arrays, **seeds})
        for name, seed in seeds.items():
            missing = len(batch) - (seed.ndim - 2)
            if missing:
                seeds[name] = seed.reshape(k, *(1,) * missing, *seed.shape[1:])
        return cls(seeds, k), batch


NO_SEEDS = Seeds(MappingProxyType({}), 0)


def broadcast(batch: Shape, lead: Shape, arrays: Mapping[str, Any]) -> Shape:
    """The common shape of two batches; an error message lists the shapes of `arrays`."""
    try:
        return np.broadcast_shapes(batch, lead)
    except ValueError:
        shapes = {name: np.shape(x) for name, x in arrays.items()}
        seen = ", ".join(f"{n} {shape}" for n, shape in shapes.items() if len(shape) > (n != "t"))
        raise ValueError(
            f"the leading (batch) axes do not broadcast: {seen}; counted from the last, they must be equal or 1"
        ) from None


def placing(arrays: Mapping[str, Any], batch: Shape, manifest: Mapping[str, Any]) -> Array:
    """Arguments besides q on which positions depend: parameters and, with prescribed motion, inputs and time, (*batch, n)."""
    p = np.broadcast_to(arrays["p"], (*batch, len(manifest["parameter_names"])))
    if not manifest["prescribed_names"]:
        return p
    inputs = np.broadcast_to(arrays["inputs"], (*batch, len(manifest["input_names"])))
    t = np.broadcast_to(np.asarray(arrays["t"]), batch)[..., None]
    return np.concatenate([p, inputs, t], axis=-1)


def placed(q: Array, p: Array, count: int) -> dict[str, Any]:
    """Arguments by name from q and the result of `placing`; count is the number of parameters."""
    if p.shape[-1] == count:
        return {"q": q, "p": p}
    t = np.ascontiguousarray(p[..., -1])
    inputs = np.ascontiguousarray(p[..., count:-1])
    return {"q": q, "p": np.ascontiguousarray(p[..., :count]), "inputs": inputs, "t": t if p.ndim > 1 else t[0]}


def unknown(what: str, name: Any, known: Sequence[str]) -> ValueError:
    """The error for an unknown name, with the known names and the most similar one."""
    expected = f"; expected one of {some(known)}{nearest(name, known)}" if known else f": {has_none(what)}"
    return ValueError(f"{what}: {name!r} is not known{expected}")


def name_or_names(what: str, asked: Any) -> tuple[Any, ...]:
    """The names in an argument that is one name or a sequence of names."""
    if isinstance(asked, str):
        return (asked,)
    try:
        return tuple(asked)
    except TypeError:
        raise ValueError(f"{what} is {asked!r}, expected a name or a sequence of names") from None


def of_another_version(given: Any, known: Any) -> str:
    """Text of a message if an object's class has a known name but belongs to another version of ordernm; otherwise
    empty."""
    if type(given).__name__ not in {kind.__name__ for kind in known}:
        return ""
    return (
        f"; this {type(given).__name__} belongs to another version of ordernm than the solver's package: generate the "
        f"package again"
    )


def has_none(what: str) -> str:
    """The end of a message about an argument for which the model has no entries."""
    nouns = {"p": "parameters", "inputs": "inputs", "outputs": "outputs"}
    return f"the model has no {nouns.get(what.removeprefix('d'), f'entries of {what}')}; leave {what} out"


def no_output(what: str, name: str, known: Sequence[str]) -> ValueError:
    """The error for the name of an output that the model lacks."""
    there = (
        f"it has {some(known)}{nearest(name, known)}"
        if known
        else "it has none; add one under `outputs` of the model file, and generate again"
    )
    return ValueError(f"{what}: the model has no output {name!r}; {there}")


def some(names: Sequence[str]) -> str:
    """A list of names for a message, shortened if long."""
    if not names:
        return "none"
    return ", ".join(names[:12]) + (f", ... ({len(names)} in all)" if len(names) > 12 else "")
