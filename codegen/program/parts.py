"""A long block as several that run one after the other: compilers take more than twice the time for code twice as long."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate, pairwise

from .block import Block, Component, Statement, symbols_of
from .expressions import Expr, Symbol
from .passes import by_results
from .store import Store

LONGEST = 1000
"""Statements; longer blocks are divided."""

PART = 300
"""About so many statements are a part."""

WINDOW = 60
"""It may be so many more or fewer, where less is handed on then."""


def in_parts(
    block: Block, handed_on: Callable[[int], Component], is_stored: Callable[[Component], bool]
) -> tuple[list[Block], int]:
    """The parts of a block, and how many values later parts take from earlier ones; the block itself where it is short.

    Parameters
    ----------
    block : Block
        Without values per direction.
    handed_on : callable (int) -> (Store, component)
        Where the values lie that later parts need.
    is_stored : callable ((Store, component)) -> bool
        Whether the block itself stores something there: what it loads is what was there before.
    """
    if len(block.statements) <= LONGEST:
        return [block], 0
    first = [s for s, at in block.loads.items() if is_stored(at)]
    steps: list[Statement | tuple[Store, str, Expr]] = []
    for statements, stores in by_results(block):
        steps += [*statements, *stores]
    made = dict.fromkeys(first, 0)
    last: dict[Symbol, int] = {}
    for i, step in enumerate(steps):
        value = step.expression if isinstance(step, Statement) else step[2]
        last.update(dict.fromkeys(symbols_of(value), i))
        if isinstance(step, Statement):
            made[step.target] = i
    ends = _ends(len(steps), [(i, last[s]) for s, i in made.items() if s in last])
    places: dict[Symbol, Component] = {}
    parts = []
    for begin, end in pairwise(ends):
        part = Block(block.name, block.title)
        needed: dict[Symbol, None] = {}
        for step in steps[begin:end]:
            value = step.expression if isinstance(step, Statement) else step[2]
            needed |= dict.fromkeys(sorted(symbols_of(value), key=str))
            if isinstance(step, Statement):
                part.statements.append(step)
            else:
                part.stores.append(step)
        mine = {s.target for s in part.statements} | ({*first} if not begin else set())
        part.loads = {
            s: places[s] if s in places else block.loads[s] for s in needed if s in places or s in block.loads
        }
        for symbol in [*(first if not begin else ()), *(s.target for s in part.statements)]:
            if symbol in mine and last.get(symbol, -1) >= end:
                places[symbol] = handed_on(len(places))
                part.stores.append((*places[symbol], symbol))
                if symbol in block.loads:
                    part.loads[symbol] = block.loads[symbol]
        parts.append(part)
    return parts, len(places)


def _ends(count: int, lives: list[tuple[int, int]]) -> list[int]:
    """Where parts begin and end, where few of the values are made before and used behind."""
    change = [0] * (count + 1)
    for begin, end in lives:
        if begin < end:
            change[begin + 1] += 1
            change[end + 1] -= 1
    alive = list(accumulate(change))
    ends = [0]
    while count - ends[-1] > PART + WINDOW:
        middle = ends[-1] + PART
        ends.append(min(range(middle - WINDOW, middle + WINDOW), key=lambda i: (alive[i], abs(i - middle))))
    return [*ends, count]


__all__ = ["in_parts"]
