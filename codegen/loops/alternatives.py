"""Other partitions of the speeds, for configurations where the first one is ill conditioned."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from ..model.model import Model
from .ears import Partition
from .errors import AssemblyError, PartitionError
from .partition import partition
from .speed_groups import speed_groups


def other_partition(model: Model, known: Sequence[Partition]) -> Partition | None:
    """Another partition, which shares as few independent speeds as possible with the known ones; None if there is none.

    Each dependent speed in turn is requested as independent instead of the model's hints. Then each other speed is
    requested together with the best one, as long as this reduces the number of shared speeds. A loop that is singular
    for one choice of independent speeds is seldom singular for another; if it is, speeds of both choices may be the
    cause. If several partitions are known, the largest number of speeds shared with one of them counts. Among
    candidates that share equally many, the best conditioned one is taken.

    Parameters
    ----------
    model : Model
    known : sequence of Partition
        Partitions whose independent speeds are to be avoided.
    """
    coordinate = _coordinate_of_speeds(model.released)
    names = list(
        dict.fromkeys(coordinate[u] for k in known for ear in k.ears for u in ear.dependent if u in coordinate)
    )
    asked: tuple[str, ...] = ()
    tried = 0
    best: Partition | None = None

    def cost(found: Partition) -> tuple[int, int, float]:
        shared = [len({*found.independent} & {*k.independent}) for k in known]
        return max(shared), sum(shared), worst(found)

    while best is None or cost(best)[0]:
        before = best
        for name in names:
            if name in asked:
                continue
            tried += 1
            try:
                found = partition(dataclasses.replace(model, independent=(*asked, name)))
            except (AssemblyError, PartitionError):
                continue
            if any(found.independent == k.independent for k in known):
                continue
            if best is None or cost(found) < cost(best):
                best, better = found, name
            if len(known[0].ears) > MANY:
                return best
        if best is None or tried > MOST_TRIED or (before is not None and cost(best)[:2] == cost(before)[:2]):
            break
        asked = (*asked, better)
    return best


MANY = 20
"""With more ears than this, the first other choice is taken, because each candidate requires the computation of a whole
partition."""


MOST_TRIED = 40
"""Number of partitions after which no further combination of speeds is tried."""


def worst(chosen: Partition) -> float:
    """The largest condition number of all ears of a partition."""
    return max((ear.condition for ear in chosen.ears), default=1.0)


def _coordinate_of_speeds(model: Model) -> dict[int, str]:
    """Names of the coordinates whose rates are single speeds, by the speed's index."""
    return {
        group.speeds.start: model.coordinate_names[group.coordinates.start]
        for group in speed_groups(model)
        if len(group.speeds) == 1
    }
