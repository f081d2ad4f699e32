"""The partition of a model as text."""

from __future__ import annotations

from ..model.model import Model
from .ears import Ear, Partition
from .errors import listed, loops_counted

LINES = 12
"""Number of ears above which equal ears share a line."""


def describe(model: Model, partition: Partition) -> list[str]:
    """Lines for the user: loops, ears, dependents, ranks, redundant conditions, clusters and degrees of freedom.

    Prescribed coordinates are not counted as degrees of freedom; the partition is that of the released model.
    """
    prescribed, model = set(model.prescribed_names), model.released
    if not partition.ears:
        return []
    ears, names = partition.ears, model.speed_names
    rows, rank = sum(ear.rows for ear in ears), sum(ear.rank for ear in ears)
    count = loops_counted(model)
    if clusters := sum(len(ear.loops) > 1 for ear in ears):
        count += f" ({clusters} cluster{'s' * (clusters > 1)})"
    free = [names[s] for s in partition.independent if names[s] not in prescribed]
    freedoms = f"{len(free) or 'no'} degree{'s' * (len(free) > 1)} of freedom"
    driven = listed([names[s] for s in partition.independent if names[s] in prescribed])
    lines = [
        f"{count}: {rank} of {len(names)} speeds are dependent, {freedoms}"
        f"{': ' * bool(free)}{listed(free) if free else ''}{f'; prescribed: {driven}' if prescribed else ''}"
    ]
    type_of = [
        b.joint.type
        for b, (_, u) in zip(model.bodies, model.coordinate_slices, strict=True)
        for _ in range(u.start, u.stop)
    ]
    alike: dict[tuple[object, ...], list[Ear]] = {}
    for i, ear in enumerate(ears):
        kind = (
            tuple(model.loops[k].type for k in ear.loops),
            ear.rank,
            ear.rows,
            tuple(type_of[s] for s in ear.dependent),
        )
        alike.setdefault(kind if len(ears) > LINES else (i,), []).append(ear)
    lines += [_line(model, group) for group in alike.values()]
    dependent = set(partition.dependent)
    for group in partition.split(model):
        first, second = ([names[s] for s in group.speeds if (s in dependent) is which] for which in (True, False))
        what = "quaternion" if group.coordinates.stop - group.coordinates.start == 4 else "position"
        lines.append(
            f"  {model.bodies[group.body].name} is split: {listed(first)} dependent, {listed(second)} independent; its {what} "
            f"counts as independent"
        )
    lines += _comparison(model, partition)
    if rank < rows:
        lines.append(f"{rows - rank} of {rows} conditions are redundant; the joint reactions to them are not unique")
    lines += partition.remarks
    if partition.opening:
        opened = listed([model.parameter_names[j] for j in partition.opening])
        lines.append(
            f"changing one of these parameters alone opens redundant conditions: {opened}; derivatives with respect to them "
            f"are those of the nearest motion, and a warning is issued"
        )
    return lines + [f"warning: {text}" for text in partition.warnings]


def _comparison(model: Model, partition: Partition) -> list[str]:
    """Lines about the quality of the choice for the worst component, and about components that were not compared."""
    lines = []
    compared = partition.compared
    if compared:
        found = min(compared, key=lambda c: c.worth)
        which = ""
        if len(compared) > 1:
            which = f" of {listed([model.loops[i].name for i in found.loops])}, the worst of {len(compared)},"
        other = "choice by pivoting"
        text = f"  all dependent speeds{which} together: condition number {found.condition:.2g} ({other}: {found.pivoted:.2g})"
        if found.worst == found.worst:
            text += f"; at most {found.worst:.2g} in 75% of other states ({other}: {found.worst_pivoted:.2g})"
        if found.reach == found.reach:
            text += f"; the loops close after {found.reach:.0%} of random displacements"
        lines.append(text)
    if partition.uncompared:
        lines.append(
            f"  {partition.uncompared} loops not compared with pivoting, which would be dense; their dependent speeds are at "
            f"most {partition.growth:.2g} times the independent ones"
        )
    return lines


def _line(model: Model, ears: list[Ear]) -> str:
    """The line that describes one ear, or several equal ears."""
    first, last = ears[0], ears[-1]
    names = [listed([model.loops[i].name for i in ear.loops]) for ear in (first, last)]
    text = f"cluster of {names[0]}" if len(first.loops) > 1 else names[0]
    if len(ears) > 1:
        text += f" and {len(ears) - 1} alike, the last {names[1]}"
    dependent = listed([model.speed_names[s] for s in first.dependent]) or "no speeds"
    worst = max(ear.condition for ear in ears)
    if len(ears) == 1 and all(model.loops[i].is_coupling for i in first.loops):
        return f"  {text}: {dependent} dependent"
    redundant = f", {first.redundant} redundant" if first.redundant else ""
    return (
        f"  {text}: {dependent} dependent{' (of the first)' * (len(ears) > 1)}; rank {first.rank} of {first.rows} "
        f"conditions{redundant}; condition number {worst:.2g}"
    )
