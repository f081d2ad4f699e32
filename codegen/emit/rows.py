"""Functions of constants and formulas; functions that differ only in rows of tables become one function."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from ..model.model import GROUND
from ..program.block import Block
from ..program.formula import Formula
from ..program.shape import Constants
from ..program.store import ARGUMENT, ARGUMENT_LANE, NUMBER, SHAPE, Store
from .function import Function
from .language import Column, Located, RowPlace
from .notes import notes
from .sweeps import SweepWriter


class RowWriter(SweepWriter):
    """Writes the functions of constants and formulas."""

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
        """A function for blocks that differ only in rows of tables, and the statements that call it for all rows.

        `place` returns places of components; it gets a function that returns the expression of an integer column. `about`
        is the comment of the function. Tables have its name, or the name of an earlier function with equal tables.
        """
        single = len(integers) == 1
        numbered = any(store is NUMBER for store, _ in block.loads.values())
        of = of_numbers or name
        if numbered:  # functions with equal tables of numbers share one
            of = self._tables_of_numbers.setdefault(repr(numbers), of)
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

        first = len(self.plan.links) + len(self.model.loops) + len(self.model.loads)
        lines = self.lines_of(block, located, lambda margin: f"{first} + {column(0)}", about=about)
        f = Function(about, self.signature(name, lanes, not single), lines, notes(block))
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
        """Functions that compute constants from parameters, and the statements that call these functions."""
        functions, calls = [], []
        places = self.parameter_places
        for shape in self.plan.shapes:
            if not shape.block.stores:
                continue
            rows = [c for c in self.plan.constants if c.shape is shape]

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
        """Functions of the formulas whose results are in the array `target`: for values, tangents and transposes, as far as
        some function calls them."""
        result: dict[str, Any] = {
            f"{kind}{part}": []
            for kind in ("", "lane_", "back_", "adjoint_", "twice_")
            for part in ("functions", "calls", "names")
        }

        ground = len(self.plan.links)
        for formula in self.plan.formulas:
            if formula.target == target:
                slots = 1 + len(formula.rows[0][1])

                def place(column: Column, store: Store, name: str, slots: int = slots) -> Located:
                    if store.name.removesuffix("_bar") in (target, f"d{target}"):
                        return self.element(store.name, entry_from(column(0), int(name)), store.lanes)
                    if store.memory.region:
                        return self.field_of_record(store.plain, column(1 + (store.place or 0)), name)
                    of_model = store.memory in (ARGUMENT, ARGUMENT_LANE)
                    return self.element(store.name, column(slots + int(name)) if of_model else name, store.lanes)

                integers = [
                    [i, *(ground if link == GROUND else link for link in links), *of]
                    for i, links, of, _ in formula.rows
                ]
                self._add_formula(result, parts, formula, place, integers, [n for *_, n in formula.rows])
        return result

    def _add_formula(
        self,
        result: dict[str, Any],
        parts: Collection[str],
        kind: Formula,
        place: RowPlace,
        integers: list[list[int]],
        numbers: list[list[float]],
    ) -> None:
        name, about = kind.name, kind.value.title
        if kind.places:
            more = len(kind.places) - 3
            about = f"{', '.join(kind.places[:3])}{f' and {more} more' if more > 0 else ''} of the model"
        made = [("", name, kind.value, about), ("lane_", f"d{name}", kind.tangent, f"tangent of {about}")]
        if "back_" in parts and kind.transposed.stores:  # a formula that contains only numbers has no adjoint
            made.append(("back_", f"{name}_transposed", kind.transposed, f"transpose of the tangent of {about}"))
        if "adjoint_" in parts and kind.adjoint.stores:
            made.append(("adjoint_", f"{name}_adjoint", kind.adjoint, f"adjoint of {about}"))
        if "twice_" in parts and kind.twice.stores:
            made.append(("twice_", f"{name}_twice", kind.twice, f"tangent of the transposed tangent of {about}"))
        for part, called, block, what in made:
            if part in parts:
                of_numbers = f"d{name}" if part else name
                f, call = self.rows_function(
                    called, block, place, integers, numbers, what, part not in ("", "adjoint_"), name, of_numbers
                )
                result[f"{part}functions"].append(f)
                result[f"{part}calls"] += call
                result[f"{part}names"].append(called)

    def owners(self, constants: Sequence[Constants]) -> str:
        """The owners of the given constants, in words."""
        those = {id(c) for c in constants}
        found = [name for name, c in self.plan.owners if id(c) in those]
        return ", ".join(found[:3]) + (f", ... ({len(found)})" if len(found) > 3 else "") if found else "gravity"


def entry_from(first: str, further: int) -> str:
    """The index of the entry that comes `further` entries after the first."""
    if first.isdigit():
        return str(int(first) + further)
    return f"{first} + {further}" if further else first
