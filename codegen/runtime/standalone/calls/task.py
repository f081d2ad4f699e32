"""A call of a generated function with checked arguments, and the base class of targets."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array, Shape, dtype_of, of_state
from ..errors import SingularJointError
from .arguments import NO_SEEDS, Seeds, Unseen
from .functions import Function
from .results import empty
from .single_calls import Call, NoCalls


class Task(NamedTuple):
    """A call of a generated function.

    Attributes
    ----------
    f : Function
    arrays : mapping
        Arguments by name, (..., n), with leading axes that broadcast to the batch; ``t`` is a float or (...).
    batch : tuple of int
    seeds : Seeds
        Seeds, with all batch axes.
    out : list of array or None
        Arrays for results, (*batch, *shape), or (k, *batch, *shape) for derivatives; None for results that are not requested.
    failed : dict of int to SingularJointError, or None
        Receives the failed states of a batch, whose results are then NaN. With None, a failure raises.
    unseen : sequence of Unseen
        Large arguments and seeds whose numbers have not been tested yet.
    """

    f: Function
    arrays: Mapping[str, Any]
    batch: Shape
    seeds: Seeds
    out: Sequence[Any]
    failed: dict[int, SingularJointError] | None = None
    unseen: Sequence[Unseen] = ()

    @property
    def states(self) -> int:
        """Number of states in the batch."""
        return math.prod(self.batch)

    def look(self, but: Collection[str] = ()) -> None:
        """Tests that large arguments and seeds are finite, except the arrays named in `but`.

        Raises
        ------
        ValueError
            If a number is not finite.
        """
        for unseen in self.unseen:
            if unseen.name not in but:
                unseen.look()

    def place(self, number: int) -> tuple[int, ...]:
        """Index of a state in the batch."""
        return tuple(int(i) for i in np.unravel_index(number, self.batch))

    def at(self, place: tuple[int, ...]) -> dict[str, Any]:
        """The arguments of one state of the batch."""
        return {
            n: np.broadcast_to(a, self.batch)[place] if n == "t" else of_state(a, self.batch, place, 0)
            for n, a in self.arrays.items()
        }

    def spoil(self, results: Sequence[Any], derived: Sequence[bool], failed: Iterable[int]) -> None:
        """Sets the results of failed states to NaN."""
        for place in map(self.place, failed):
            for x, along in zip(results, derived, strict=True):
                if x is not None:
                    x[(slice(None), *place) if along else place] = math.nan


class Target(ABC):
    """Computes the functions of a package: the compiled C or the NumPy module."""

    name = ""
    threads: int | None = None
    """Number of threads for a batch; None leaves the choice to the target."""
    calls: Mapping[Any, Call] = NoCalls()

    def __init__(self, manifest: Mapping[str, Any]):
        self.dtype = dtype_of(manifest)
        self.couplings = frozenset(manifest.get("couplings", ()))

    @abstractmethod
    def run(self, task: Task) -> bool:
        """Computes the results of a task. Returns True if all results are known to be finite.

        Raises
        ------
        ValueError
            If a number of a large argument or seed is not finite.
        """

    def compute(
        self, f: Function, arrays: Mapping[str, Any], batch: Shape, seeds: Seeds = NO_SEEDS,
        failed: dict[int, SingularJointError] | None = None,
    ) -> list[Array]:  # fmt: skip
        """Results in new arrays; for the arguments see `Task`."""
        if not (batch or f.seeds):
            alone = self.calls[f.name](tuple([arrays.get(n, 0.0 if n == "t" else None) for n in f.order]), None, None)
            if alone is not None:
                return list(alone)
        results = [empty(shape, self.dtype) for shape in f.whole_shapes(batch, seeds.k)]
        self.run(Task(f, arrays, batch, seeds, results, failed))
        return results
