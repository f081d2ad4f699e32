"""A partition: ears in the order in which they close, and the dependent speeds of each ear."""

from __future__ import annotations

from ..model.model import Model, closure_row_names
from ..records import dataclass
from .comparison import Comparison
from .speed_groups import SpeedGroup, speed_groups


@dataclass(frozen=True, slots=True)
class Ear:
    """Loops that are closed together: a single loop, or those of a cluster.

    Attributes
    ----------
    loops : tuple of int
        Indices into `Model.loops`.
    dependent : tuple of int
        Indices of the speeds that the loops make dependent, as many as `rank`. Their order follows the path: outward on the start
        side, then outward on the end side, loop by loop in a cluster.
    rows : int
        Number of conditions that the loop joints impose.
    rank : int
        Number of independent conditions, for all motions that earlier ears permit.
    condition : float
        Condition number of the closure matrix of the dependent speeds at the assembled initial configuration, with
        displacements and linear conditions scaled by `length`.
    length : float
        Characteristic length of the loops, a power of two, m; linear conditions are divided by it.
    dropped : tuple of (int, int)
        Ignored conditions, redundant within the tolerance but not exactly: loop and position among `closure_row_names`.
        As many conditions remain as there are dependents. Empty if redundancy is exact to rounding: then all hold.
    gaps : bool
        Whether the loops may be open, in conditions that were dropped or by a change of a parameter. The relative motion of
        their faces is then taken into account.
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
    """The ears of a model's loops, in an order in which each ear closes on links whose motion is already known.

    Attributes
    ----------
    ears : tuple of Ear
    independent : tuple of int
        Indices of the independent speeds, ascending.
    q : tuple of float
        The assembled initial configuration at which the ranks were found.
    warnings : tuple of str
        Warnings for the user about the choice.
    compared : tuple of Comparison
        Quality of the choice for each component of loops that share joints.
    uncompared : int
        Number of loops in components that are too large to be compared.
    growth : float
        Largest ratio of a dependent speed of uncompared loops to the independent speeds: root mean square over random motions,
        displacements per characteristic length.
    remarks : tuple of str
        Conditions that were dropped, and why.
    opening : tuple of int
        Parameters that open redundant conditions if they change alone.
    turned : tuple of int
        Loops with dropped conditions that are taken along the axes of ``to``: see `Model.with_turned`.
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
        """Rotations and displacements with both dependent and independent speeds."""
        dependent = set(self.dependent)
        return [group for group in speed_groups(model) if group.is_split(dependent)]

    def dropped_rows(self, model: Model) -> tuple[set[int], ...]:
        """For each loop, the positions of the dropped conditions among the loop's conditions."""
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
