"""Demands on loops: `independent` of the model, and what every loop and coupling needs."""

from __future__ import annotations

from ..model.errors import nearest
from ..model.model import Model
from .errors import PartitionError, loops_named
from .geometry import Geometry
from .ordering import Draft


def check_cycles(geometry: Geometry) -> None:
    """Check that every loop contains a joint that moves."""
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
                f"loop {loop.name} joins {names[0]} and {names[1]}, which cannot move to each other (rank 0): "
                f"no joint on the way between them has a freedom; remove the loop"
            )


def check_couplings(model: Model, drafts: list[Draft]) -> None:
    """Check that every coupling determines a coordinate: ratios that agree by chance would do so for one design only.

    In an ear with loops one of the conditions may be redundant; it is not defined which one.
    """
    for draft in drafts:
        if draft.rows > len(draft.dependent) and all(model.loops[i].is_coupling for i in draft.loops):
            others = [i for d in drafts for i in d.loops if d is not draft]
            what = "what they relate is determined by fewer of them"
            if len(draft.loops) == 1:
                what = f"its coordinates are determined already, by {loops_named(model, others)}"
            raise PartitionError(
                f"{loops_named(model, draft.loops)}: {what}; take one of them away, or let one relate a coordinate that is "
                f"free"
            )


def hinted(geometry: Geometry) -> set[int]:
    """Speeds that the model lists as independent; all of a quaternion joint, whichever is named."""
    model, held = geometry.model, set[int]()
    place = {name: i for i, name in enumerate(model.coordinate_names)}
    body = {i: k for k, (q, _) in enumerate(model.coordinate_slices) for i in range(q.start, q.stop)}
    for name in model.independent:
        if name not in place:
            raise PartitionError(
                f"independent: {name!r} is no coordinate of the model{nearest(name, model.coordinate_names)}"
            )
        k = body[place[name]]
        q, speeds = geometry.slices[k][0], geometry.speeds[k]
        held |= set(speeds) if geometry.whole[k] else {speeds[place[name] - q.start]}
    return held
