"""Which coordinates go with which speeds.

A scalar coordinate goes with its rate. A quaternion goes with the three angular speeds of its joint, a free body's position
with the three linear ones: no single one of these coordinates is the integral of a single speed, so a group of coordinates
counts as independent as long as one of the group's speeds is. Displacements of a group are small rotations and displacements
in child axes, one along each speed.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from ..model.model import Model

QUATERNION = ("spherical", "free")
"""Joints with a quaternion: their speeds are dependent all together or not at all, unless nothing else closes a loop."""


@dataclass(frozen=True, slots=True)
class SpeedGroup:
    """Speeds of a joint with the coordinates that they move, and that no other speed of the joint moves.

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
        """Whether some of the speeds are dependent and some are not."""
        return 0 < sum(s in dependent for s in self.speeds) < len(self.speeds)


def speed_groups(model: Model) -> list[SpeedGroup]:
    """All speeds of a model in groups, in the order of the speeds."""
    groups = []
    for k, (body, (q, u)) in enumerate(zip(model.bodies, model.coordinate_slices, strict=True)):
        if body.joint.type in QUATERNION:
            groups.append(SpeedGroup(k, slice(q.stop - 4, q.stop), range(u.start, u.start + 3)))
            if body.joint.type == "free":
                groups.append(SpeedGroup(k, slice(q.start, q.start + 3), range(u.start + 3, u.stop)))
        else:
            groups += [
                SpeedGroup(k, slice(i, i + 1), range(s, s + 1))
                for i, s in zip(range(q.start, q.stop), range(u.start, u.stop), strict=True)
            ]
    return groups


def coordinates_of(model: Model, dependent: Collection[int]) -> tuple[list[int], list[int]]:
    """Indices of the dependent coordinates, all of whose speeds are dependent, and of those of split groups."""
    whole: list[int] = []
    split: list[int] = []
    for group in speed_groups(model):
        found = split if group.is_split(dependent) else whole
        if any(s in dependent for s in group.speeds):
            found += range(group.coordinates.start, group.coordinates.stop)
    return sorted(whole), sorted(split)
