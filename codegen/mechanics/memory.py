"""Where everything lies: fields of records, constants, tables of numbers."""

from __future__ import annotations

from .expansion import Program
from .stores import (
    COLUMN,
    COUPLING_BLOCK,
    EAR_RECORD,
    KEPT,
    LANE,
    ME,
    RECORD,
    REGION_LANE,
    REGION_RECORD,
    UP,
)
from .structure.kinds import EarKind
from .structure.system import System


class Layout:
    """Places of the values of a program.

    Attributes
    ----------
    record, lane : dict of str to int
        Index of a field in a link's record, and in what is kept per link and direction.
    ear, region, region_lane, coupling : dict of str to int
        The same of ears, regions and couplings.
    kept, kept_region : dict of str to int
        The same of scalars that are kept of links and regions, for sweeps that run backwards.
    slots : dict of str to dict of str to int
        The same for the slots, by sweep: slots are used anew by every sweep.
    near : dict of str to dict of str to int
        The same for what a sweep's links only tell their neighbours, without direction.
    slot_forms, near_forms : dict of str to str
        By sweep: the first one with the same fields there, in the same order.
    constant_fields : dict of int to dict of str to int
        By shape: index of a constant among those of its links.
    forms : dict of int to int
        By shape: the first shape with the same constants, in the same order.
    constant_offsets : dict of int to int
        By constants: where they begin.
    numbers, number_offsets, closure_number_offsets, element_number_offsets
        Constants that differ within a kind but depend on no parameter, and where each link's, loop's and force element's begin.
    angles, trig_of
        Coordinates that are angles, and for each link the number of its angle.
    driven_angles
        What of prescribed motion is an angle; these have the numbers after the others.
    added_angles : list of float
        What is added to each of both, rad.
    """

    def __init__(self, program: Program):
        self.program = program
        system = self.system = program.system
        used: dict[str, set[str]] = {}
        for sweep, blocks in program.blocks.items():
            for b in blocks.values():
                for store, n in [*b.loads.values(), *((a, n) for a, n, _ in b.stores)]:
                    if store is ME or store is UP:
                        used.setdefault(n, set()).add(sweep)
        passing = {n for n, sweeps in used.items() if all(n in program.transient.get(x, ()) for x in sweeps)}
        self.record = {name: i for i, name in enumerate(n for n in program.fields[RECORD] if n not in passing)}
        self.near = {sweep: {name: i for i, name in enumerate(fields)} for sweep, fields in program.transient.items()}
        self.near_size = -(-max((len(f) for f in program.transient.values()), default=0) // 8) * 8
        self.lane = {name: i for i, name in enumerate(program.fields[LANE])}
        self.ear = {name: i for i, name in enumerate(program.fields[EAR_RECORD])}
        self.region = {name: i for i, name in enumerate(program.fields[REGION_RECORD])}
        self.coupling = {name: i for i, name in enumerate(program.fields[COUPLING_BLOCK])}
        self.column = {name: i for i, name in enumerate(program.fields[COLUMN])}
        self.region_lane = {name: i for i, name in enumerate(program.fields[REGION_LANE])}
        self.kept, self.kept_region = (
            {name: i for i, name in enumerate(program.fields.get(KEPT[m], ()))} for m in (RECORD, REGION_RECORD)
        )
        self.slots = {sweep: {name: i for i, name in enumerate(fields)} for sweep, fields in program.slots.items()}
        self.slot_forms, self.near_forms = _first_with(self.slots), _first_with(self.near)
        self._constants(system)
        turning = [link for link in system.links if link.joint.angle is not None]
        free, driven = ([link for link in turning if link.joint.driven is is_driven] for is_driven in (False, True))
        self.angles = [link.q + link.joint.angle for link in free if link.joint.angle is not None]
        self.driven_angles = [3 * link.driven for link in driven]
        self.added_angles = [link.turned for link in (*free, *driven)]
        self.trig_of, counts = [], [0, len(self.angles)]
        for link in system.links:
            self.trig_of.append(counts[link.joint.driven])
            counts[link.joint.driven] += link.joint.angle is not None
        self.angles_padded = -(-len(turning) // 8) * 8

    def _constants(self, system: System) -> None:
        self.constant_fields = {
            shape.index: {name: i for i, (_, name, _) in enumerate(shape.block.stores)} for shape in system.shapes
        }
        known: dict[tuple[str, ...], int] = {}
        self.forms = {shape: known.setdefault(tuple(fields), shape) for shape, fields in self.constant_fields.items()}
        self.constant_offsets: dict[int, int] = {}
        size = 0
        for c in system.constants:
            self.constant_offsets[c.index] = size
            size += len(self.constant_fields[c.shape.index])
        self.constants_size = size
        self.numbers: list[float] = []
        rows: dict[tuple[float, ...], int] = {}

        def offset(row: tuple[float, ...]) -> int:
            if row not in rows:
                rows[row] = len(self.numbers)
                self.numbers += row
            return rows[row]

        self.number_offsets = [
            offset(tuple(c.values.get(name, 0.0) for name in kind.data))
            for kind, c in zip(system.kind_of, system.constants_of, strict=True)
        ]
        self.closure_number_offsets = [0] * len(system.closure_constants)
        for unit, ear_kind in zip(system.regions.order, system.unit_kind_of, strict=True):
            if isinstance(ear_kind, EarKind):
                for closure, of_kind in zip(system.regions.ears[unit.number].closures, ear_kind.closures, strict=True):
                    values = system.closure_constants[closure.loop].values
                    row = tuple(values.get(name, 0.0) for name in of_kind.data)
                    self.closure_number_offsets[closure.loop] = offset(row)
        self.element_number_offsets = [0] * len(system.elements)
        for element_kind in system.element_kinds:
            for n in element_kind.members:
                values = system.elements[n].constants.values
                self.element_number_offsets[n] = offset(tuple(values.get(name, 0.0) for name in element_kind.data))


def _first_with(fields: dict[str, dict[str, int]]) -> dict[str, str]:
    """For each sweep, the first one with the same fields."""
    known: dict[tuple[str, ...], str] = {}
    return {sweep: known.setdefault(tuple(names), sweep) for sweep, names in fields.items()}


class IndexTable:
    """A table of integers with a row for each link or unit: a column is added when something uses it, and none where the
    integers of a kind are the same, or go up in equal steps.

    Parameters
    ----------
    name : str
        The table's.
    rows : int
    """

    def __init__(self, name: str, rows: int):
        self.name = name
        self.count = rows
        self.columns: dict[str, list[int]] = {}

    def entry(self, column: str, instances: list[int], values: list[int]) -> str:
        """Expression, in i, of the values that belong to the instances i of a kind."""
        if len(set(values)) == 1:
            return str(values[0])
        step, rest = divmod(values[1] - values[0], instances[1] - instances[0])
        offset = values[0] - step * instances[0]
        if not rest and step > 0 and all(v == step * i + offset for i, v in zip(instances, values, strict=True)):
            term = "i" if step == 1 else f"{step}*i"
            return f"{term} {'+' if offset > 0 else '-'} {abs(offset)}" if offset else term
        known = self.columns.setdefault(column, [0] * self.count)
        for i, v in zip(instances, values, strict=True):
            known[i] = v
        return f"{self.name}[i][{self.name.upper()}_{column}]"

    def rows(self) -> list[str]:
        return [", ".join(str(c[i]) for c in self.columns.values()) for i in range(self.count)]
