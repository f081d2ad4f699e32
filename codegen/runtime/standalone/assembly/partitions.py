"""Which coordinates are independent: the choices that a package holds, and how good they are in a state."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array, Numbers, Times
from ..calls.arguments import placed, placing
from ..calls.package import Package
from ..calls.targets import partitions_of
from ..errors import SingularLoopError


class Partitions(Package):
    """Choices of independent coordinates."""

    @property
    def partitions(self) -> tuple[tuple[str, ...], ...]:
        """Names of the independent coordinates of each partition that the package holds, one to four."""
        return tuple(tuple(m.get("independent_names", self.coordinate_names)) for m in partitions_of(self._manifest))

    @property
    def partition(self) -> int:
        """The partition in use."""
        return self._opened.number

    def use_partition(self, partition: int) -> None:
        """Take other independent coordinates from now on; states keep their meaning, since q and u hold all coordinates and
        speeds.

        Not while other threads use this solver.
        """
        count = len(self.partitions)
        if isinstance(partition, bool) or not isinstance(partition, (int, np.integer)):
            raise ValueError(f"partition is {partition!r}, expected a whole number below {count}")
        if not 0 <= partition < count:
            raise ValueError(f"partition {partition}: there are {count}, counted from 0")
        self._use(self._open(int(partition)))

    def condition(self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0) -> Array:
        """Worst condition of the closure matrices of the dependent speeds, for each partition, (..., len(partitions)).

        One is best; infinite where a loop has lost rank, as at a dead point of the independent coordinates. The figure says how
        far dependent speeds move per unit of what opens a loop: the Frobenius norm of the inverse of the matrix, times that of
        the matrix, at least sqrt(n), over the number n of dependent speeds; of a single one, one over its entry. Linear
        conditions and displacements are in parts of the characteristic length. Other threads may use the solver meanwhile: the
        partition in use stays.
        """
        arrays, batch = self._arguments.take({"q": q, "p": p, "inputs": inputs, "t": t}, self._left_out)
        found = np.ones((*batch, len(self.partitions)))
        if not self.closure_names:
            return found
        q_all = np.broadcast_to(arrays["q"], (*batch, self.nq))
        p_all = placing(arrays, batch, self._opened.manifest)
        for k in range(found.shape[-1]):
            opened = self._open(k)
            for at in np.ndindex(batch):
                given = placed(q_all[at].copy(), p_all[at].copy(), self.np)
                try:
                    (values,) = opened.target.compute(opened.functions["conditions"], given, ())
                    found[(*at, k)] = values.max(initial=1.0)
                except SingularLoopError:
                    found[(*at, k)] = math.inf
        return found
