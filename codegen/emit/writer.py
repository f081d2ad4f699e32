"""Common part of all targets: functions of sweeps, constants and formulas, in the order of a file.

A target adds its language: see `language.Language`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from typing import Any

from ..program.chosen_steps import pruned, routines
from ..program.procedure import CONSTANTS, Formulas, Prepare, Procedure, Run, walk
from ..program.store import MARGIN
from ..version import __version__
from .function import Function
from .rows import RowWriter
from .runs import called_for, name_of, part_of, widest_first


class Writer(RowWriter):
    """Base class of the writers of source files, for one language."""

    # -- the files -------------------------------------------------------------------------------------------------

    @cached_property
    def swept(self) -> dict[str, list[Function]]:
        """The functions of all sweeps, by sweep."""
        sets = self.sets_of_widths
        then = {self.plan.sweeps[s].then for s in self.blocks}  # loops of other sweeps call these, so they come first
        ranks = {s: 1 + sets.index(self.widths[s]) if self.plan.sweeps[s].lanes else 0 for s in self.blocks}
        order = sorted(self.blocks, key=lambda s: (ranks[s], s not in then))
        return {s: self.sweep_functions(s) for s in order}

    @cached_property
    def widths(self) -> dict[str, tuple[int, ...]]:
        """Widths for which sweeps, formulas and routines over directions are called, the widest first."""
        found: dict[str, set[int]] = {}
        for p in self.asked:
            for name, width in called_for(p):
                found.setdefault(name, set()).add(width)
        return {name: tuple(sorted(widths, reverse=True)) for name, widths in found.items()}

    @cached_property
    def sets_of_widths(self) -> list[tuple[int, ...]]:
        """All sets of widths for which a sweep, a formula, a routine or a function is written, the largest set
        first."""
        sets = {*self.widths.values(), *(widest_first(p) for p in self.asked if p.widths)}
        return sorted(sets, key=lambda widths: (-len(widths), widths))

    @cached_property
    def constants(self) -> tuple[list[Function], list[str]]:
        """Functions that compute constants from parameters, and the statements that call them."""
        _ = self.swept  # the sweeps are written first, so their tables come first
        return self.constants_functions() if self.prepares(CONSTANTS) else ([], [])

    @cached_property
    def singular_outputs(self) -> bool:
        """Whether there are outputs without a derivative in some states."""
        of_outputs = (f.tangent.stores for f in self.plan.formulas if f.target == "outputs")
        return any(store.memory is MARGIN for stores in of_outputs for store, _, _ in stores)

    def prepares(self, what: str) -> bool:
        """Whether any function runs a preparation."""
        return any(isinstance(s, Prepare) and s.what == what for p in self.asked for s in walk(p.steps))

    @cached_property
    def groups(self) -> dict[Formulas, list[Function]]:
        """For each formula, its functions, followed by the function that calls them; empty if there are no formulas."""
        _ = self.constants
        found: dict[Formulas, list[Function]] = {}
        steps = {s for p in self.asked for s in walk(p.steps) if isinstance(s, Formulas)}
        targets = {t for step in steps for t in step.targets}
        parts = {t: {part_of(step) for step in steps if t in step.targets} for t in targets}
        by_target = {t: self.formula_functions(t, parts[t]) for t in FORMULA_ORDER if t in targets}
        for step in sorted(steps, key=lambda s: (FORMULA_ORDER.index(s.targets[0]), s.lanes, s.backwards, s.twice)):
            functions, lines, names = (
                [x for t in step.targets for x in by_target[t][f"{part_of(step)}{what}"]]
                for what in ("functions", "calls", "names")
            )
            if lines:
                title = f"{ABOUT_PARTS[part_of(step)]}{step.name.replace('_', ' ')}"
                signature = self.signature(name_of(step), step.lanes, False)
                if lines == [self.call(names[0], step.lanes, None)]:  # a single function is called directly
                    found[step] = [replace(functions[0], signature=signature)]
                else:
                    found[step] = [*functions, Function(title, signature, lines)]
        return found

    @cached_property
    def procedures(self) -> tuple[Procedure, ...]:
        """The functions of the solver, without steps that have no effect."""
        return tuple(pruned(p, self.lives) for p in self.asked)

    def lives(self, step: Run | Formulas | Prepare) -> bool:
        """Whether a step has an effect; steps without effect are not printed."""
        match step:
            case Run():
                return step.sweep in self.blocks
            case Formulas():
                return step in self.groups
            case Prepare():
                return bool(self.prepared(step.what))

    def where_run(self, named: Iterable[tuple[str, list[Function]]]) -> list[Function]:
        """Functions of sweeps and formulas by name, as they are printed. A target that compiles parts separately adds
        conditions."""
        return [f for _, functions in named for f in functions]

    def shared_context(self) -> dict[str, Any]:
        """The data for the templates of every target."""
        model = self.model
        parts = self.swept | {name_of(step): functions for step, functions in self.groups.items()}
        lanes = {name_of(s) for s in self.groups if s.lanes} | {s for s in self.swept if self.plan.sweeps[s].lanes}
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


ABOUT_PARTS = {
    "": "", "lane_": "tangents of ", "back_": "transpose of tangents of ", "adjoint_": "adjoints of ",
    "twice_": "tangents of transposes of ",
}  # fmt: skip
"""The beginnings of the titles of formulas' functions, by `runs.part_of`."""

FORMULA_ORDER = (
    "tau", "outputs", "switches", "energy", "coefficient", "drive", "prescribed", "held_force", "initial_q", "initial_u",
    "frames", "frame_accelerations", "point_places",
)  # fmt: skip
"""The order of formulas in the tables of generated code."""
