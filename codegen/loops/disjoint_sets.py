"""Disjoint sets of integers that can be merged (union-find with path halving: R. E. Tarjan, J. ACM 22 (1975), 215-225)."""

from __future__ import annotations


class DisjointSets:
    """Disjoint sets of the numbers 0 to n - 1, at first one set for each; one member identifies each set."""

    def __init__(self, n: int) -> None:
        self._towards = list(range(n))

    def find(self, i: int) -> int:
        """The member that identifies the set that contains i."""
        towards = self._towards
        while towards[i] != i:
            towards[i] = towards[towards[i]]
            i = towards[i]
        return i

    def join(self, i: int, into: int) -> None:
        """Merge the set of i into the set of `into`, which keeps its identifying member."""
        self._towards[self.find(i)] = self.find(into)

    def members(self) -> dict[int, list[int]]:
        """The sets by their identifying members, in the order of their first members."""
        found: dict[int, list[int]] = {}
        for i in range(len(self._towards)):
            found.setdefault(self.find(i), []).append(i)
        return found
