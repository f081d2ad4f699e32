"""A partition: ears in the order in which they close, and the speeds that each makes dependent."""

from __future__ import annotations

from ..model.model import Model, closure_row_names
from ..records import dataclass
from .comparison import Comparison
from .speed_groups import SpeedGroup, speed_groups


@dataclass(frozen=True, slots=True)
class Ear:
    """Loops that are closed together: a single one, or those of a cluster.

    Attributes
    ----------
    loops : tuple of int
        Indices into `Model.loops`.
    dependent : tuple of int
        Indices of the speeds that they make dependent, in path order: outward on the start side, then outward on the end
        side; loop by loop in a cluster. As many as `rank`.
    rows : int
        Conditions that the loop joints set.
    rank : int
        How many of them are independent, for all motions that earlier ears allow.
    condition : float
        Of the closure matrix of the dependent speeds, displacements and linear conditions scaled with `length`, at the
        assembled initial configuration.
    length : float
        Characteristic length of the loops, a power of two, m: linear conditions are divided by it.
    dropped : tuple of (int, int)
        Conditions that follow from the others but for a little, loop and place among `closure_row_names`: they do not count.
        As many are left as there are dependents. Empty where the redundant ones follow to rounding: then all are met.
    gaps : bool
        The loops may be open in some conditions, which were dropped, or be opened by a parameter: what moves their faces
        apart is followed.
    """

    loops: tuple[int, ...]
    dependent: tuple[int, ...]
    rows: int
    rank: int
    condition: float
    length: float
    dropped: tuple[tuple[int, int], ...] = ()
    gaps: bool = False

    @property
    def redundant(self) -> int:
        """Number of redundant conditions."""
        return self.rows - self.rank


@dataclass(frozen=True, slots=True)
class Partition:
    """The loops in an order in which each ear closes on links that are resolved already.

    Attributes
    ----------
    ears : tuple of Ear
    independent : tuple of int
        Indices of the independent speeds, ascending.
    q : tuple of float
        The assembled initial configuration that ranks were found at.
    warnings : tuple of str
        What a user should know about the choice.
    compared : tuple of Comparison
        How good the choice is for loops that share joints, taken together.
    uncompared : int
        How many loops share joints with too many others for that.
    growth : float
        How much faster than all independent speeds a dependent speed of these is: the root mean square of random motions,
        of the speed that is worst, displacements per characteristic length.
    remarks : tuple of str
        Conditions that were dropped, and why.
    opening : tuple of int
        Parameters that open redundant conditions when they change alone.
    turned : tuple of int
        Loops of which conditions were dropped and are along the axes of ``to``: see `Model.with_turned`.
    """

    ears: tuple[Ear, ...]
    independent: tuple[int, ...]
    q: tuple[float, ...] = ()
    warnings: tuple[str, ...] = ()
    compared: tuple[Comparison, ...] = ()
    uncompared: int = 0
    growth: float = 1.0
    remarks: tuple[str, ...] = ()
    opening: tuple[int, ...] = ()
    turned: tuple[int, ...] = ()

    @property
    def dependent(self) -> tuple[int, ...]:
        """Indices of the dependent speeds, ascending."""
        return tuple(sorted(s for ear in self.ears for s in ear.dependent))

    def split(self, model: Model) -> list[SpeedGroup]:
        """Rotations and displacements with some dependent and some independent speeds."""
        dependent = set(self.dependent)
        return [group for group in speed_groups(model) if group.is_split(dependent)]

    def dropped_rows(self, model: Model) -> tuple[set[int], ...]:
        """For each loop, the positions of the dropped conditions among its own."""
        found: list[set[int]] = [set() for _ in model.loops]
        for ear in self.ears:
            for loop, row in ear.dropped:
                found[loop].add(row)
        return tuple(found)

    def dropped_conditions(self, model: Model) -> tuple[int, ...]:
        """Positions of the dropped conditions among `Model.closure_names`."""
        place = {name: i for i, name in enumerate(model.closure_names)}
        return tuple(
            sorted(place[closure_row_names(model.loops[i])[row]] for ear in self.ears for i, row in ear.dropped)
        )

    @property
    def lengths(self) -> tuple[float, ...]:
        """Characteristic length of each loop, in the order of `Model.loops`, m."""
        length = {i: ear.length for ear in self.ears for i in ear.loops}
        return tuple(length[i] for i in sorted(length))
