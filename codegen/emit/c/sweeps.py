"""Functions of sweeps in C: a long function is divided into parts, and each part is compiled in one unit."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from functools import cache, cached_property, partial
from itertools import groupby

from ...program.addresses import Kind
from ...program.parts import in_parts
from ..function import COMMENT, Function
from ..notes import notes
from ..runs import called_for, called_once, widest_first
from .divided import arrays_used, carried_over, in_stack, is_overwritten, linkage, reads, stack
from .language import CLanguage
from .libraries import guard_of_run, sharing
from .types import SHARES, of_width


class CSweeps(CLanguage):
    """Writes functions of links, with the conditions for their compilation."""

    def link_functions(self, sweep: str, kinds: tuple[Kind, ...]) -> list[Function]:
        block = self.blocks[sweep][kinds[0].index]
        place = cache(partial(self.place, kinds, sweep))
        parts, places = in_parts(block, carried_over, is_overwritten(block, place))
        if len(parts) == 1:
            return [self.link_function(sweep, kinds)]
        self.has_parts = True
        lanes, indexed = self.plan.sweeps[sweep].lanes, len(self.instances(kinds, sweep)) != 1
        name, real = f"{sweep}_{kinds[0].index}", self.scalar.word
        whole = Function(
            f"{block.title}; {self.called(kinds)}",
            self.signature(name, lanes, indexed),
            stack(places, real),
            notes(block),
        )
        shared = "" if lanes else self.shared_by_units(sweep)  # functions over directions are compiled in one unit only
        culprit, each = self.addresses.culprit(kinds, sweep), self.each(kinds, sweep)
        functions = []
        for i, part in enumerate(parts, 1):
            lines, used = (
                self.lines_of(part, in_stack(place, real), culprit, each),
                arrays_used(part, real),
            )
            parameters = [("a", "REFUSE"), *([("i", "")] if indexed else [])]
            lines = [*(f"(void){n};" for n, by in parameters if not reads(lines, n, by)), *lines]
            called = f"{name}_part_{i}"
            whose = "PART" if shared else "STATIC_PART"
            f = Function(
                f"part {i} of {name}", self.signature(called, lanes, indexed, whose, used), lines, declared=bool(shared)
            )
            if shared:
                unit = min(SHARES, key=lambda n: (self.lines_of_units[n] / SHARES[n], n))
                self.lines_of_units[unit] += len(lines)
                f.guard = f"!{shared} || ORDERNM_UNIT == {unit}"
            functions.append(f)
            arguments = [*(n for n, _ in parameters), *(n for _, n in used)]
            whole.lines.append(f"{of_width(called, lanes)}({', '.join(arguments)});")
        functions[0].before = linkage(shared) if shared else []
        return [*functions, whole]

    @cached_property
    def all_widths(self) -> dict[str, tuple[int, ...]]:
        """The widths for which each function over directions is written."""
        return {p.name: widest_first(p) for p in self.asked}

    @cached_property
    def runs(self) -> dict[str, dict[int | None, dict[str, set[int]]]]:
        """By name of a sweep, formula or routine, and by the width with which it runs: the functions that call it, with the
        widths of these functions."""
        found: dict[str, dict[int | None, dict[str, set[int]]]] = {}
        for p in self.asked:
            for name in called_once(p):
                found.setdefault(name, {}).setdefault(None, {})[p.name] = {*self.all_widths[p.name]}
            for (name, width), its_widths in called_for(p).items():
                found.setdefault(name, {}).setdefault(width, {})[p.name] = its_widths
        return found

    def where_run(self, named: Iterable[tuple[str, list[Function]]]) -> list[Function]:
        found: list[Function] = []
        for condition, several in groupby(named, lambda x: self.condition(*x)):
            functions = [f for _, of in several for f in of]
            if condition and functions:
                lines = textwrap.wrap(f"#if {condition}", COMMENT, subsequent_indent="    ")
                functions[0].before = [*(f"{line} \\" for line in lines[:-1]), lines[-1], *functions[0].before]
                functions[-1].after = ["#endif"]
            found += functions
        return found

    def condition(self, name: str, functions: list[Function]) -> str:
        """The condition for compiling the functions of a sweep, formula or routine; empty if they are always
        compiled."""
        if name not in self.runs:
            return ""
        shared = any(f.declared for f in functions)
        return guard_of_run(self.runs[name], self.all_widths, shared)

    def shared_by_units(self, sweep: str) -> str:
        """The condition under which the units of a library share the parts of a sweep."""
        return sharing(self.runs[sweep][None], self.all_widths)
