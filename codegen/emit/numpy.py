"""Writes the NumPy module of a solver: the statements of the C, elementwise over a batch of states.

Memory is named instead of numbered: every link has a record, slots and lanes, and each is a dict of arrays.
"""

from __future__ import annotations

from typing import Any

from ..mechanics.expansion import Program
from ..mechanics.formulas import FormulaKind
from ..mechanics.kinds import LinkKind
from ..mechanics.outputs import RecordFormula
from ..program.block import Block
from .interface import Interface
from .printer import NumpyPrinter
from .templates import render
from .writer import Located, Place, Writer

OF_COORDINATES = ("q", "dq", "qdot", "dqdot")
OF_SPEEDS = ("u", "du", "udot", "dudot", "tau", "dtau", "b", "force", "dforce")
RECORDS = ("me", "up")
"""Memory whose numbers are NumPy's: Python's 1.0/0.0 would raise, NumPy's is found by the pivot check."""

AXES = {
    "q": "nq", "u": "nu", "p": "np", "inputs": "ninputs", "t": "", "udot": "nu", "qdot": "nq", "M": "nu, nu", "b": "nu",
    "x": "nu", "force": "nu", "energy": "2", "outputs": "noutputs", "J_q": "nu, nq", "J_u": "nu, nu", "J_p": "nu, np",
    "J_inputs": "nu, ninputs", "J_t": "nu",
}  # fmt: skip
"""Axes of arguments and results after those of the batch."""


class NumpyWriter(Writer):
    """NumPy source of a program; a place is (variable of a dict, its expression, text that follows)."""

    def __init__(
        self,
        program: Program,
        formulas: list[FormulaKind],
        records: list[RecordFormula],
        energy_outputs: list[tuple[int, int]],
    ):
        super().__init__(program, formulas, records, energy_outputs)
        self.table.values["CONSTANTS"] = [c.index for c in self.system.constants_of]
        self.printer = NumpyPrinter()
        self.tables: dict[str, list[str]] = {}

    # -- the language ----------------------------------------------------------------------------------------------

    def lines(self, block: Block, place: Place, link: str = "") -> list[str]:
        taken = {s.name for s in block.loads} | {s.target.name for s in block.statements}
        variables: dict[str, str] = {}
        body: list[str] = []

        def access(array: str, name: str) -> str:
            variable, expression, text = place(array, name)
            if not variable:
                return f"{expression}{text}"
            if variable in taken:
                variable += "_at"
            variables[variable] = f"{variable} = {expression}"
            return f"{variable}{text}"

        for symbol, (array, name) in block.loads.items():
            body.append(f"{symbol} = {access(array, name)}")
        tag = ""
        for s in block.statements:
            comment = f"  # {s.tag}" if s.tag and s.tag != tag else ""
            tag = s.tag
            body.append(f"{s.target} = {self.printer(s.expression)}{comment}")
        for array, name, value in block.stores:
            text = self.printer(value)
            if array == "pivot":
                body.append(f"check_pivot({text}, {link})")
                continue
            if array in RECORDS and value.is_Number:
                text = "ZERO" if value == 0 else f"np.float64({text})"
            where = access(array, name)
            body.append(f"{where} = {where} + {text}" if array.endswith("_sum") else f"{where} = {text}")
        return [*variables.values(), *body]

    def signature(self, name: str, lanes: bool, indexed: bool) -> str:
        return f"def {name}(a{', i' if indexed else ''}):"

    def call(self, name: str, lanes: bool, index: str | None) -> str:
        return f"{name}(a{'' if index is None else f', {index}'})"

    def repeat(self, start: int, end: int, step: int, inward: bool, calls: list[str]) -> list[str]:
        bounds = f"{end - step}, {start - 1}, {-step}" if inward else f"{start}, {end}, {step}"
        return [f"for i in range({bounds}):", *(f"    {c}" for c in calls)]

    def dispatch(self, count: int, inward: bool, calls: list[tuple[int, str]]) -> list[str]:
        lines = [f"for i in range({count - 1}, -1, -1):" if inward else f"for i in range({count}):"]
        lines.append("    match link[i][KIND]:")
        for kind, call in calls:
            lines += [f"        case {kind}:", f"            {call}"]
        return lines if calls else []

    def repeat_rows(self, name: str, lanes: bool, count: int) -> list[str]:
        return [f"for i in range({count}):", f"    {name}(a, i)"]

    def add_table(self, name: str, rows: list[list[int]] | list[list[float]]) -> None:
        self.tables[name] = [", ".join(map(repr, row)) for row in rows]

    def place(self, kind: LinkKind, sweep: str, array: str, name: str) -> Located:
        entry = self.table.entry
        me = str(kind.members[0]) if len(kind.members) == 1 else "i"
        if array in ("me", "lme", "lane"):
            return self.field_of_record(array, me, name)
        if array in ("up", "lup"):
            return self.field_of_record(array, _plain(entry("UP", kind)), name)
        if array in OF_COORDINATES:
            return self.element(array, _index(entry("Q", kind), int(name)))
        if array in OF_SPEEDS:
            return self.element(array, _index(entry("U", kind), int(name)))
        if array == "trig":
            return self.element(name, _plain(entry("TRIG", kind)))
        if array == "dp":
            return self.element("dp", _plain(entry(f"P{name}", kind)))
        if array in ("energy_sum", "denergy_sum"):
            return self.element(array.removesuffix("_sum"), "0")
        if array == "c" and name in kind.data:
            return "", "numbers", f"[{_index(entry('NUMBERS', kind), kind.data[name])}]"
        if array == "c":
            return self.constant(kind.shape.index, _plain(entry("CONSTANTS", kind)), name)
        raise KeyError(array)

    def element(self, array: str, index: str) -> Located:
        return "", f"a.{array}", f"[{index}]"

    def field_of_record(self, array: str, link: str, name: str) -> Located:
        memory = {"me": "records", "up": "records", "lme": "slots", "lup": "slots", "lane": "lanes"}[array]
        return array, f"a.{memory}[{link}]", f'["{name}"]'

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
            "links": [f'"{link.name}"' for link in self.system.links],
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
) -> str:
    """The text of ``<name>_numpy.py``; needs NumPy only.

    Parameters
    ----------
    program, formulas, records, energy_outputs
        See `Writer`.
    """
    return render("numpy/module.py.jinja", NumpyWriter(program, formulas, records, energy_outputs).context())


__all__ = ["NumpyWriter", "write_numpy"]
