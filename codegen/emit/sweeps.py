"""Functions of links and the loops that call them in the order of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, cached_property, partial

from ..program.addresses import Kind
from ..program.block import Block
from ..program.counting import sweeps as sweeps_run
from ..program.plan import Merged
from ..program.store import ARGUMENT, MARGIN, Store
from .function import Function
from .language import Language, Located
from .notes import notes

MAX_STRETCHES = 24
"""A sweep calls its functions in separate loops, one for each stretch of links with a repeated pattern of kinds. If there are
more stretches than this, a single loop selects the function by the kind of each link."""


IDLE = -1
"""Entry of the pattern for a kind that has no block in the sweep."""


class SweepWriter(Language):
    """Writes the functions of sweeps."""

    @cached_property
    def blocks(self) -> dict[str, dict[int, Block]]:
        """Blocks by sweep and kind, for called sweeps that store something."""
        run = sweeps_run(self.asked)
        found = self.plan.sweeps.items()
        return {s: of.blocks for s, of in found if s in run and any(block.stores for block in of.blocks.values())}

    def shared(self, sweep: str) -> list[tuple[Kind, ...]]:
        """Kinds that have a block in a sweep, grouped so that the functions of a group differ only in rows."""
        if sweep not in self._shared:
            found: dict[object, list[Kind]] = {}
            for kind in self.plan.sweeps[sweep].kinds:
                block = self.plan.sweeps[sweep].blocks.get(kind.index)
                if block is not None and block.stores:
                    found.setdefault(self._form(kind, sweep, block), []).append(kind)
            self._shared[sweep] = [tuple(kinds) for kinds in found.values()]
        return self._shared[sweep]

    def _form(self, kind: Kind, sweep: str, block: Block) -> object:
        """The properties that must be equal for blocks to share a function: statements, and addresses without the numbers of
        rows."""

        def form(store: Store, name: str) -> tuple[object, ...]:
            if store.memory is MARGIN:
                return (name,)
            return self.addresses.address(kind, sweep, store, name).form_of_code

        loads = tuple((symbol, store, form(store, name)) for symbol, (store, name) in block.loads.items())
        stores = tuple((store, form(store, name), value) for store, name, value in block.stores)
        return block.title, loads, tuple(block.statements), stores

    def instances(self, kinds: Sequence[Kind], sweep: str) -> list[int]:
        """The values of the argument i with which the generated code calls a shared function."""
        return [i for kind in kinds for i in self.addresses.instances(kind, sweep)]

    def link_function(self, sweep: str, kinds: tuple[Kind, ...]) -> Function:
        """The function for some kinds of links, ears or regions, named after the number of the first kind."""
        block = self.blocks[sweep][kinds[0].index]
        single = len(self.instances(kinds, sweep)) == 1
        signature = self.signature(f"{sweep}_{kinds[0].index}", self.plan.sweeps[sweep].lanes, not single)
        place = cache(partial(self.place, kinds, sweep))  # `lines_of` requests each place several times
        lines = self.lines_of(block, place, self.addresses.culprit(kinds, sweep), self.each(kinds, sweep))
        return Function(f"{block.title}; {self.called(kinds)}", signature, lines, notes(block))

    def called(self, kinds: tuple[Kind, ...]) -> str:
        """The comment that names the units for which a function is called."""
        (what, first), count = self.plan.called[kinds[0]], sum(len(kind.members) for kind in kinds)
        return first if count == 1 else f"{count} {what}: {first}, ..."

    def merged_function(self, sweep: str, merged: Merged) -> Function:
        """The function of a sweep whose blocks have been combined into one."""
        spec, variables = self.plan.sweeps[sweep], dict[str, str]()
        kinds = {str(kind.index): kind for kind in spec.kinds}

        @cache
        def place(store: Store, name: str) -> Located:
            kind, of = merged.of[store.plain]
            if of.memory is ARGUMENT:
                return self.element(of.name, name)
            at = self.place((kind,), sweep, of, name)
            return replace(at, variable=variables.setdefault(at.row, f"{at.variable}_{kind.index}"))

        def culprit(margin: str) -> str:
            kind, _, name = margin.partition(".")
            return self.addresses.culprit((kinds[kind],), sweep)(name)

        lines = self.lines_of(merged.block, place, culprit)
        return Function(spec.title, self.signature(sweep, spec.lanes, False), lines, notes(merged.block))

    def loop(self, sweep: str) -> Function:
        """The loop over the links or units of a sweep, or the whole sweep if its blocks are combined."""
        spec = self.plan.sweeps[sweep]
        if spec.merged is not None:
            return self.merged_function(sweep, spec.merged)
        shared = self.shared(sweep)
        first = {kind.index: kinds[0].index for kinds in shared for kind in kinds}
        kinds = [first.get(k.index, IDLE) for k in spec.order]
        if spec.then and spec.then in self.blocks:
            return self.loop_of_two(sweep, spec.then)
        single = {kinds[0].index: len(self.instances(kinds, sweep)) == 1 for kinds in shared}
        f = Function(spec.title, self.signature(sweep, spec.lanes, False))

        def call(kind: int, i: str) -> list[str]:
            if kind == IDLE:
                return []
            return [self.call(f"{sweep}_{kind}", spec.lanes, None if single[kind] else i)]

        parts = stretches(kinds)
        if len(parts) <= MAX_STRETCHES or len(single) == len(kinds):
            for start, pattern, count in reversed(parts) if spec.inward else parts:
                order = list(reversed(range(len(pattern)))) if spec.inward else list(range(len(pattern)))
                if count == 1:
                    for o in order:
                        f.lines += call(pattern[o], str(start + o))
                    continue
                calls = [c for o in order for c in call(pattern[o], f"i + {o}" if o else "i")]
                if calls:
                    step = len(pattern)
                    f.lines += self.repeat(start, start + step * count, step, spec.inward, calls)
        else:
            of_kind = [k.index for k in spec.order]
            entry = self.addresses.table(sweep).entry("KIND", list(range(len(kinds))), of_kind)
            cases = [([k.index for k in of], c) for of in shared for c in call(of[0].index, "i")]
            f.lines += self.dispatch(len(kinds), spec.inward, entry, cases)
        return f

    def loop_of_two(self, sweep: str, then: str) -> Function:
        """The loop over all links that alternates between two sweeps."""
        both: list[list[Kind | None]] = []
        for name in (sweep, then):
            of = {kind: kinds[0] for kinds in self.shared(name) for kind in kinds}
            both.append([of.get(k) for k in self.plan.sweeps[name].order])
        numbers: dict[tuple[Kind | None, ...], int] = {}
        sequence = [numbers.setdefault(pair, len(numbers)) for pair in zip(*both, strict=True)]
        pairs = list(numbers)
        single = {
            (name, kinds[0]): len(self.instances(kinds, name)) == 1
            for name in (sweep, then)
            for kinds in self.shared(name)
        }
        lanes = self.plan.sweeps[sweep].lanes

        def call(pair: int, i: str) -> list[str]:
            return [
                self.call(f"{name}_{kind.index}", lanes, None if single[name, kind] else i)
                for name, kind in zip((sweep, then), pairs[pair], strict=True)
                if kind is not None
            ]

        f = Function(self.plan.sweeps[sweep].title, self.signature(sweep, lanes, False))
        for start, pattern, times in stretches(sequence):
            places = [str(start + o) if times == 1 else f"i + {o}" if o else "i" for o in range(len(pattern))]
            calls = [c for pair, i in zip(pattern, places, strict=True) for c in call(pair, i)]
            step = len(pattern)
            f.lines += calls if times == 1 else self.repeat(start, start + step * times, step, False, calls)
        return f

    def sweep_functions(self, sweep: str) -> list[Function]:
        if self.plan.sweeps[sweep].merged is not None:
            return [self.loop(sweep)]
        functions = [f for kinds in self.shared(sweep) for f in self.link_functions(sweep, kinds)]
        if any(of.then == sweep for of in self.plan.sweeps.values()):
            return functions  # the loop of another sweep calls these functions
        return [*functions, self.loop(sweep)]

    def link_functions(self, sweep: str, kinds: tuple[Kind, ...]) -> list[Function]:
        """The function of some kinds of links; if it is divided, its parts come first."""
        return [self.link_function(sweep, kinds)]


def stretches(kinds: list[int], longest: int = 8) -> list[tuple[int, tuple[int, ...], int]]:
    """A sequence as repeated patterns: (start, pattern, repetitions). The search is greedy, in time linear in the length."""
    result: list[tuple[int, tuple[int, ...], int]] = []
    i, n = 0, len(kinds)
    while i < n:
        best, covered = 1, 1
        for period in range(1, longest + 1):
            j = i
            while j + period < n and kinds[j] == kinds[j + period]:
                j += 1
            total = (j - i) // period * period + period
            if total >= 2 * period and total > covered:
                best, covered = period, total
        result.append((i, tuple(kinds[i : i + best]), covered // best))
        i += covered
    return result
