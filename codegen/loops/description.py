"""What the partition of a model is, in words."""

from __future__ import annotations

from ..model.model import Model
from .partition import Partition


def describe(model: Model, partition: Partition) -> list[str]:
    """Readable lines about loops, ears, dependents, ranks, redundant conditions and freedoms."""
    lines = []
    for ear in partition.ears:
        names = ", ".join(model.loops[i].name for i in ear.loops)
        dependent = ", ".join(model.speed_names[s] for s in ear.dependent)
        lines.append(f"{names}: {dependent}; rank {ear.rank} of {ear.rows}, condition {ear.condition:.3g}")
    return lines
