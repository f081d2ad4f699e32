"""Writes the NumPy module of a solver: the statements of the C, elementwise over a batch of states.

Memory is named instead of numbered: every link has a record, slots and lanes, and each is a dict of arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..mechanics.expansion import Program
from ..mechanics.formulas import FormulaKind
from ..mechanics.kinds import UnitKind
from ..mechanics.outputs import RecordFormula
from ..mechanics.stores import COUPLING_BLOCK, EAR_RECORD, MARGIN, RECORD, REGION_RECORD
from ..program.block import Block
from ..program.store import Store
from .address import REGIONS
from .interface import Interface
from .printer import NumpyPrinter
from .repetition import Repeated, repeated
from .templates import render
from .writer import Located, Place, Writer

SCALARS = (RECORD, EAR_RECORD, REGION_RECORD, COUPLING_BLOCK)
"""Memory whose numbers are NumPy's: Python's 1.0/0.0 would raise, NumPy's is found by the pivot check."""

AXES = {
    "q": "nq", "u": "nu", "p": "np", "inputs": "ninputs", "t": "", "udot": "nu", "qdot": "nq", "M": "nu, nu", "b": "nu",
    "x": "nu", "force": "nu", "energy": "2", "outputs": "noutputs", "J_q": "nu, nq", "J_u": "nu, nu", "J_p": "nu, np",
    "J_inputs": "nu, ninputs", "J_t": "nu", "position": "nclosure", "velocity": "nclosure", "condition": "nloops",
    "reaction": "6*nlinks", "loop_reaction": "6*nloops", "step": "nq", "full_q": "nq", "full_u": "nu",
}  # fmt: skip
"""Axes of arguments and results after those of the batch."""


class NumpyWriter(Writer):
    """NumPy source of a program; a place is (variable of a dict, its expression, text that follows)."""

    numbered = False

    def __init__(
        self,
        program: Program,
        formulas: list[FormulaKind],
        records: list[RecordFormula],
        energy_outputs: list[tuple[int, int]],
        reactions: bool = False,
    ):
        super().__init__(program, formulas, records, energy_outputs, reactions)
        self.printer = NumpyPrinter()
        self.tables: dict[str, list[str]] = {}

    # -- the language ----------------------------------------------------------------------------------------------

    def lines(self, block: Block, place: Place, culprit: Callable[[str], str] | None = None) -> list[str]:
        taken = {s.name for s in block.loads} | {s.target.name for s in block.statements}
        variables: dict[str, str] = {}
        body: list[str] = []

        def access(store: Store, name: str) -> str:
            variable, expression, text = place(store, name)
            if not variable:
                return f"{expression}{text}"
            if variable in taken:
                variable += "_at"
            variables[variable] = f"{variable} = {expression}"
            return f"{variable}{text}"

        for symbol, (store, name) in block.loads.items():
            body.append(f"{symbol} = {access(store, name)}")
        tag = ""
        for s in block.statements:
            comment = f"  # {s.tag}" if s.tag and s.tag != tag else ""
            tag = s.tag
            body.append(f"{s.target} = {self.printer(s.expression)}{comment}")
        for store, name, value in block.stores:
            text = self.printer(value)
            if store.memory is MARGIN:
                assert culprit is not None
                body.append(f"check_pivot(a, {text}, {_plain(culprit(name))})")
                continue
            if store.memory in SCALARS and value.is_Number:
                text = "ZERO" if value == 0 else f"np.float64({text})"
            where = access(store, name)
            body.append(f"{where} = {where} + {text}" if store.adds else f"{where} = {text}")
        return [*variables.values(), *body]

    def signature(self, name: str, lanes: bool, indexed: bool) -> str:
        return f"def {name}(a{', i' if indexed else ''}):"

    def call(self, name: str, lanes: bool, index: str | None) -> str:
        return f"{name}(a{'' if index is None else f', {index}'})"

    def repeat(self, start: int, end: int, step: int, inward: bool, calls: list[str]) -> list[str]:
        bounds = f"{end - step}, {start - 1}, {-step}" if inward else f"{start}, {end}, {step}"
        return [f"for i in range({bounds}):", *(f"    {c}" for c in calls)]

    def dispatch(self, count: int, inward: bool, entry: str, calls: list[tuple[int, str]]) -> list[str]:
        lines = [f"for i in range({count - 1}, -1, -1):" if inward else f"for i in range({count}):"]
        lines.append(f"    match {entry}:")
        for kind, call in calls:
            lines += [f"        case {kind}:", f"            {call}"]
        return lines if calls else []

    def repeat_rows(self, name: str, lanes: bool, count: int) -> list[str]:
        return [f"for i in range({count}):", f"    {name}(a, i)"]

    def add_table(self, name: str, rows: list[list[int]] | list[list[float]]) -> None:
        self.tables[name] = [", ".join(map(repr, row)) for row in rows]

    def place(self, kind: UnitKind, sweep: str, store: Store, name: str) -> Located:
        at = self.addresses.address(kind, sweep, store, name)
        if at.region in REGIONS.values() or at.region == "constants":
            return at.variable, f"a.{at.region}[{_plain(at.row)}]", f'["{name}"]'
        if at.region == "trig":
            return self.element(name, _plain(at.row))
        if not at.row:
            return self.element(at.region, _plain(at.component))
        index = _index(at.row, int(at.component))
        return ("", "numbers", f"[{index}]") if at.region == "numbers" else self.element(at.region, index)

    def element(self, array: str, index: str) -> Located:
        return "", f"a.{array}", f"[{index}]"

    def field_of_record(self, store: Store, link: str, name: str) -> Located:
        return store.name, f"a.{REGIONS[store.memory]}[{link}]", f'["{name}"]'

    def constant(self, shape: int, constants: str, name: str) -> Located:
        return "c", f"a.constants[{constants}]", f'["{name}"]'

    def place_of_constants(self, index: int) -> int:
        return index

    def number_of_row(self, table: str, row: str, index: int) -> Located:
        return "k", f"{table}[{row}]", f"[{index}]"

    # -- the file --------------------------------------------------------------------------------------------------

    def _gravity(self, value: float | str) -> str:
        """A number, or a constant of gravity's."""
        if not isinstance(value, str):
            return repr(value)
        assert self.system.gravity is not None
        return f'a.constants[{self.system.gravity.index}]["{value}"]'

    def ground(self) -> list[str]:
        """Lines that set the ground's record."""
        lines = []
        for name, value in self.ground_values():
            text = "ZERO" if value == 0 else self._gravity(value)
            lines.append(f'a.records[GROUND]["{name}"] = {text}')
        return lines

    def context(self) -> dict[str, Any]:
        """What the templates are rendered with."""
        context = self.shared_context()
        tangent = [
            (name, " + ".join(f"{self._gravity(factor)}*a.dp[{p}]" for factor, p in terms) or "0.0")
            for name, terms in self.ground_tangents()
        ]
        context |= {
            "tables": self.tables,
            "links": listed([link.name for link in self.system.links]),
            "loops": listed([loop.name for loop in self.model.loops]),
            "ears": len(self.system.regions.ears),
            "couplings": self.system.regions.elimination.slots,
            "regions": len(self.system.regions.regions),
            "springs": len(self.model.springs),
            "spring_names": listed([spring.name for spring in self.model.springs]),
            "nclosure": len(self.model.closure_names),
            "constants": len(self.system.constants),
            "ground": self.ground(),
            "rest": [f'a.records[GROUND]["{name}"] = ZERO' for name in self.ground_accelerations()],
            "ground_tangent": [f'a.slots[GROUND]["{name}"] = {value}' for name, value in tangent],
            "ground_tangent_rest": [f'a.slots[GROUND]["{name}"] = 0.0' for name, _ in tangent],
            "public": {f.name: self._public(f) for f in context["interfaces"]},
        }
        return context

    def _public(self, f: Interface) -> dict[str, Any]:
        """Signature, documentation and opening statement of a function of the module."""
        given = [*f.arguments, *f.seeds]
        results = [self._shape(r, bool(f.seeds) and r.startswith("d")) for r in f.results]
        return {
            "signature": f"def {f.name}({', '.join(given)}):",
            "comment": f.comment,
            "takes": [
                ", ".join(self._shape(n, lanes) for n in names)
                for names, lanes in ((f.arguments, False), (f.seeds, True))
                if names
            ],
            "returns": ", ".join(results),
            "open": f"a = Call({', '.join(f'{n}={n}' for n in given)})",
        }

    def _shape(self, name: str, lanes: bool) -> str:
        axes = AXES[name.removeprefix("d") if lanes else name]
        return f"{name} ({'k, ' if lanes else ''}...{', ' + axes if axes else ''})"


def listed(names: list[str]) -> list[str]:
    """Lines of a tuple of names; what is repeated is generated when the module is loaded."""
    lines = []
    for item in repeated(names):
        if isinstance(item, Repeated):
            integers = [
                f"{{{a} + {b}*i}}" if b != 1 else f"{{{a} + i}}" for a, b in zip(item.start, item.step, strict=True)
            ]
            again = ", ".join('f"' + str(name).format(*integers) + '"' for name in item.items)
            lines.append(f"*(name for i in range({item.count}) for name in ({again},))")
        else:
            lines.append(f'"{item}"')
    return lines


def _plain(entry: str) -> str:
    """An entry of the link table without the parentheses that C pointers need."""
    return entry.removeprefix("(").removesuffix(")")


def _index(entry: str, offset: int) -> str:
    if entry.isdigit():
        return str(int(entry) + offset)
    return f"{entry} + {offset}" if offset else _plain(entry)


def write_numpy(
    program: Program,
    formulas: list[FormulaKind],
    records: list[RecordFormula],
    energy_outputs: list[tuple[int, int]],
    reactions: bool = False,
) -> str:
    """The text of ``<name>_numpy.py``; needs NumPy only.

    Parameters
    ----------
    program, formulas, records, energy_outputs, reactions
        See `Writer`.
    """
    return render("numpy/module.py.jinja", NumpyWriter(program, formulas, records, energy_outputs, reactions).context())


__all__ = ["NumpyWriter", "write_numpy"]
