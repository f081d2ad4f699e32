"""A second partition of the speeds, for configurations where the first one is ill conditioned."""

from __future__ import annotations

import dataclasses

from ..model.model import Model
from .ears import Partition
from .errors import AssemblyError, PartitionError
from .partition import partition
from .speed_groups import speed_groups


def second_partition(model: Model, first: Partition) -> Partition | None:
    """The best conditioned partition whose independent speeds differ from the first one's.

    Each dependent speed in turn is asked to be independent instead of the hints; a loop at its dead point for one choice of
    independents is seldom at one for another. None where no other choice closes the loops.

    Parameters
    ----------
    model : Model
    first : Partition
        Its independent speeds are to be avoided.
    """
    coordinate = _coordinate_of_speeds(model)
    best: Partition | None = None
    for speed in (u for ear in first.ears for u in ear.dependent):
        name = coordinate.get(speed)
        if name is None:
            continue
        try:
            found = partition(dataclasses.replace(model, independent=(name,)))
        except (AssemblyError, PartitionError):
            continue
        if found.independent == first.independent:
            continue
        shared = len({*found.independent} & {*first.independent})
        if best is None or (shared, worst(found)) < (len({*best.independent} & {*first.independent}), worst(best)):
            best = found
        if len(first.ears) > MANY:
            break
    return best


MANY = 20
"""With more ears than this the first other choice serves: each one costs a whole partition."""


def worst(chosen: Partition) -> float:
    """The largest condition number of its ears."""
    return max((ear.condition for ear in chosen.ears), default=1.0)


def _coordinate_of_speeds(model: Model) -> dict[int, str]:
    """Names of the coordinates that are the integrals of speeds."""
    return {
        group.speeds.start: model.coordinate_names[group.coordinates.start]
        for group in speed_groups(model)
        if len(group.speeds) == 1
    }
