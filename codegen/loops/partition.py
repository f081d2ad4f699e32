"""Which speeds are dependent, and in what order the loops are closed."""

from __future__ import annotations

from dataclasses import dataclass

from ..model.model import Model


@dataclass(frozen=True, slots=True)
class Ear:
    """Loops that are closed together: one, or the several of a cluster.

    Attributes
    ----------
    loops : tuple of int
        Indices into `Model.loops`.
    dependent : tuple of int
        Indices of the speeds that they make dependent: as many as the rank of their closure matrix.
    rows : int
        Conditions that the loop joints set.
    rank : int
        Numerical rank of the closure matrix, over all speeds that the ear's loops pass.
    condition : float
        Of the closure matrix of the dependent speeds, scaled with `length`, at the assembled initial configuration.
    length : float
        Characteristic length of the loops, a power of two, m: linear conditions are divided by it.
    """

    loops: tuple[int, ...]
    dependent: tuple[int, ...]
    rows: int
    rank: int
    condition: float
    length: float

    @property
    def redundant(self) -> int:
        """Conditions that follow from others."""
        return self.rows - self.rank


@dataclass(frozen=True, slots=True)
class Partition:
    """The loops in an order in which each ear closes on what is resolved already.

    Attributes
    ----------
    ears : tuple of Ear
    independent : tuple of int
        Indices of the independent speeds, ascending.
    q : tuple of float
        The assembled initial configuration that ranks were found at.
    """

    ears: tuple[Ear, ...]
    independent: tuple[int, ...]
    q: tuple[float, ...] = ()


def partition(model: Model) -> Partition:
    """Choose dependents and order the ears."""
    raise NotImplementedError
