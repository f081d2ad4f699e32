"""Writes the NumPy module of a solver: the statements of the C, elementwise over a batch of states.

Memory is named instead of numbered: every link has a record, slots and lanes, and each is a dict of arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..mechanics import procedures
from ..mechanics.expansion import Program
from ..mechanics.formulas import FormulaKind
from ..mechanics.kinds import EarKind, LinkKind, SpringKind, UnitKind
from ..mechanics.outputs import RecordFormula
from ..program.block import Block
from ..program.procedure import Procedure, routines
from . import numpy_functions
from .function import in_lines
from .numpy_functions import NumpyFunctions
from .printer import NumpyPrinter
from .repetition import Repeated, repeated
from .templates import render
from .writer import Located, Place, Writer

OF_COORDINATES = ("q", "dq", "qdot", "dqdot", "step")
OF_SPEEDS = ("u", "given_u", "du", "udot", "dudot", "tau", "dtau", "b", "force", "dforce")
OF_LINKS = {
    **dict.fromkeys(("me", "up", "root", "base", "partner", "ground", "one", "two"), "records"),
    **dict.fromkeys(("lme", "lup", "lroot", "lbase", "lpartner", "lground"), "slots"),
    **dict.fromkeys(("lane", "laneroot", "lanebase", "lanepartner", "laneone", "lanetwo"), "lanes"),
}
"""Memory of links, by array."""
SCALARS = ("records", "ears", "regions", "couplings")
"""Memory whose numbers are NumPy's: Python's 1.0/0.0 would raise, NumPy's is found by the pivot check."""


class NumpyWriter(Writer):
    """NumPy source of a program; a place is (variable of a dict, its expression, text that follows)."""

    def __init__(
        self,
        program: Program,
        formulas: list[FormulaKind],
        records: list[RecordFormula],
        asked: tuple[Procedure, ...],
    ):
        super().__init__(program, formulas, records, asked)
        self.printer = NumpyPrinter()
        self.tables: dict[str, list[str]] = {}

    # -- the language ----------------------------------------------------------------------------------------------

    def lines(self, block: Block, place: Place, culprit: Callable[[str, str], str] | None = None) -> list[str]:
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
            if array in ("pivot", "rank"):
                assert culprit is not None
                body.append(f"check_pivot(a, {text}, {_plain(culprit(array, name))})")
                continue
            if self._memory(array) in SCALARS and value.is_Number:
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

    @staticmethod
    def _memory(array: str) -> str:
        stem = array.partition("#")[0].removesuffix("_sum")
        return OF_LINKS.get(stem) or {
            "ear": "ears",
            "region": "regions",
            "lregion": "region_lanes",
            "own": "couplings",
            "pair": "couplings",
        }.get(stem, "")

    def place(self, kind: UnitKind, sweep: str, array: str, name: str) -> Located:
        system = self.system
        stem, _, number = array.partition("#")
        stem = stem.removesuffix("_sum")
        variable = array.removesuffix("_sum").replace("#", "_")

        def of_links(column: str, of: list[int] | None = None) -> str:
            return _plain(self.of_links(kind, sweep, array, column, of))

        if stem in OF_LINKS:
            return variable, f"a.{OF_LINKS[stem]}[{of_links('NUMBER')}]", f'["{name}"]'
        if stem == "ear":
            numbers = [system.regions.order[i].number for i in kind.units]
            return "ear", f"a.ears[{_plain(self.entry(kind, sweep, 'EAR', numbers))}]", f'["{name}"]'
        if stem in ("own", "pair"):
            return variable, f"a.couplings[{_plain(self.coupling_slot(kind, sweep, array))}]", f'["{name}"]'
        if stem in ("region", "lregion"):
            at = _plain(self.entry(kind, sweep, "REGION", self.numbers_of_regions(kind)))
            return stem, f"a.{self._memory(array)}[{at}]", f'["{name}"]'
        if stem == "reaction":
            return self.element(stem, f"6*{self.of_links(kind, sweep, array, 'NUMBER')} + {name}")
        if stem == "loop_reaction":
            assert isinstance(kind, EarKind)
            at = self.entry(kind, sweep, f"LOOP{number}", self.loops_meant(kind, array))
            return self.element(stem, f"6*{at} + {name}")
        if stem == "condition":
            assert isinstance(kind, EarKind)
            return self.element(stem, _plain(self.entry(kind, sweep, f"LOOP{number}", self.loops_meant(kind, array))))
        if stem in ("position", "velocity", "dposition"):
            assert isinstance(kind, EarKind)
            begins = [self.closure_offsets[n] for n in self.loops_meant(kind, array)]
            return self.element(stem, _index(self.entry(kind, sweep, f"LOOP{number}_ROWS", begins), int(name)))
        if stem in OF_COORDINATES:
            return self.element(stem, _index(of_links("Q", [link.q for link in system.links]), int(name)))
        if stem in OF_SPEEDS:
            return self.element(stem, _index(of_links("U", [link.u for link in system.links]), int(name)))
        if stem == "trig":
            return self.element(name, of_links("TRIG", self.layout.trig_of))
        if stem in ("dp", "cldp", "csdp"):
            return self.element("dp", _plain(self.parameter(kind, sweep, array, int(name))))
        if stem in ("energy", "denergy"):
            return self.element(stem, "0")
        if stem in ("potential", "dpotential"):
            return self.element(stem.replace("potential", "energy"), "1")
        if stem in ("coefficient", "dcoefficient"):
            at = self.entry(kind, sweep, "COEFFICIENTS", [3 * n for n in kind.members])
            return self.element(stem, _index(at, int(name)))
        if stem == "cs":
            assert isinstance(kind, SpringKind)
            if name in kind.data:
                values = [self.layout.spring_number_offsets[n] for n in kind.members]
                return "", "numbers", f"[{_index(self.entry(kind, sweep, 'NUMBERS', values), kind.data[name])}]"
            at = self.entry(kind, sweep, "CONSTANTS", [system.spring_constants[n].index for n in kind.members])
            return variable, f"a.constants[{_plain(at)}]", f'["{name}"]'
        if stem == "c":
            of_kind = kind.links[int(number)] if isinstance(kind, EarKind) else kind
            assert isinstance(of_kind, LinkKind)
            if name in of_kind.data:
                return "", "numbers", f"[{_index(of_links('NUMBERS', self.layout.number_offsets), of_kind.data[name])}]"
            at = of_links("CONSTANTS", [c.index for c in system.constants_of])
            return variable, f"a.constants[{at}]", f'["{name}"]'
        if stem == "cl":
            assert isinstance(kind, EarKind)
            closure, loops = kind.closures[int(number)], self.loops_meant(kind, array)
            if name in closure.data:
                at = self.entry(
                    kind, sweep, f"LOOP{number}_NUMBERS", [self.layout.closure_number_offsets[n] for n in loops]
                )
                return "", "numbers", f"[{_index(at, closure.data[name])}]"
            at = self.entry(kind, sweep, f"LOOP{number}_CONSTANTS", [system.closure_constants[n].index for n in loops])
            return variable, f"a.constants[{_plain(at)}]", f'["{name}"]'
        raise KeyError(array)

    def element(self, array: str, index: str) -> Located:
        return "", f"a.{array}", f"[{index}]"

    def field_of_record(self, array: str, link: str, name: str) -> Located:
        return array, f"a.{OF_LINKS[array]}[{link}]", f'["{name}"]'

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

    def prepared(self, what: str) -> list[str]:
        angles = self.layout.angles
        match what:
            case procedures.CONSTANTS:
                return self.constants[1]
            case procedures.GROUND:
                return self.ground()
            case procedures.ANGLES if angles:
                place = f":{len(angles)}" if angles == list(range(len(angles))) else "angle_of"
                return [f"angles = a.q[{place}]", "a.cos, a.sin = np.cos(angles), np.sin(angles)"]
            case procedures.GROUND_AT_REST:
                return [f'a.records[GROUND]["{name}"] = ZERO' for name in self.ground_accelerations()]
            case procedures.GROUND_TANGENT:
                return [f'a.slots[GROUND]["{name}"] = {self._along(terms)}' for name, terms in self.ground_tangents()]
            case procedures.GROUND_TANGENT_AT_REST:
                return [f'a.slots[GROUND]["{name}"] = 0.0' for name, _ in self.ground_tangents()]
        return []

    def _along(self, terms: list[tuple[float | str, int]]) -> str:
        return " + ".join(f"{self._gravity(factor)}*a.dp[{p}]" for factor, p in terms) or "0.0"

    def pivots(self, sweep: str) -> bool:
        """Whether a sweep checks pivots."""
        return any(array in ("pivot", "rank") for b in self.blocks[sweep].values() for array, _, _ in b.stores)

    def memory(self) -> list[str]:
        """Lines that give a call its memory."""
        system, model = self.system, self.model
        regions = system.regions
        kept = {
            "records": "GROUND + 1", "slots": "GROUND + 1", "lanes": "GROUND + 1", "constants": len(system.constants),
            "ears": len(regions.ears), "couplings": regions.elimination.slots, "regions": len(regions.regions),
            "region_lanes": len(regions.regions),
        }  # fmt: skip
        lines = [f"self.{name} = [{{}} for _ in range({n})]" for name, n in kept.items() if n]
        arrays = {a.name: numpy_functions.count(a) for a in numpy_functions.made(self.procedures)}
        arrays |= {n: "NU" for n in ("tau", "dtau") if model.forces}
        arrays |= {n: str(3 * len(model.springs)) for n in ("coefficient", "dcoefficient") if model.springs}
        return [*lines, *(f"self.{name} = [0.0] * {n}" for name, n in arrays.items())]

    def flat_tables(self) -> list[tuple[str, list[str], str]]:
        """Beginning, lines and end of the tables; numbers are arrays."""
        found = []
        if self.layout.numbers:
            found.append(("numbers = np.array([", in_lines(list(map(repr, self.layout.numbers)), 6), "])"))
        for name, rows in self.tables.items():
            ends = ("np.array((", "))") if name.startswith("numbers") else ("(", ")")
            found.append((f"{name} = {ends[0]}", [f"({row},)," for row in rows], ends[1]))
        angles = self.layout.angles
        if angles != list(range(len(angles))):
            found.append(("angle_of = [", in_lines(list(map(str, angles)), 16), "]"))
        return found

    def context(self) -> dict[str, Any]:
        """What the templates are rendered with."""
        context = self.shared_context()
        lines = NumpyFunctions(self.prepared, self.pivots)
        model = self.model
        names = {"LINKS": [link.name for link in self.system.links]}
        singular: list[tuple[str, str, str]] = []
        errors = []
        if model.loops:
            names["LOOPS"] = [loop.name for loop in model.loops]
            singular.append(("SingularLoopError", "GROUND", "LOOPS[link - GROUND]"))
            errors.append("numpy/singular_loop.py.jinja")
        if model.springs:
            names["SPRINGS"] = [spring.name for spring in model.springs]
            first = f"GROUND + {len(model.loops)}" if model.loops else "GROUND"
            singular.append(("SingularSpringError", first, f"SPRINGS[link - ({first})]"))
            errors.append("numpy/singular_spring.py.jinja")
        return context | {
            "tables": self.flat_tables(),
            "names": [(n, listed(found)) for n, found in names.items()],
            "memory": self.memory(),
            "singular": singular[::-1],  # the last ones have the largest numbers
            "errors": errors,
            "routines": [lines.routine(r) for r in routines(self.procedures)],
            "public": [lines.function(f) for f in self.procedures],
        }


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
    asked: tuple[Procedure, ...],
) -> str:
    """The text of ``<name>_numpy.py``; needs NumPy only.

    Parameters
    ----------
    program, formulas, records, asked
        See `Writer`.
    """
    return render("numpy/module.py.jinja", NumpyWriter(program, formulas, records, asked).context())


__all__ = ["NumpyWriter", "write_numpy"]
