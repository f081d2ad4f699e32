"""A second partition of the speeds, for configurations where the first one is ill conditioned."""

from __future__ import annotations

import dataclasses

from ..model.model import Model
from .ears import Partition
from .errors import AssemblyError, PartitionError
from .partition import partition
from .speed_groups import speed_groups


def second_partition(model: Model, first: Partition) -> Partition | None:
    """The partition that shares the fewest independent speeds with the first one; of several the best conditioned.

    Each dependent speed in turn is asked to be independent instead of the hints, then each other one together with it, as long as
    fewer are shared: a loop at its dead point for one choice of independents is seldom at one for another, and what both
    choices share may be what fails. None where no other choice closes the loops.

    Parameters
    ----------
    model : Model
    first : Partition
        Its independent speeds are to be avoided.
    """
    coordinate = _coordinate_of_speeds(model)
    names = [coordinate[u] for ear in first.ears for u in ear.dependent if u in coordinate]
    asked: tuple[str, ...] = ()
    tried = 0
    best: Partition | None = None

    def judged(found: Partition) -> tuple[int, float]:
        return len({*found.independent} & {*first.independent}), worst(found)

    while best is None or judged(best)[0]:
        before = best
        for name in names:
            if name in asked:
                continue
            tried += 1
            try:
                found = partition(dataclasses.replace(model, independent=(*asked, name)))
            except (AssemblyError, PartitionError):
                continue
            if found.independent == first.independent:
                continue
            if best is None or judged(found) < judged(best):
                best, better = found, name
            if len(first.ears) > MANY:
                return best
        if best is None or tried > MOST_TRIED or (before is not None and judged(best)[0] == judged(before)[0]):
            break
        asked = (*asked, better)
    return best


MANY = 20
"""With more ears than this the first other choice serves: each one costs a whole partition."""


MOST_TRIED = 40
"""No more speeds are asked for together after so many partitions."""


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
