"""Writes the NumPy module of a solver: the statements of the C, elementwise over a batch of states.

Memory is addressed by name instead of number: every link has a record, slots and lanes, each a dict of arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ...elementary import ELEMENTWISE
from ...model.model import Model
from ...program import procedure as procedures
from ...program.addresses import Kind
from ...program.algebra import ZERO
from ...program.block import Block
from ...program.chosen_steps import routines
from ...program.digits import text_of
from ...program.field_table import identifier
from ...program.plan import Plan
from ...program.procedure import Procedure
from ...program.store import MARGIN, MODES, Store
from ..function import in_lines
from ..language import Located, Place
from ..repetition import Repeated, repeated
from ..templates import render
from ..writer import Writer
from . import FLOAT64, NUMPY
from . import functions as numpy_functions
from .functions import NumpyFunctions
from .printer import NumpyPrinter


class NumpyWriter(Writer):
    """Writes the NumPy module of a program."""

    numbered = False

    def __init__(
        self,
        model: Model,
        plan: Plan,
        asked: tuple[Procedure, ...],
        reserved: frozenset[str],
    ):
        super().__init__(model, plan, asked, NUMPY, FLOAT64, reserved)
        self.printer = NumpyPrinter(NUMPY, FLOAT64)
        self.tables: dict[str, list[str]] = {}

    # -- the language ----------------------------------------------------------------------------------------------

    def lines(
        self, block: Block, place: Place, culprit: Callable[[str], str] | None = None, each: str = ""
    ) -> list[str]:
        names = self.called_by(block, place)
        printer = self.printer.calling(names)
        taken = {s.name for s in block.loads} | {s.target.name for s in block.statements} | set(names.values())
        variables: dict[str, str] = {}
        body: list[str] = []

        def access(store: Store, name: str) -> str:
            at = place(store, name)
            if not at.variable:
                return f"{at.row}{at.text}"
            variable = f"{at.variable}_at" if at.variable in taken else at.variable
            variables[variable] = f"{variable} = {at.row}"
            return f"{variable}{at.text}"

        for symbol, (store, name) in block.loads.items():
            if store is MODES:
                body.append(f"{symbol.name} = 0.0")
                continue
            body.append(f"{names.get(symbol.name, symbol.name)} = {access(store, name)}")
        tag = ""
        for s in block.statements:
            comment = f"  # {s.tag}" if s.tag and s.tag != tag else ""
            tag = s.tag
            body.append(f"{s.target} = {printer(s.expression)}{comment}")
        for store, name, value in block.stores:
            text = printer(value)
            if store.memory is MARGIN:
                assert culprit is not None
                body.append(f"check_pivot(a, {text}, {culprit(name)})")
                continue
            if store.memory.region and not store.lanes and value.is_Number:
                # NumPy numbers: 1.0/0.0 raises in Python, while NumPy gives infinity, which the pivot check finds
                text = "ZERO" if value is ZERO else f"np.float64({text})"
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

    def dispatch(self, count: int, inward: bool, entry: str, calls: list[tuple[list[int], str]]) -> list[str]:
        lines = [f"for i in range({count - 1}, -1, -1):" if inward else f"for i in range({count}):"]
        lines.append(f"    match {entry}:")
        for kinds, call in calls:
            lines += [f"        case {' | '.join(map(str, kinds))}:", f"            {call}"]
        return lines if calls else []

    def repeat_rows(self, name: str, lanes: bool, count: int) -> list[str]:
        return [f"for i in range({count}):", f"    {name}(a, i)"]

    def add_table(self, name: str, rows: list[list[int]] | list[list[float]]) -> None:
        self.tables[name] = [", ".join(map(repr, row)) for row in rows]

    def place(self, kinds: Sequence[Kind], sweep: str, store: Store, name: str) -> Located:
        at = self.addresses.placed(kinds, sweep, store, name)
        if store.memory.region or at.region == "constants":
            return Located(at.variable, f"a.{at.region}[{at.row}]", _key(at.component))
        if at.region == "trig":
            return self.element(name, at.row)
        if not at.row:
            return self.element(at.region, at.component)
        self.reads_numbers = self.reads_numbers or at.region == "numbers"
        index = _index(at.row, int(at.component))
        return Located("", "numbers", f"[{index}]") if at.region == "numbers" else self.element(at.region, index)

    def element(self, array: str, index: str, lanes: bool = False) -> Located:
        return Located("", f"a.{array}", f"[{index}]", names=self.names_of(array, index))

    def field_of_record(self, store: Store, link: str, name: str) -> Located:
        return Located(store.label.replace("#", "_"), f"a.{store.memory.region}[{link}]", _key(name))

    def constant(self, shape: int, constants: str, name: str) -> Located:
        return Located("c", f"a.constants[{constants}]", _key(name))

    def place_of_constants(self, index: int) -> int:
        return index

    def number_of_row(self, table: str, row: str, index: int) -> Located:
        return Located("k", f"{table}[{row}]", f"[{index}]")

    # -- the file --------------------------------------------------------------------------------------------------

    def _gravity(self, value: float | str) -> str:
        """The expression of a component of gravity: a number, or a constant that depends on parameters."""
        if not isinstance(value, str):
            return text_of(value)
        assert self.plan.ground.constants is not None
        return f"a.constants[{self.plan.ground.constants.index}]{_key(value)}"

    def ground(self) -> list[str]:
        """Lines that set the ground's record."""
        lines = []
        ground = self.plan.ground
        for name, of in ground.fields.items():
            value = ground.gravity[of] if isinstance(of, str) else of
            text = "ZERO" if value == 0 else self._gravity(value)
            lines.append(f"a.records[GROUND]{_key(name)} = {text}")
        return [*lines, "a.kept[GROUND] = a.records[GROUND]"] if self.layout.fields["kept"] else lines

    def prepared(self, what: str) -> list[str]:
        match what:
            case procedures.CONSTANTS:
                return self.constants[1]
            case procedures.GROUND:
                return self.ground()
            case procedures.ANGLES:
                return self.angles()
            case procedures.GROUND_AT_REST:
                return [
                    f"a.records[GROUND]{_key(n)} = ZERO"
                    for n, of in self.plan.ground.fields.items()
                    if isinstance(of, str)
                ]
            case procedures.GROUND_TANGENT:
                return [
                    f"a.slots[GROUND]{_key(name)} = {self._along(terms)}" for name, terms in self.plan.ground.tangents
                ]
            case procedures.GROUND_TANGENT_AT_REST:
                return [f"a.slots[GROUND]{_key(name)} = 0.0" for name, _ in self.plan.ground.tangents]
            case procedures.GROUND_TANGENT_TRANSPOSED:
                return [
                    f"a.dp[{p}] = a.dp[{p}] + {self._gravity(factor)}*a.slots[GROUND]{_key(name)}"
                    for name, terms in self.plan.ground.tangents
                    for factor, p in terms
                ]
            case procedures.ADJOINT_VALUES:
                return ["a.adjoints = [Adjoints() for _ in a.records]"]
            case procedures.ADJOINT_TANGENTS:
                return [
                    *self.no_tangents(),
                    *(f"a.tangents[GROUND]{_key(n)} = {self._along(first)}" for n, first, _ in self.plan.ground.twice),
                ]
            case procedures.NO_TANGENTS:
                return self.no_tangents()
            case procedures.KEPT_ADJOINTS:
                return ["a.kept_adjoints = [Adjoints(x) for x in a.adjoints]"]
            case procedures.RESTORED_ADJOINTS:
                return ["a.adjoints = a.kept_adjoints"]
            case procedures.GROUND_TWICE:
                return self.ground_twice()
            case procedures.ADJOINTS | procedures.PASSING_ADJOINTS:
                return self.adjoints()
        return []

    def angles(self) -> list[str]:
        """Lines that compute cosines and sines of all angles, as arrays: the first axis numbers the angles, the others are
        those of the batch."""
        angles, driven = self.layout.angles, self.layout.driven_angles
        if not angles and not driven:
            return []
        free = f"a.q[{f':{len(angles)}' if angles == list(range(len(angles))) else 'angle_of'}]"
        added = any(self.layout.added_angles)
        if not driven:  # without prescribed angles, all angles are in one array
            return [
                f"angles = ({free}.T + added_angle).T" if added else f"angles = {free}",
                "a.cos, a.sin = np.cos(angles), np.sin(angles)",
            ]
        return [
            f"angles = [{f'*{free}, ' if angles else ''}*(a.prescribed[i] for i in driven_angle_of)]",
            *(["angles = [x + v for x, v in zip(angles, added_angle)]"] if added else []),
            "a.cos, a.sin = [np.cos(x) for x in angles], [np.sin(x) for x in angles]",
        ]

    def adjoints(self) -> list[str]:
        """Lines that empty the dicts of values per direction; a missing entry counts as zero."""
        lines = [f"a.{name} = [Adjoints() for _ in a.{name}]" for name in ("slots", "lanes")]
        if self.layout.rows["regions"]:
            lines.append("a.region_lanes = [Adjoints() for _ in a.region_lanes]")
        model = self.model
        lines += ["a.dtau = [0.0] * NU"] if model.forces else []
        return lines + [f"a.d{name} = [0.0] * {n}" for name, n in self.plan.arrays.items()]

    def no_tangents(self) -> list[str]:
        """Lines that empty the memory of tangents and of tangents of adjoints."""
        regions = ("tangents", "adjoint_tangents", "mass_tangents", "adjoint_changes")
        return [f"a.{r} = [Adjoints() for _ in a.records]" for r in regions if self.layout.fields[r]]

    def ground_twice(self) -> list[str]:
        """Lines that add the contributions of the ground's adjoint to the tangents of gradients."""
        lines = []
        for name, first, second in self.plan.ground.twice:
            along, value = (f"a.{region}[GROUND]{_key(name)}" for region in ("adjoint_tangents", "adjoints"))
            terms = [(p, f"{self._gravity(factor)}*{along}") for factor, p in first]
            terms += [(p, f"{self._gravity(factor)}*{value}*a.dp[{k}]") for factor, p, k in second]
            lines += [f"a.dgp[{p}] = a.dgp[{p}] + {text}" for p, text in terms]
        return lines

    def _along(self, terms: list[tuple[float | str, int]]) -> str:
        return " + ".join(f"{self._gravity(factor)}*a.dp[{p}]" for factor, p in terms) or "0.0"

    def pivots(self, sweep: str) -> bool:
        """Whether a sweep checks pivots; for a function that calls formulas, whether any of them does."""
        if sweep in self.blocks:
            return any(store.memory is MARGIN for b in self.blocks[sweep].values() for store, _, _ in b.stores)
        return self.singular_outputs and any(
            s.lanes and s.called == sweep and "outputs" in s.targets for s in self.groups
        )

    def memory(self) -> list[str]:
        """Lines that give a call its memory."""
        model, layout, rows = self.model, self.layout, self.layout.rows
        kept: dict[str, int | str] = {
            "records": "GROUND + 1", "slots": "GROUND + 1", "lanes": "GROUND + 1", "constants": len(self.plan.constants),
            "ears": rows["ears"], "couplings": rows["couplings"], "regions": rows["regions"],
            "region_lanes": rows["region_lanes"], "kept": "GROUND + 1" if layout.fields["kept"] else 0,
            "kept_regions": rows["kept_regions"] if layout.fields["kept_regions"] else 0,
        }  # fmt: skip
        lines = [f"self.{name} = [{{}} for _ in range({n})]" for name, n in kept.items() if n]
        arrays = {a.name: numpy_functions.count(a) for a in numpy_functions.made(self.procedures)}
        arrays |= {n: "NU" for n in ("tau", "dtau") if model.forces}
        arrays |= {d + name: str(n) for name, n in self.plan.arrays.items() for d in ("", "d")}
        return [*lines, *(f"self.{name} = [0.0] * {n}" for name, n in arrays.items())]

    def flat_tables(self) -> list[tuple[str, list[str], str]]:
        """The beginning, the lines and the end of each table; tables of numbers are NumPy arrays."""
        found = []
        if self.reads_numbers:
            found.append(("numbers = np.array([", in_lines(list(map(text_of, self.layout.numbers)), 6), "])"))
        for name, rows in self.tables.items():
            ends = ("np.array((", "))") if name.startswith("numbers") else ("(", ")")
            found.append((f"{name} = {ends[0]}", [f"({row},)," for row in rows], ends[1]))
        angles = self.layout.angles
        if self.prepares(procedures.ANGLES) and angles != list(range(len(angles))):
            found.append(("angle_of = [", in_lines(list(map(str, angles)), 16), "]"))
        if self.prepares(procedures.ANGLES) and (driven := self.layout.driven_angles):
            found.append(("driven_angle_of = [", in_lines(list(map(str, driven)), 16), "]"))
        if self.prepares(procedures.ANGLES) and any(added := self.layout.added_angles):
            found.append(("added_angle = np.array([", in_lines(list(map(text_of, added)), 6), "])"))
        return found

    def context(self) -> dict[str, Any]:
        """The variables with which the template is rendered."""
        context = self.shared_context()
        lines = NumpyFunctions(self.prepared, self.pivots)
        model = self.model
        names = {"LINKS": self.plan.links}
        singular: list[tuple[str, str, str]] = []
        errors = []
        if model.loops:
            names["LOOPS"] = [loop.name for loop in model.loops]
            singular.append(("SingularLoopError", "GROUND", "LOOPS[link - GROUND]"))
            if couplings := [loop.name for loop in model.loops if loop.is_coupling]:
                names["COUPLINGS"] = couplings
            errors.append(f"numpy/singular_{'coupling' if couplings else 'loop'}.py.jinja")
        if any(e.singular for e in model.loads):
            names["ELEMENTS"] = [f"{e.type} {e.name}" for e in model.loads]
            first = f"GROUND + {len(model.loops)}" if model.loops else "GROUND"
            singular.append(("SingularForceError", first, f"ELEMENTS[link - ({first})]"))
            errors.append("numpy/singular_force.py.jinja")
        if self.singular_outputs:
            names["OUTPUTS"] = [output.name for output in model.outputs]
            more = len(model.loops) + len(model.loads)
            first = f"GROUND + {more}" if more else "GROUND"
            singular.append(("SingularOutputError", first, f"OUTPUTS[link - ({first})]"))
            errors.append("numpy/singular_output.py.jinja")
        return context | {
            "tables": self.flat_tables(),
            "names": [(n, listed(found)) for n, found in names.items()],
            "memory": self.memory(),
            "singular": singular[::-1],  # tests start with the errors of the largest numbers
            "errors": errors,
            "functions": [*context["functions"], *(f for _, functions in context["lane_functions"] for f in functions)],
            "routines": [lines.routine(r) for r in routines(self.procedures)],
            "public": [lines.function(f) for f in self.procedures],
            "elementwise": (elementwise := [f for f in ELEMENTWISE if f in self.printer.called]),
            "imports": ["math"] if elementwise else [],
            "own_words": [f"numpy/{w}.py.jinja" for w in self.printer.words if w != "floor"],
        }


def listed(names: list[str]) -> list[str]:
    """The lines of a tuple of names; repeated names are computed when the module is loaded."""
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


def _key(component: str) -> str:
    """The subscript that selects a component in a dict, as text."""
    return f'["{identifier(component)}"]'


def _index(entry: str, offset: int) -> str:
    if entry.isdigit():
        return str(int(entry) + offset)
    return f"{entry} + {offset}" if offset else entry


def write_numpy(
    model: Model,
    plan: Plan,
    asked: tuple[Procedure, ...],
    reserved: frozenset[str] = frozenset(),
) -> str:
    """The text of ``<name>_numpy.py``, which needs only NumPy.

    Parameters
    ----------
    model, plan, asked, reserved
        See `language.Language`.
    """
    return render("numpy/module.py.jinja", NumpyWriter(model, plan, asked, reserved).context())


__all__ = ["NumpyWriter", "write_numpy"]
