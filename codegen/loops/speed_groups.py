"""Groups of speeds, and the coordinates that belong to each group.

A scalar coordinate belongs to its rate. A quaternion belongs to the three angular speeds of its joint, a position to the
three linear ones: none of these coordinates is the integral of a single speed. A group of coordinates counts as
independent as long as one of its speeds is. The displacements of a group, one per speed, are small rotations and
displacements along the child's axes.
"""

from __future__ import annotations

from collections.abc import Collection

from ..model.model import Model
from ..model.motions import Ball, Displacement, Slide, Turn
from ..records import dataclass


@dataclass(frozen=True, slots=True)
class SpeedGroup:
    """Speeds of a joint, with the coordinates that these speeds alone change.

    Attributes
    ----------
    body : int
    coordinates : slice
    speeds : range
    """

    body: int
    coordinates: slice
    speeds: range

    def is_split(self, dependent: Collection[int]) -> bool:
        """Whether some of the speeds are dependent and others are independent."""
        return 0 < sum(s in dependent for s in self.speeds) < len(self.speeds)


def speed_groups(model: Model) -> list[SpeedGroup]:
    """All speeds of a model in groups, in the order of the speeds."""
    groups: dict[tuple[int, int], SpeedGroup] = {}  # motions by the same coordinates share a group
    for k, (body, (q, u)) in enumerate(zip(model.bodies, model.coordinate_slices, strict=True)):
        for m in body.joint.kind.motion:
            match m:
                case Turn() | Slide():
                    i, n, s, f = m.index, 1, m.index, 1
                case Ball():
                    i, n, s, f = m.coordinate, 4, m.speed, 3
                case Displacement():
                    i, n, s, f = m.coordinate, 3, m.speed, 3
            i, s = q.start + i, u.start + s
            groups[k, s] = SpeedGroup(k, slice(i, i + n), range(s, s + f))
    return [groups[key] for key in sorted(groups)]


def coordinates_of(model: Model, dependent: Collection[int]) -> tuple[list[int], list[int]]:
    """Indices of coordinates whose speeds are all dependent, and of coordinates in split groups."""
    whole: list[int] = []
    split: list[int] = []
    for group in speed_groups(model):
        found = split if group.is_split(dependent) else whole
        if any(s in dependent for s in group.speeds):
            found += range(group.coordinates.start, group.coordinates.stop)
    return sorted(whole), sorted(split)
