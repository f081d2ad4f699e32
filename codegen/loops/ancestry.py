"""Relations of bodies in the tree without walking its paths: where two paths meet, and which loops pass a joint.

Each cycle of a ladder can be as long as the ladder, so listing all of them takes quadratic time. Questions about cycles are
therefore answered here without listing their bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ..model.vectors import Array


class Ancestry:
    """The tree of bodies, prepared for questions about cycles.

    Parameters
    ----------
    parent : sequence of int
        Parent of every body; the bodies next to the ground have `ground`.
    depth : sequence of int
        Number of joints to the ground: of every body, then of the ground (zero).
    outward : sequence of int
        Bodies, parents first.
    ground : int
    """

    def __init__(self, parent: Sequence[int], depth: Sequence[int], outward: Sequence[int], ground: int):
        self.parent, self.depth, self.ground = parent, depth, ground
        # for every body, the inboard body to which it jumps: past the next two jumps of its parent if these are
        # equally long, otherwise the parent
        self._jump = [ground] * (ground + 1)
        inside = [1] * (ground + 1)
        for k in outward:
            a, b = parent[k], self._jump[parent[k]]
            even = depth[a] - depth[b] == depth[b] - depth[self._jump[b]]
            self._jump[k] = self._jump[b] if even else a
        for k in reversed(outward):
            inside[parent[k]] += inside[k]
        # positions in an order in which all bodies outboard of a body directly follow it
        self._first = [0] * (ground + 1)
        free = [1] * (ground + 1)
        for k in outward:
            self._first[k] = free[parent[k]]
            free[parent[k]] += inside[k]
            free[k] = self._first[k] + 1
        self._end = [f + n for f, n in zip(self._first, inside, strict=True)]

    def meeting(self, a: int, b: int) -> int:
        """The body, or the ground, at which the paths from two bodies to the ground meet."""
        depth, parent, jump = self.depth, self.parent, self._jump
        while depth[a] > depth[b]:
            a = jump[a] if depth[jump[a]] >= depth[b] else parent[a]
        while depth[b] > depth[a]:
            b = jump[b] if depth[jump[b]] >= depth[a] else parent[b]
        while a != b:
            a, b = (jump[a], jump[b]) if jump[a] != jump[b] else (parent[a], parent[b])
        return a

    def carries(self, a: int, b: int) -> bool:
        """Whether body `a` is body `b` or is inboard of it."""
        return self._first[a] <= self._first[b] < self._end[a]

    def sums(self, values: Sequence[int], outward: Sequence[int]) -> list[int]:
        """Sums of the joints' values along the path from the ground to each body; the last entry is the ground's."""
        found = [0] * (self.ground + 1)
        for k in outward:
            found[k] = found[self.parent[k]] + values[k]
        return found

    def passing(self, starts: Sequence[int], ends: Sequence[int]) -> Callable[[int], Array]:
        """A function that returns all cycles that contain a joint: those with exactly one end outboard of the joint."""
        first = np.array(self._first)
        places = [first[np.array(x, dtype=int)] for x in (starts, ends)]
        orders = [np.argsort(x, kind="stable") for x in places]
        in_order = [x[order] for x, order in zip(places, orders, strict=True)]

        def of(joint: int) -> Array:
            low, high = self._first[joint], self._end[joint]
            found = []
            for mine, order, others in zip(in_order, orders, reversed(places), strict=True):
                here = order[np.searchsorted(mine, low) : np.searchsorted(mine, high)]
                other = others[here]
                found.append(here[(other < low) | (other >= high)])
            return np.concatenate(found)

        return of


class NewJoints:
    """The joints of a cycle that are on no earlier cycle. Each joint is visited once, however long the cycles are."""

    def __init__(self, ancestry: Ancestry):
        self.ancestry = ancestry
        self._next = list(range(ancestry.ground + 1))
        """For each body, the nearest body inboard, or itself, whose joint may be on no cycle yet."""

    def of(self, start: int, end: int) -> Iterator[int]:
        """Bodies of the new joints on the cycle of two bodies, from the cut inward: the start side first, then the end
        side."""
        depth = self.ancestry.depth
        base = depth[self.ancestry.meeting(start, end)]
        for k in (start, end):
            k = self._from(k)
            while depth[k] > base:
                yield k
                self._next[k] = self.ancestry.parent[k]
                k = self._from(k)

    def _from(self, k: int) -> int:
        found = self._next
        while found[k] != k:
            found[k] = found[found[k]]
            k = found[k]
        return k


__all__ = ["Ancestry", "NewJoints"]
