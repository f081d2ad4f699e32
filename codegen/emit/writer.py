"""What the targets have in common: which function a block becomes, in which order they are called, with which tables.

A target (`CWriter`, `NumpyWriter`) adds the language: how a block, a loop, a table and a place in memory are written.
"""

from __future__ import annotations

import keyword
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any

from ..mechanics.expansion import Program
from ..mechanics.fields import identifier
from ..mechanics.formulas import FormulaKind
from ..mechanics.outputs.outputs import RecordFormula
from ..mechanics.procedures import CONSTANTS, SHAPES, WIDTHS
from ..mechanics.procedures import sweeps as sweeps_run
from ..mechanics.stores import CE_PARAMETER, CONSTANT, KEPT, LAID_OUT, MARGIN, NUMBER, PARAMETER, SHAPE, SUM, SUM_LANE
from ..mechanics.structure.constants import Constants
from ..mechanics.structure.element_kinds import ElementKind
from ..mechanics.structure.kinds import EarKind, RegionKind, UnitKind
from ..mechanics.sweeps import FALLING, INWARD, SWEEP
from ..model.model import GROUND
from ..program.block import RESERVED, Block
from ..program.digits import value_of
from ..program.operations import count
from ..program.procedure import (
    AllColumns,
    Columns,
    Formulas,
    IfAsked,
    Perform,
    Prepare,
    Primitives,
    Procedure,
    Run,
    Single,
    Step,
    over_directions,
    pruned,
    routines,
    walk,
)
from ..program.store import Store
from ..version import __version__
from .address import Addresses
from .function import COMMENT, Function
from .memory import Layout

MAX_STRETCHES = 24
"""More different stretches of links than this, and a sweep dispatches on the kind instead."""

KEYWORDS = frozenset(keyword.kwlist) | frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register restrict "
    "return short signed sizeof static struct switch typedef union unsigned void volatile while unit element call "
    "asm typeof typeof_unqual alignas alignof bool constexpr false nullptr static_assert thread_local true linux unix "
    "i386 number status".split()
)
"""Names that variables cannot have in Python or C, to C23 and with what GNU C defines, or that tables have."""

IDLE = -1
"""In the place of a kind that has nothing to do in a sweep."""


@dataclass(frozen=True, slots=True)
class Located:
    """Where a component lies, as a target writes it.

    Attributes
    ----------
    variable : str
        Name of a variable for the row; empty where none is needed.
    row : str
        What the variable is.
    text : str
        What follows the variable.
    type : str
        What the row consists of, where the language has types.
    names : tuple of str
        What a model calls it, if it is one thing in the model: the names that a variable may have, best first.
    """

    variable: str
    row: str
    text: str
    type: str = ""
    names: tuple[str, ...] = ()


Place = Callable[[Store, str], Located]
Column = Callable[[int], str]
"""The expression of an integer column of the current row of a table."""
RowPlace = Callable[[Column, Store, str], Located]
"""Where a component lies, for the current row of a table."""


class Writer(ABC):
    """Source of a program in one language.

    Parameters
    ----------
    program : Program
    formulas : list of FormulaKind
        Joint forces and outputs.
    records : list of RecordFormula
        Outputs of links, potential energy.
    asked : tuple of Procedure
        The functions of the solver.
    """

    numbered = True
    """Places in memory are numbers, not names."""

    def __init__(
        self,
        program: Program,
        formulas: list[FormulaKind],
        records: list[RecordFormula],
        asked: tuple[Procedure, ...],
    ):
        self.asked = asked
        self.program = program
        self.system = program.system
        self.model = program.system.model
        self.formulas = formulas
        self.records = records
        self.layout = Layout(program)
        self.addresses = Addresses(program, self.layout, self.numbered)
        self.parameter_places = {name: i for i, name in enumerate(self.model.parameter_names)}
        self._names: dict[str, Sequence[str]] = {
            "nq": self.model.coordinate_names, "nu": self.model.speed_names, "np": self.model.parameter_names,
            "ninputs": self.model.inputs,
        }  # fmt: skip
        self.reads_numbers = False
        """Whether any function reads the table of numbers that differ within a kind."""
        self._shared: dict[str, list[tuple[UnitKind, ...]]] = {}

    # -- the language ----------------------------------------------------------------------------------------------

    @abstractmethod
    def lines(
        self, block: Block, place: Place, culprit: Callable[[str], str] | None = None, each: str = ""
    ) -> list[str]:
        """Lines of a block; `culprit` gives the number of the link or loop to name where a pivot is zero.

        `each` begins the loop over directions, where the language has one.
        """

    def each(self, kinds: Sequence[UnitKind], sweep: str) -> str:
        """What begins the loop over directions in the function that kinds share."""
        return ""

    @abstractmethod
    def signature(self, name: str, lanes: bool, indexed: bool) -> str:
        """Head of a function; an indexed one gets the number of a link or row."""

    @abstractmethod
    def call(self, name: str, lanes: bool, index: str | None) -> str:
        """Statement that calls a function."""

    @abstractmethod
    def repeat(self, start: int, end: int, step: int, inward: bool, calls: list[str]) -> list[str]:
        """Loop of i over ``start, start + step, ... < end``, or the same backwards."""

    @abstractmethod
    def dispatch(self, count: int, inward: bool, entry: str, calls: list[tuple[list[int], str]]) -> list[str]:
        """Loop over all links or units that chooses the call by the kind, which `entry` gives for each i."""

    def unused_index(self) -> list[str]:
        """Lines of a function that does not read the index that it gets."""
        return []

    @abstractmethod
    def repeat_rows(self, name: str, lanes: bool, count: int) -> list[str]:
        """Calls for all rows of a table."""

    @abstractmethod
    def add_table(self, name: str, rows: list[list[int]] | list[list[float]]) -> None:
        """Table of equally long rows; asked for twice, it stands there once."""

    @abstractmethod
    def place(self, kinds: Sequence[UnitKind], sweep: str, store: Store, name: str) -> Located:
        """Where a component of a store lies, in the function that kinds share."""

    @abstractmethod
    def element(self, array: str, index: str, lanes: bool = False) -> Located:
        """Where an entry of an argument, a seed or a result lies."""

    @abstractmethod
    def field_of_record(self, store: Store, link: str, name: str) -> Located:
        """Where a component of the record, the lanes or the ground's slot of a link lies."""

    @abstractmethod
    def constant(self, shape: int, constants: str, name: str) -> Located:
        """Where a constant of the constants at a place lies."""

    @abstractmethod
    def place_of_constants(self, index: int) -> int:
        """Where constants begin."""

    @abstractmethod
    def prepared(self, what: str) -> list[str]:
        """Lines, in a routine, for what lies outside of the sweeps; see `Prepare`."""

    @abstractmethod
    def number_of_row(self, table: str, row: str, index: int) -> Located:
        """Where a number of the current row lies."""

    # -- names -----------------------------------------------------------------------------------------------------

    def names_of(self, array: str, index: str) -> tuple[str, ...]:
        """What the model calls an entry of an argument, a seed or a result: ``length``, ``q_crank``, ``dp_length``."""
        axes = SHAPES.get(array) or SHAPES.get(array.removeprefix("d"), ())
        found = self._names.get(axes[0]) if len(axes) == 1 else None
        if found is None or not index.isdigit():
            return ()
        name = re.sub(r"\W", "_", found[int(index)])
        own = (name,) if array in ("p", "inputs") else ()
        return *own, f"{'input' if array == 'inputs' else array}_{name}"

    def called_by(self, block: Block, place: Place) -> dict[str, str]:
        """What a function calls what a block loads, where the model has a name for it."""
        taken = {str(s) for s in block.loads} | {s.target.name for s in block.statements} | RESERVED | KEYWORDS
        found: dict[str, str] = {}
        for symbol, (store, component) in block.loads.items():
            name = next(
                (n for n in place(store, component).names if n not in taken and not n.isupper() and n[0] != "_"), None
            )
            if name is not None:
                found[symbol.name] = name
                taken.add(name)
        return found

    # -- functions of links ----------------------------------------------------------------------------------------

    def shared(self, sweep: str) -> list[tuple[UnitKind, ...]]:
        """The kinds of a sweep that have something to do there, those together whose functions differ by nothing but rows."""
        if sweep not in self._shared:
            found: dict[object, list[UnitKind]] = {}
            for kind in SWEEP[sweep].kinds(self.system):
                block = self.program.blocks[sweep].get(kind.index)
                if block is not None and block.stores:
                    found.setdefault(self._form(kind, sweep, block), []).append(kind)
            self._shared[sweep] = [tuple(kinds) for kinds in found.values()]
        return self._shared[sweep]

    def _form(self, kind: UnitKind, sweep: str, block: Block) -> object:
        """A block and where its components lie, rows apart."""

        def form(store: Store, name: str) -> tuple[object, ...]:
            if store.memory is MARGIN:
                return (name,)
            return self.addresses.address(kind, sweep, store, name).form_of_code

        loads = tuple((symbol, store, form(store, name)) for symbol, (store, name) in block.loads.items())
        stores = tuple((store, form(store, name), value) for store, name, value in block.stores)
        return block.title, loads, tuple(block.statements), stores

    def instances(self, kinds: Sequence[UnitKind], sweep: str) -> list[int]:
        """The values that i takes in the function that kinds share."""
        return [i for kind in kinds for i in self.addresses.instances(kind, sweep)]

    def link_function(self, sweep: str, kinds: tuple[UnitKind, ...]) -> Function:
        """The function of kinds of links, ears or regions; it has the number of the first."""
        block = self.program.blocks[sweep][kinds[0].index]
        single = len(self.instances(kinds, sweep)) == 1
        signature = self.signature(f"{sweep}_{kinds[0].index}", SWEEP[sweep].lanes, not single)
        place = cache(partial(self.place, kinds, sweep))  # asked for several times for each component
        lines = self.lines(block, place, self.addresses.culprit(kinds, sweep), self.each(kinds, sweep))
        return Function(f"{block.title}; {self.called(kinds)}", signature, lines, notes(block))

    def called(self, kinds: tuple[UnitKind, ...]) -> str:
        """What the function that kinds share is for, in words."""
        system, kind, count = self.system, kinds[0], sum(len(kind.members) for kind in kinds)
        if isinstance(kind, RegionKind):
            what, first = "regions", f"region of {kind.sources} sources"
        elif isinstance(kind, ElementKind):
            what, first = f"{kind.first.type}s", kind.first.name
        elif isinstance(kind, EarKind):
            ear = system.regions.ears[kind.members[0]]
            loops = [self.model.loops[c.loop].name for c in ear.closures]
            names = ", ".join(system.links[i].name for i in ear.links)
            what, first = "ears", f"{names}{' closed by ' + ', '.join(loops) if loops else ''}"
        else:
            what, first = "links", system.links[kind.members[0]].name
        return first if count == 1 else f"{count} {what}: {first}, ..."

    def loop(self, sweep: str) -> Function:
        """The loop over the links, or the units, of a sweep."""
        spec = SWEEP[sweep]
        shared = self.shared(sweep)
        first = {kind.index: kinds[0].index for kinds in shared for kind in kinds}
        kinds = [first.get(k.index, IDLE) for k in self.sequence(sweep)]
        if spec.then and spec.then in self.blocks:
            return self.loop_of_two(sweep, spec.then)
        single = {kinds[0].index: len(self.instances(kinds, sweep)) == 1 for kinds in shared}
        inward = spec.direction == INWARD
        f = Function(spec.title, self.signature(sweep, spec.lanes, False))

        def call(kind: int, i: str) -> list[str]:
            if kind == IDLE:
                return []
            return [self.call(f"{sweep}_{kind}", spec.lanes, None if single[kind] else i)]

        parts = stretches(kinds)
        if len(parts) <= MAX_STRETCHES or len(single) == len(kinds):
            for start, pattern, count in reversed(parts) if inward else parts:
                order = list(reversed(range(len(pattern)))) if inward else list(range(len(pattern)))
                if count == 1:
                    for o in order:
                        f.lines += call(pattern[o], str(start + o))
                    continue
                calls = [c for o in order for c in call(pattern[o], f"i + {o}" if o else "i")]
                if calls:
                    step = len(pattern)
                    f.lines += self.repeat(start, start + step * count, step, inward, calls)
        else:
            of_kind = [k.index for k in self.sequence(sweep)]
            entry = self.addresses.table(sweep).entry("KIND", list(range(len(kinds))), of_kind)
            cases = [([k.index for k in of], c) for of in shared for c in call(of[0].index, "i")]
            f.lines += self.dispatch(len(kinds), inward, entry, cases)
        return f

    def loop_of_two(self, sweep: str, then: str) -> Function:
        """The loop over all links of two sweeps by turns."""
        both: list[list[UnitKind | None]] = []
        for name in (sweep, then):
            of = {kind: kinds[0] for kinds in self.shared(name) for kind in kinds}
            both.append([of.get(k) for k in self.sequence(name)])
        numbers: dict[tuple[UnitKind | None, ...], int] = {}
        sequence = [numbers.setdefault(pair, len(numbers)) for pair in zip(*both, strict=True)]
        pairs = list(numbers)
        single = {
            (name, kinds[0]): len(self.instances(kinds, name)) == 1
            for name in (sweep, then)
            for kinds in self.shared(name)
        }
        lanes = SWEEP[sweep].lanes

        def call(pair: int, i: str) -> list[str]:
            return [
                self.call(f"{name}_{kind.index}", lanes, None if single[name, kind] else i)
                for name, kind in zip((sweep, then), pairs[pair], strict=True)
                if kind is not None
            ]

        f = Function(SWEEP[sweep].title, self.signature(sweep, lanes, False))
        for start, pattern, times in stretches(sequence):
            places = [str(start + o) if times == 1 else f"i + {o}" if o else "i" for o in range(len(pattern))]
            calls = [c for pair, i in zip(pattern, places, strict=True) for c in call(pair, i)]
            step = len(pattern)
            f.lines += calls if times == 1 else self.repeat(start, start + step * times, step, False, calls)
        return f

    def sequence(self, sweep: str) -> list[UnitKind]:
        """Kinds of what a sweep goes over, one after the other."""
        spec, system = SWEEP[sweep], self.system
        if spec.element:
            of: dict[int, UnitKind] = {n: k for k in system.element_kinds for n in k.members}
            return [of[n] for n in range(len(of))]
        return [*(system.unit_kind_of if spec.units else system.kind_of)]

    def sweep_functions(self, sweep: str) -> list[Function]:
        functions = [f for kinds in self.shared(sweep) for f in self.link_functions(sweep, kinds)]
        if any(spec.then == sweep for spec in SWEEP.values()):
            return functions  # called by turns with another
        return [*functions, self.loop(sweep)]

    def link_functions(self, sweep: str, kinds: tuple[UnitKind, ...]) -> list[Function]:
        """That of `link_function`, after the parts that it is made of."""
        return [self.link_function(sweep, kinds)]

    # -- constants and formulas ------------------------------------------------------------------------------------

    def rows_function(
        self,
        name: str,
        block: Block,
        place: RowPlace,
        integers: list[list[int]],
        numbers: list[list[float]],
        about: str,
        lanes: bool = False,
        of_values: str = "",
        of_numbers: str = "",
    ) -> tuple[Function, list[str]]:
        """A function for blocks that are the same but for table rows, and the statements that call it for all rows.

        `place` gets a function that makes the expression of an integer column; `about` is what it computes. Its tables are
        called after itself, or after the functions of values and of numbers that have the same.
        """
        single = len(integers) == 1
        of = of_numbers or name
        table = f"rows_of_{of_values or name}"
        used = [False]

        def column(j: int) -> str:
            values = {row[j] for row in integers}
            if len(values) == 1:
                return str(values.pop())
            used[0] = True
            return f"{table}[i][{j}]"

        def located(store: Store, component: str) -> Located:
            if store is NUMBER:
                return self.number_of_row(f"numbers_of_{of}", "0" if single else "i", int(component))
            return place(column, store, component)

        first = len(self.system.links) + len(self.model.loops) + len(self.model.loads)
        lines = self.lines(block, located, lambda margin: f"{first} + {column(0)}")
        f = Function(about, self.signature(name, lanes, not single), lines, notes(block))
        numbered = any(store is NUMBER for store, _ in block.loads.values())
        if used[0]:
            self.add_table(table, integers)
        if numbered:
            self.add_table(f"numbers_of_{of}", numbers)
        if single:
            return f, [self.call(name, lanes, None)]
        if not (used[0] or numbered):
            f.lines = [*self.unused_index(), *f.lines]
        return f, self.repeat_rows(name, lanes, len(integers))

    def constants_functions(self) -> tuple[list[Function], list[str]]:
        """Functions that compute constants from parameters, and the calls."""
        functions, calls = [], []
        places = self.parameter_places
        for shape in self.system.shapes:
            if not shape.block.stores:
                continue
            rows = [c for c in self.system.constants if c.shape is shape]

            def place(column: Column, store: Store, name: str, index: int = shape.index) -> Located:
                if store is SHAPE:
                    return self.constant(index, column(0), name)
                return self.element("p", column(1 + int(name)))

            integers = [[self.place_of_constants(c.index), *(places[p] for p in c.parameters)] for c in rows]
            f, call = self.rows_function(
                f"constants_{shape.index}", shape.block, place, integers, [list(c.numbers) for c in rows],
                f"{shape.block.title}; {self.owners(rows)}",
            )  # fmt: skip
            functions.append(f)
            calls += call
        return functions, calls

    def formula_functions(self, target: str, parts: Collection[str]) -> dict[str, Any]:
        """Functions of the formulas of a target: for values, tangents and their transposes, as far as they are called."""
        result: dict[str, Any] = {
            f"{kind}{part}": [] for kind in ("", "lane_", "back_") for part in ("functions", "calls")
        }

        def place_formula(column: Column, store: Store, name: str) -> Located:
            if store.name in (target, f"d{target}"):
                return self.element(store.name, column(0), store.lanes)
            return self.element(store.name, "0" if store.name in ("t", "dt") else column(1 + int(name)), store.lanes)

        for kind in self.formulas:
            if kind.target == target:
                integers = [[i, *slots] for i, slots, _ in kind.rows]
                numbers = [n for _, _, n in kind.rows]
                self._add_formula(result, parts, f"{target}_{kind.index}", kind, place_formula, integers, numbers)
        ground = len(self.system.links)
        for record in self.records:
            if record.target == target:
                slots = 1 + len(record.rows[0][1])

                def place_record(column: Column, store: Store, name: str, slots: int = slots) -> Located:
                    if store.name in (target, f"d{target}"):
                        return self.element(store.name, entry_from(column(0), int(name)), store.lanes)
                    if store.memory in (SUM, SUM_LANE):
                        return self.element(store.name, name, store.lanes)
                    if store.memory in LAID_OUT:
                        return self.field_of_record(store.plain, column(1 + (store.place or 0)), name)
                    return self.element(store.name, column(slots + int(name)), store.lanes)

                integers = [
                    [i, *(ground if link == GROUND else link for link in links), *of] for i, links, of, _ in record.rows
                ]
                numbers = [n for *_, n in record.rows]
                name = f"{target}_of_link_{record.index}"
                self._add_formula(result, parts, name, record, place_record, integers, numbers)
        return result

    def _add_formula(
        self,
        result: dict[str, Any],
        parts: Collection[str],
        name: str,
        kind: FormulaKind | RecordFormula,
        place: RowPlace,
        integers: list[list[int]],
        numbers: list[list[float]],
    ) -> None:
        about = kind.value.title
        if kind.places:
            more = len(kind.places) - 3
            about = f"{', '.join(kind.places[:3])}{f' and {more} more' if more > 0 else ''} of the model"
        made = [("", name, kind.value, about), ("lane_", f"d{name}", kind.tangent, f"tangent of {about}")]
        if "back_" in parts and kind.transposed.stores:  # a formula of numbers hands nothing back
            made.append(("back_", f"{name}_transposed", kind.transposed, f"transpose of the tangent of {about}"))
        for part, called, block, what in made:
            if part in parts:
                of_numbers = f"d{name}" if part else name
                f, call = self.rows_function(
                    called, block, place, integers, numbers, what, bool(part), name, of_numbers
                )
                result[f"{part}functions"].append(f)
                result[f"{part}calls"] += call

    def owners(self, constants: Sequence[Constants]) -> str:
        """Whose constants some are, in words."""
        system, model, those = self.system, self.model, {id(c) for c in constants}
        found = [link.name for link, c in zip(system.links, system.constants_of, strict=True) if id(c) in those]
        found += [loop.name for loop, c in zip(model.loops, system.closure_constants, strict=True) if id(c) in those]
        found += [e.element.name for e in system.elements if id(e.constants) in those]
        return ", ".join(found[:3]) + (f", ... ({len(found)})" if len(found) > 3 else "") if found else "gravity"

    # -- the ground ------------------------------------------------------------------------------------------------

    def ground_values(self) -> list[tuple[str, float | str]]:
        """The ground's record, at rest and accelerating by -g: fields with a number or gravity's constant by name."""
        g, of_gravity = self.system.gravity, self.system.fields_of_gravity
        found: list[tuple[str, float | str]] = []
        for name in sorted(self.program.ground_fields):
            value: float | str = 0.0
            if name.endswith(("W.xx", "W.yy", "W.zz")):
                value = 1.0
            elif g is not None and of_gravity.get(name) in g.shape.fields:
                value = g.shape.varying.get(of_gravity[name]) or g.values.get(of_gravity[name], 0.0)
            found.append((name, value))
        return found

    def ground_accelerations(self) -> list[str]:
        """The fields of the ground's record that gravity sets."""
        return sorted(self.program.ground_fields & self.system.fields_of_gravity.keys())

    def ground_tangents(self) -> list[tuple[str, list[tuple[float | str, int]]]]:
        """The ground's tangent where gravity depends on parameters: fields as sums of factor and parameter."""
        g = self.system.gravity
        found: list[tuple[str, list[tuple[float | str, int]]]] = []
        places = {n: k for k, n in enumerate(self.model.parameter_names)}
        for name in dict.fromkeys(n for s in FALLING for n in self.program.slots.get(s, ())):
            if g is None or name not in g.shape.varying:
                continue
            terms: list[tuple[float | str, int]] = []
            for j, p in enumerate(g.parameters):
                key = f"{name}/{j}"
                if key in g.shape.fixed and value_of(g.shape.fixed[key]) != 0:
                    terms.append((value_of(g.shape.fixed[key]), places[p]))
                elif key in g.shape.varying:
                    terms.append((g.shape.varying[key], places[p]))
            found.append((name, terms))
        return found

    # -- the files -------------------------------------------------------------------------------------------------

    @cached_property
    def blocks(self) -> dict[str, dict[int, Block]]:
        """Blocks by sweep and kind, of the sweeps that are run and have something to do."""
        run = sweeps_run(self.asked)
        found = self.program.blocks.items()
        return {s: b for s, b in found if s in run and any(block.stores for block in b.values())}

    @cached_property
    def swept(self) -> dict[str, list[Function]]:
        """The functions of every sweep."""
        sets = self.sets_of_widths
        then = {SWEEP[s].then for s in self.blocks}  # called by others, so before them
        ranks = {s: 1 + sets.index(self.widths[s]) if SWEEP[s].lanes else 0 for s in self.blocks}
        order = sorted(self.blocks, key=lambda s: (ranks[s], s not in then))
        return {s: self.sweep_functions(s) for s in order}

    @cached_property
    def widths(self) -> dict[str, tuple[int, ...]]:
        """For how many directions at once sweeps, formulas and routines over directions are called, widest first."""
        found: dict[str, set[int]] = {}
        for p in self.asked:
            for name, width in called_for(p):
                found.setdefault(name, set()).add(width)
        return {name: tuple(sorted(widths, reverse=True)) for name, widths in found.items()}

    @cached_property
    def sets_of_widths(self) -> list[tuple[int, ...]]:
        """All of these, the largest sets first."""
        sets = {*self.widths.values(), *(widest_first(p) for p in self.asked if p.widths)}
        return sorted(sets, key=lambda widths: (-len(widths), widths))

    @cached_property
    def constants(self) -> tuple[list[Function], list[str]]:
        """Functions that compute constants, and their calls."""
        _ = self.swept  # tables are in the order of the sweeps
        return self.constants_functions() if self.prepares(CONSTANTS) else ([], [])

    def prepares(self, what: str) -> bool:
        """Whether any function prepares something."""
        return any(isinstance(s, Prepare) and s.what == what for p in self.asked for s in walk(p.steps))

    @cached_property
    def groups(self) -> dict[Formulas, list[Function]]:
        """The functions of formulas: those of each form, and last the one that calls them. Nothing of those without formulas."""
        _ = self.constants
        found: dict[Formulas, list[Function]] = {}
        steps = {s for p in self.asked for s in walk(p.steps) if isinstance(s, Formulas)}
        targets = {t for step in steps for t in step.targets}
        parts = {t: {_part(step) for step in steps if t in step.targets} for t in targets}
        by_target = {t: self.formula_functions(t, parts[t]) for t in FORMULA_ORDER if t in targets}
        for step in sorted(steps, key=lambda s: (FORMULA_ORDER.index(s.targets[0]), s.lanes, s.backwards)):
            functions, calls = f"{_part(step)}functions", f"{_part(step)}calls"
            lines = [line for t in step.targets for line in by_target[t][calls]]
            if lines:
                of = "transpose of tangents of " if step.backwards else "tangents of " if step.lanes else ""
                title = f"{of}{step.name.replace('_', ' ')}"
                group = Function(title, self.signature(_name(step), step.lanes, False), lines)
                found[step] = [*(f for t in step.targets for f in by_target[t][functions]), group]
        return found

    @cached_property
    def procedures(self) -> tuple[Procedure, ...]:
        """The functions of the solver, without steps that have nothing to do."""
        return tuple(pruned(p, self.lives) for p in self.asked)

    def lives(self, step: Run | Formulas | Prepare) -> bool:
        """Whether a step has something to do."""
        match step:
            case Run():
                return step.sweep in self.blocks
            case Formulas():
                return step in self.groups
            case Prepare():
                return bool(self.prepared(step.what))

    def where_run(self, named: Iterable[tuple[str, list[Function]]]) -> list[Function]:
        """Functions of sweeps and formulas, by name, as they are printed; targets that are compiled in parts say in which."""
        return [f for _, functions in named for f in functions]

    def shared_context(self) -> dict[str, Any]:
        """What the templates of every target are rendered with."""
        model = self.model
        parts = self.swept | {_name(step): functions for step, functions in self.groups.items()}
        lanes = {_name(s) for s in self.groups if s.lanes} | {s for s in self.swept if SWEEP[s].lanes}
        return {
            "name": model.name,
            "version": __version__,
            "nq": model.nq, "nu": model.nu, "np": len(model.parameters), "ninputs": len(model.inputs),
            "noutputs": len(model.outputs),
            "index_tables": [
                (t.name, t.count, [f"{t.name.upper()}_{c}" for c in t.columns], t.rows())
                for t in self.addresses.tables if t.columns
            ],
            "functions": [*self.constants[0], *self.where_run((n, parts[n]) for n in parts if n not in lanes)],
            "lane_functions": [
                (widths, self.where_run((n, parts[n]) for n in parts if n in lanes and self.widths.get(n) == widths))
                for widths in self.sets_of_widths
            ],
            "routines": [r for r in routines(self.procedures) if not r.lanes],
            "lane_routines": [
                (widths, [r for r in routines(self.procedures) if r.lanes and self.widths[r.name] == widths])
                for widths in self.sets_of_widths
            ],
            "interfaces": self.procedures,
        }  # fmt: skip


FORMULA_ORDER = (
    "tau", "outputs", "switches", "energy", "coefficient", "drive", "prescribed", "held_force", "initial_q", "initial_u",
    "frames", "frame_accelerations", "point_places",
)  # fmt: skip
"""The order in which the tables of formulas stand."""


def entry_from(first: str, further: int) -> str:
    """Index of an entry so many after the one that an expression says."""
    if first.isdigit():
        return str(int(first) + further)
    return f"{first} + {further}" if further else first


def _part(step: Formulas) -> str:
    """Which of the functions of a formula a step calls: for values, tangents, or their transpose."""
    return "back_" if step.backwards else "lane_" if step.lanes else ""


def _name(step: Run | Formulas) -> str:
    """Name of the function that a step calls."""
    if isinstance(step, Run):
        return step.sweep
    return step.called


def widest_first(procedure: Procedure) -> tuple[int, ...]:
    """For how many directions at once a function is written."""
    return tuple(sorted((*procedure.widths, *procedure.apart), reverse=True))


def called_for(procedure: Procedure) -> dict[tuple[str, int], set[int]]:
    """What a procedure runs over directions, by name, and for how many at once; by which of its functions, by their widths."""
    found: dict[tuple[str, int], set[int]] = {}
    own = (*procedure.widths, *procedure.apart)

    def call(name: str, width: int, within: int | None) -> None:
        found.setdefault((name, width), set()).update(own if within is None else (within,))

    def add(steps: tuple[Step, ...], widths: Sequence[int], anyhow: bool) -> None:
        """Add steps; `anyhow` if they run for so many directions whatever the function's own width is."""
        for step in steps:
            match step:
                case Run() | Formulas() if over_directions(step):
                    for w in widths:
                        call(_name(step), w, None if anyhow else w)
                case Single():
                    for s in step.steps:
                        call(s.sweep, 1, None)
                case Perform():
                    for w in widths if over_directions(step) else ():
                        call(step.routine.name, w, None if anyhow else w)
                    add(step.routine.steps, widths, anyhow)
                case Columns() | IfAsked():
                    add(step.steps, widths or (max(WIDTHS),), anyhow or not widths)
                case AllColumns():
                    for s in step.steps:
                        if s.lanes:
                            call(s.sweep, step.width, None)
                case Primitives():
                    call(_name(step.formulas), max(WIDTHS), None)
                case _:
                    pass

    add(procedure.steps, own, False)
    return found


def called_once(procedure: Procedure) -> set[str]:
    """Names of what a procedure runs without directions."""
    return {
        step.routine.name if isinstance(step, Perform) else _name(step)
        for step in walk(procedure.steps)
        if isinstance(step, (Run, Formulas, Perform)) and not over_directions(step)
    }


def notes(block: Block) -> list[str]:
    """What a block reads and writes, and how much it computes."""
    found = []
    for word, components in (("in", list(block.loads.values())), ("out", [(s, n) for s, n, _ in block.stores])):
        by_store: dict[str, dict[str, None]] = {}
        for store, name in components:
            names = by_store.setdefault(CALLED.get(store, store.label.replace("#", "")), {})
            if store.memory in LAID_OUT or store.memory is CONSTANT or store.memory in KEPT.values():
                names[_COMPONENT.sub("", identifier(name))] = None
        listed = (f"{store}: {', '.join(names)}" if names else store for store, names in by_store.items())
        found.append(f"{word}: {'; '.join(listed)}")
    once, each = count(block, False), count(block, True)
    words = [once.words() or ("" if each.words() else "none"), f"{each.words()} per direction" if each.words() else ""]
    found.append(f"operations: {'; '.join(w for w in words if w)}")
    together = ". ".join(found)
    return [together] if len(together) <= COMMENT else found


CALLED = {SHAPE: "c", NUMBER: "numbers", PARAMETER: "p", CE_PARAMETER: "p"}
"""What stores are called in lists of what is read and written, where their names say less."""

_COMPONENT = re.compile(r"(_[xyz]{1,2})?(_d\d+)?$")


def stretches(kinds: list[int], longest: int = 8) -> list[tuple[int, tuple[int, ...], int]]:
    """Cut a sequence into repeated patterns: (start, pattern, repetitions). Greedy, linear in its length."""
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
