"""Division of a long block into parts that run in sequence: compile time grows faster than linearly with the length of code."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable
from itertools import accumulate, pairwise

from .algebra import Expr, Symbol
from .block import Block, Component, Statement, symbols_of
from .passes import Step, in_order

LONGEST = 3000
"""A block is divided if its statements and stores read more values than this. Values are counted instead of statements, since
compile time depends on operations, and a sum of forty products is one statement."""

PART = 1000
"""Approximate number of values that a part reads."""

WINDOW = 200
"""A part may be longer or shorter by this much, so that fewer values have to be kept for later parts."""


def in_parts(
    block: Block, carried_over: Callable[[int, bool], Component], is_stored: Callable[[Component], bool]
) -> tuple[list[Block], dict[bool, int]]:
    """Divide a block into parts; a short block is returned unchanged.

    Parameters
    ----------
    block : Block
    carried_over : callable (int, bool) -> (Store, component)
        Returns the place of a value that later parts need, from its number and whether there is one value per direction.
    is_stored : callable ((Store, component)) -> bool
        Returns whether the block stores to this place. Loads from such a place read the value before the block runs.

    Returns
    -------
    parts : list of Block
    places : dict of bool to int
        Number of places for values that later parts need: shared by all directions (False) and per direction (True).
    """
    values = (*(s.expression for s in block.statements), *(value for _, _, value in block.stores))
    if sum(len(symbols_of(e)) for e in values) <= LONGEST:
        return [block], {}
    steps = in_order(block)
    lengths = [len(symbols_of(_value(step))) for step in steps]
    first = [s for s, at in block.loads.items() if is_stored(at)]
    made = dict.fromkeys(first, 0)
    last: dict[Symbol, int] = {}
    for i, step in enumerate(steps):
        last.update(dict.fromkeys(symbols_of(_value(step)), i))
        if isinstance(step, Statement):
            made[step.target] = i
    along = {s for s, (store, _) in block.loads.items() if store.lanes}
    along |= {s.target for s in block.statements if s.lanes}
    ends = _ends(lengths, [(i, last[s]) for s, i in made.items() if s in last])
    carried = _CarriedOver(carried_over)
    parts = []
    for begin, end in pairwise(ends):
        carried.forget({s for s in carried.places if last[s] < begin})
        part = Block(block.name, block.title)
        needed: dict[Symbol, None] = {}
        for step in steps[begin:end]:
            needed |= dict.fromkeys(sorted(symbols_of(_value(step)), key=str))
            if isinstance(step, Statement):
                part.statements.append(step)
            else:
                part.stores.append(step)
        part.loads = {s: at for s in needed if (at := carried.places.get(s) or block.loads.get(s))}
        for symbol in [*(first if not begin else ()), *(s.target for s in part.statements)]:
            if last.get(symbol, -1) >= end:
                part.stores.append((*carried.place(symbol, symbol in along), symbol))
                if symbol in block.loads:
                    part.loads[symbol] = block.loads[symbol]
        parts.append(part)
    return parts, carried.counts


def _value(step: Step) -> Expr:
    return step.expression if isinstance(step, Statement) else step[2]


class _CarriedOver:
    """Places of values that later parts need; a place is reused when its value is no longer needed."""

    def __init__(self, at: Callable[[int, bool], Component]):
        self.at = at
        self.places: dict[Symbol, Component] = {}
        self.counts: dict[bool, int] = {}
        self._numbers: dict[Symbol, tuple[bool, int]] = {}
        self._free: dict[bool, list[int]] = {False: [], True: []}

    def place(self, symbol: Symbol, along: bool) -> Component:
        free = self._free[along]
        number = free.pop() if free else self.counts.get(along, 0)
        self.counts[along] = max(self.counts.get(along, 0), number + 1)
        self._numbers[symbol] = along, number
        self.places[symbol] = self.at(number, along)
        return self.places[symbol]

    def forget(self, unneeded: Iterable[Symbol]) -> None:
        for symbol in sorted(unneeded, key=str):
            along, number = self._numbers.pop(symbol)
            self._free[along].append(number)
            del self.places[symbol]


def _ends(lengths: list[int], lives: list[tuple[int, int]]) -> list[int]:
    """Boundaries of parts, chosen so that few values have to be kept for later parts."""
    count = len(lengths)
    change = [0] * (count + 1)
    for begin, end in lives:
        if begin < end:
            change[begin + 1] += 1
            change[end + 1] -= 1
    alive = list(accumulate(change))
    before = [0, *accumulate(lengths)]
    ends = [0]
    while before[-1] - before[ends[-1]] > PART + WINDOW:
        middle = before[ends[-1]] + PART
        first = bisect_left(before, middle - WINDOW, ends[-1] + 1)
        near = range(
            first, max(bisect_left(before, middle + WINDOW), first + 1)
        )  # one statement may be longer than the window
        ends.append(min(near, key=lambda i: (alive[i], abs(before[i] - middle))))
    return ends if ends[-1] == count else [*ends, count]
