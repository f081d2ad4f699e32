"""Groups of bodies whose motion is computed together: the graph part of sections 3.3 and 3.4 of the paper, for any loops.

The dependent speeds of an *ear* (of the ear decomposition of the loop graph) close it. On either branch of a loop, the ear
contains the first body that such a speed moves and all bodies outboard of it. The motion of these members follows from the
independent joints among them and from bodies whose motion is known, the ear's *ends*. In the paper, one end is the loop base
body 0_i, the other is p_i, and the members are p_i + 1 to n_i. Loops of a cluster are closed together and have several ends.
Every other body of the tree is a group of its own; its end is its parent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

from ..loops.disjoint_sets import DisjointSets
from ..loops.partition import Ear, Partition
from ..model.model import GROUND, Coupling, Model


@dataclass(frozen=True, slots=True)
class Group:
    """Bodies whose motion is computed together: a single one, or the members of an ear or a cluster.

    Attributes
    ----------
    members : tuple of int
        Bodies, every parent before its children.
    ends : tuple of int
        Other bodies on whose motion the members' motion depends, without the ground.
    loops : tuple of int
    dependent, independent : tuple of int
        Speeds of the members' joints.
    """

    members: tuple[int, ...]
    ends: tuple[int, ...]
    loops: tuple[int, ...]
    dependent: tuple[int, ...]
    independent: tuple[int, ...]


def groups(model: Model, partition: Partition, held: Sequence[int] = ()) -> tuple[Group, ...]:
    """All bodies in groups, in outward order: a group comes after the groups from which it starts."""
    together = DisjointSets(len(model.bodies))
    loops_at: list[tuple[int, tuple[int, ...]]] = []  # a member of each ear, and the loops that the ear closes
    for ear in partition.ears:
        members = new_bodies(model, ear)
        _join(together, members)
        if members:
            loops_at.append((members[0], ear.loops))
    while True:
        loops: dict[int, list[int]] = {}
        for member, closed in loops_at:
            loops.setdefault(together.find(member), []).extend(closed)
        graph = _ends(model, together, loops)
        try:
            order = tuple(TopologicalSorter({g: {together.find(k) for k in graph[g]} for g in graph}).static_order())
        except CycleError as cycle:  # ears that depend on each other are closed together
            _join(together, list(cycle.args[1]))
            continue
        break
    dependent = {i for ear in partition.ears for i in ear.dependent}
    members_of: dict[int, list[int]] = {}
    for k in model.outward:
        members_of.setdefault(together.find(k), []).append(k)
    result = []
    for g in order:
        speeds = [i for k in members_of[g] for i in _speeds(model, k) if i not in held]
        result.append(
            Group(
                tuple(members_of[g]),
                tuple(sorted(graph[g])),
                tuple(sorted(loops.get(g, ()))),
                tuple(i for i in speeds if i in dependent),
                tuple(i for i in speeds if i not in dependent),
            )
        )
    return tuple(result)


def _join(together: DisjointSets, bodies: Sequence[int]) -> None:
    """Join the groups of some bodies; the joined group is identified by the first body."""
    for k in bodies[1:]:
        first, other = sorted((together.find(bodies[0]), together.find(k)))
        together.join(other, into=first)


def new_bodies(model: Model, ear: Ear) -> list[int]:
    """The members of an ear: bodies that its dependent speeds move.

    Raises
    ------
    ValueError
        If none of the ear's loops passes the joint of one of its dependent speeds.
    """
    moved = {k for k in range(len(model.bodies)) if set(_speeds(model, k)) & set(ear.dependent)}
    found: list[int] = []
    for loop in (model.loops[i] for i in ear.loops):
        # Coupled bodies belong to one group. If some of them were ends of the ear instead, large inertias would
        # cancel in the elimination.
        if isinstance(loop, Coupling):
            found += [term.body for term in loop.terms if term.body not in found]
        for branch in _branches(model, loop.start.body, loop.end.body):
            first = next((i for i, k in enumerate(branch) if k in moved), len(branch))
            found += [k for k in branch[first:] if k not in found]
    if moved - set(found):
        names = ", ".join(model.bodies[k].name for k in sorted(moved - set(found)))
        raise ValueError(f"partition: an ear has dependent speeds at {names}, which its loops do not pass")
    return found


def _ends(model: Model, together: DisjointSets, loops: dict[int, list[int]]) -> dict[int, set[int]]:
    """For each group, the other bodies on which the group depends."""
    ends: dict[int, set[int]] = {together.find(k): set() for k in model.outward}
    for k in model.outward:
        ends[together.find(k)].add(model.bodies[k].parent)
    for g, closed in loops.items():
        ends[g] |= {face.body for i in closed for face in (model.loops[i].start, model.loops[i].end)}
    return {g: {k for k in bodies if k != GROUND and together.find(k) != g} for g, bodies in ends.items()}


def _branches(model: Model, start: int, end: int) -> tuple[list[int], list[int]]:
    """Bodies on the paths from two bodies inward, up to the first body that both paths contain; innermost first."""
    branches = []
    for k in (start, end):
        branch: list[int] = []
        while k != GROUND:
            branch.insert(0, k)
            k = model.bodies[k].parent
        branches.append(branch)
    shared = sum(1 for a, b in zip(*branches, strict=False) if a == b)
    return branches[0][shared:], branches[1][shared:]


def _speeds(model: Model, k: int) -> range:
    rows = model.coordinate_slices[k][1]
    return range(rows.start, rows.stop)
