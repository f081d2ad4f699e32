"""Memory layout: fields of records, constants, tables of numbers."""

from __future__ import annotations

from ..program.layout import Layout, first_with, numbered
from .expansion import Program
from .stores import ADJOINT, KEPT, LAID_OUT, ME, RECORD, UP
from .structure.kinds import EarKind
from .structure.system import System
from .sweeps import RUN_AGAIN


class SystemLayout(Layout):
    """The memory layout of a system, with the first entry of each link, loop and force element.

    Attributes
    ----------
    number_offsets, closure_number_offsets, element_number_offsets : list of int
        Index of the first number of each link, loop and force element in the array of numbers.
    trig_of : list of int
        For each link, the index of its joint angle's cosine and sine.
    """

    def __init__(self, program: Program):
        system = program.system
        used: dict[str, set[str]] = {}
        for sweep, blocks in program.blocks.items():
            for b in blocks.values():
                for store, n in [*b.loads.values(), *((a, n) for a, n, _ in b.stores)]:
                    if store is ME or store is UP:
                        used.setdefault(n, set()).add(sweep)
        passing = {n for n, sweeps in used.items() if all(n in program.transient.get(x, ()) for x in sweeps)}
        found = {memory.region: program.fields.get(memory, []) for memory in (*LAID_OUT, *KEPT.values())}
        found["kept_adjoints"] = _added_again(program) if "gaps_adjoint" in program.blocks else []
        found["records"] = [n for n in found["records"] if n not in passing]
        links, regions = len(system.links), system.regions
        self.fields = {region: numbered(names) for region, names in found.items()}
        self.rows = {
            "records": links + 1, "near": system.slots, "ears": len(regions.ears), "couplings": regions.elimination.slots,
            "regions": len(regions.regions), "kept": links + 1, "kept_regions": len(regions.regions), "slots": system.slots,
            "tangents": links + 1, "adjoints": links + 1, "adjoint_tangents": links + 1, "mass_tangents": links + 1,
            "adjoint_changes": links + 1, "kept_adjoints": links + 1,
            "lanes": links, "region_lanes": len(regions.regions), "columns": links,
        }  # fmt: skip
        self.near = {sweep: numbered(fields) for sweep, fields in program.transient.items()}
        for sweep, merged in program.merged.items():
            self.near[sweep] = numbered([n for n in self.near.get(sweep, ()) if (RECORD, n) in merged.names])
        self.near_size = -(-max(map(len, self.near.values()), default=0) // 8) * 8
        self.slots = {sweep: numbered(fields) for sweep, fields in program.slots.items()}
        self.slot_forms, self.near_forms = first_with(self.slots), first_with(self.near)
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

    def _constants(self, system: System) -> None:
        self.constant_fields = {
            shape.index: numbered([name for _, name, _ in shape.block.stores]) for shape in system.shapes
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


def _added_again(program: Program) -> list[str]:
    """Adjoints that sweeps of `RUN_AGAIN` change. A copy of them is kept, from which the sweeps run a second time."""
    blocks = [b for s in RUN_AGAIN for b in program.blocks.get(s, {}).values()]
    added = {n for b in blocks for store, n, _ in b.stores if store.memory is ADJOINT}
    return [n for n in program.fields.get(ADJOINT, []) if n in added]
