"""Checks of a model's loops and couplings, and of the coordinates under `independent`."""

from __future__ import annotations

from ..model.errors import nearest
from ..model.model import Model
from .errors import PartitionError, loops_named
from .geometry import Geometry
from .ordering import Draft


def check_cycles(geometry: Geometry) -> None:
    """Check that every loop contains a joint with a degree of freedom."""
    sums = geometry.ancestry.sums([len(speeds) for speeds in geometry.speeds], geometry.model.outward)
    for i, loop in enumerate(geometry.model.loops):
        if loop.is_coupling:
            continue
        start, end = geometry.starts[i], geometry.ends[i]
        if sums[start] + sums[end] == 2 * sums[geometry.ancestry.meeting(start, end)]:
            names = [
                geometry.model.bodies[k].name if k < geometry.ground else "ground"
                for k in (geometry.starts[i], geometry.ends[i])
            ]
            raise PartitionError(
                f"loop {loop.name} joins {names[0]} and {names[1]}, which cannot move relative to each other (rank 0): "
                f"no joint on the path between them has a degree of freedom; remove the loop"
            )


def check_couplings(model: Model, drafts: list[Draft]) -> None:
    """Check that every coupling determines a coordinate. Redundant couplings would be consistent only for special
    values of the parameters.

    In an ear with loops one of the conditions may be redundant, but no single condition can be named.
    """
    for draft in drafts:
        if draft.rows > len(draft.dependent) and all(model.loops[i].is_coupling for i in draft.loops):
            others = [i for d in drafts for i in d.loops if d is not draft]
            cause = "fewer couplings already determine their coordinates"
            if len(draft.loops) == 1:
                cause = f"{loops_named(model, others)} already determine{'s' * (len(others) == 1)} its coordinates"
            raise PartitionError(
                f"{loops_named(model, draft.loops)}: {cause}; remove one of them, or let one couple a coordinate that is "
                f"still independent"
            )


def hinted(geometry: Geometry) -> set[int]:
    """Speeds that the model lists as independent; all speeds of a quaternion joint if any of its coordinates is listed."""
    model, held = geometry.model, set[int]()
    place = {name: i for i, name in enumerate(model.coordinate_names)}
    body = {i: k for k, (q, _) in enumerate(model.coordinate_slices) for i in range(q.start, q.stop)}
    for name in model.independent:
        if name not in place:
            raise PartitionError(
                f"independent: {name!r} is not a coordinate of the model{nearest(name, model.coordinate_names)}"
            )
        k = body[place[name]]
        q, speeds = geometry.slices[k][0], geometry.speeds[k]
        held |= set(speeds) if geometry.whole[k] else {speeds[place[name] - q.start]}
    return held
