"""Numbers in sets that become one (union-find: R. E. Tarjan, J. ACM 22 (1975), 215-225; paths are halved)."""

from __future__ import annotations


class DisjointSets:
    """The numbers 0 to n - 1, at first each in a set of its own; a set is known by one of its members."""

    def __init__(self, n: int) -> None:
        self._towards = list(range(n))

    def find(self, i: int) -> int:
        """The member by which the set of i is known."""
        towards = self._towards
        while towards[i] != i:
            towards[i] = towards[towards[i]]
            i = towards[i]
        return i

    def join(self, i: int, into: int) -> None:
        """The set of i becomes part of another, which stays known as it is."""
        self._towards[self.find(i)] = self.find(into)

    def members(self) -> dict[int, list[int]]:
        """The sets by what they are known by, in the order of their first members."""
        found: dict[int, list[int]] = {}
        for i in range(len(self._towards)):
            found.setdefault(self.find(i), []).append(i)
        return found
