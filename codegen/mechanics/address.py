"""Addresses of the components of stores. For each instance of a kind, they give the object whose memory a store
accesses."""

from __future__ import annotations

from functools import cached_property

from ..model.model import GROUND, closure_row_names
from ..program.addresses import Address, Addresses, IndexTable, Kind, Row
from ..program.store import CONSTANT, Memory, Owner, Store
from .expansion import Program
from .memory import SystemLayout
from .stores import (
    BASE_LINK,
    CE_DGP,
    CE_GP,
    CL_DGP,
    CL_GP,
    COEFFICIENTS,
    COEFFICIENTS_LANE,
    COUPLING_BLOCK,
    DGP,
    EAR_RECORD,
    ELEMENT,
    ELEMENT_END,
    ENERGY,
    ENERGY_LANE,
    GP,
    KEPT,
    LINK,
    LOOP,
    ME,
    OWN_COUPLING,
    PARENT,
    PARTNER,
    PER_ANGLE,
    PER_CONDITION,
    PER_CONDITION_LANE,
    PER_COORDINATE,
    PER_COORDINATE_LANE,
    PER_DRIVE,
    PER_DRIVE_LANE,
    PER_LOOP,
    PER_MOTION,
    PER_MOTION_LANE,
    PER_PARAMETER,
    PER_PARAMETER_LANE,
    PER_SPEED,
    PER_SPEED_LANE,
    RECORD,
    REGION_LANE,
    REGION_RECORD,
    ROOT,
    SLOT,
    SUM,
    SUM_LANE,
    WRENCH,
    WRENCH_LANE,
)
from .structure.element_kinds import ElementKind
from .structure.kinds import EarKind, RegionKind, UnitKind
from .structure.owners import owner_links
from .structure.shared_constants import SharedConstants
from .sweeps import SWEEP

_COLUMN = {ELEMENT_END: "END_", ROOT: "ROOT_", BASE_LINK: "BASE_", PARTNER: "PARTNER_", PARENT: "UP"}
"""Prefixes of column names in the index tables, by the owner of the accessed memory."""

_PARAMETERS = {s.name: "gp" for s in (GP, CE_GP, CL_GP)} | {s.name: "dgp" for s in (DGP, CE_DGP, CL_DGP)}
"""For stores of gradients with respect to parameters, or of the tangents of these gradients: the array in generated code.
All other stores per parameter access the array ``dp``."""


class SystemAddresses(Addresses):
    """Addresses of a program, and the index tables that they need.

    Parameters
    ----------
    program : Program
    layout : SystemLayout
    numbered : bool
        If true, components have numbered places in a row, and links share the memory of components that only
        neighbours need. Otherwise components have names, and every link has memory for all of its components.
    """

    def __init__(self, program: Program, layout: SystemLayout, numbered: bool):
        super().__init__()
        self.system = program.system
        self.layout = layout
        self.numbered = numbered
        model = self.system.model
        self.links = IndexTable("link", len(self.system.links))
        several = not self.system.independent_links
        self.units = IndexTable("unit", len(self.system.regions.order)) if several else self.links
        self.elements = IndexTable("element", len(self.system.elements))
        self._parameter_places = {name: i for i, name in enumerate(model.parameter_names)}
        self._rows: dict[tuple[object, ...], Row] = {}

    @property
    def tables(self) -> list[IndexTable]:
        return [self.links, *([] if self.units is self.links else [self.units]), self.elements]

    # -- instances of a kind ----------------------------------------------------------------------------------------

    def table(self, sweep: str) -> IndexTable:
        spec = SWEEP[sweep]
        return self.elements if spec.element else self.units if spec.units else self.links

    def of_units(self, sweep: str) -> bool:
        return SWEEP[sweep].units

    def accessed_links(self, kind: UnitKind, sweep: str, store: Store) -> list[int]:
        """For each instance of a kind, the link whose memory a store accesses; the ground counts as the last link."""
        ground = len(self.system.links)
        found = owner_links(self.system, kind, store, SWEEP[sweep].units)
        return [ground if link == GROUND else link for link in found]

    def accessed_loops(self, kind: UnitKind, store: Store) -> list[int]:
        """For each instance of a kind of ears, the loop whose memory a store accesses."""
        regions = self.system.regions
        assert store.place is not None
        return [regions.ears[regions.order[i].number].closures[store.place].loop for i in kind.units]

    # -- rows ------------------------------------------------------------------------------------------------------

    def of_links(self, kind: UnitKind, sweep: str, store: Store, column: str, of: list[int] | None = None) -> Row:
        """For each instance, the number of the accessed link, or the link's entry in `of`."""
        key = (kind.index, kind.role, SWEEP[sweep].units, store.owner, store.place, column)
        if key not in self._rows:
            links = self.accessed_links(kind, sweep, store)
            place = "" if store.place is None else str(store.place)
            name = f"{_COLUMN.get(store.owner, '')}{column}{place}"
            self._rows[key] = Row(name, tuple(links if of is None else (of[i] for i in links)))
        return self._rows[key]

    def of_loops(self, kind: UnitKind, store: Store, column: str = "", of: list[int] | None = None) -> Row:
        """For each instance, the number of the accessed loop, or the loop's entry in `of`."""
        loops = self.accessed_loops(kind, store)
        return Row(f"LOOP{store.place}{column}", tuple(loops if of is None else (of[n] for n in loops)))

    @cached_property
    def slots(self) -> list[int]:
        """The memory slot of each link, then that of the ground."""
        return [*self.system.slot_of, 0]

    @cached_property
    def first_conditions(self) -> list[int]:
        """For each loop, the number of its first condition among the conditions of all loops."""
        found, at = [], 0
        for loop in self.system.model.loops:
            found.append(at)
            at += len(closure_row_names(loop))
        return found

    def _row(self, kind: UnitKind, sweep: str, store: Store, near: bool) -> Row:
        """For each instance of a kind, the row of the accessed memory in its array."""
        regions = self.system.regions
        if store.memory is EAR_RECORD:
            return Row("EAR", tuple(regions.order[i].number for i in kind.units))
        if store.memory in (REGION_RECORD, REGION_LANE, KEPT[REGION_RECORD]):
            units = [regions.order[i] for i in kind.units]
            numbers = (u.number if u.role == "region" else regions.ears[u.number].region for u in units)
            return Row("REGION", tuple(numbers))
        if store.memory is COUPLING_BLOCK:
            return self._coupling(kind, store)
        if self.numbered and (near or store.memory is SLOT):
            return self.of_links(kind, sweep, store, "SLOT", self.slots)
        return self.of_links(kind, sweep, store, "NUMBER")

    def _coupling(self, kind: UnitKind, store: Store) -> Row:
        """The memory slot of a coupling that ends at the unit, or to which the unit contributes."""
        elimination, place = self.system.regions.elimination, store.place
        assert place is not None
        units = [elimination.partners[i] for i in kind.units]
        own = store.owner is OWN_COUPLING
        couplings = [p.own[place] if own else p.contributions[place].coupling for p in units]
        return Row(f"{'OWN' if own else 'PAIR'}{place}", tuple(elimination.coupling_slot[c] for c in couplings))

    # -- addresses -------------------------------------------------------------------------------------------------

    def number(self, kind: Kind, sweep: str) -> Row:
        assert isinstance(kind, UnitKind)
        return self.of_links(kind, sweep, ME, "NUMBER")

    def find(self, kind: Kind, sweep: str, store: Store, name: str) -> Address:
        assert isinstance(kind, UnitKind)
        memory, system = store.memory, self.system
        variable = store.label.replace("#", "_")
        if memory.region:
            near = self.numbered and memory is RECORD and name in self.layout.near.get(sweep, {})
            region = "near" if near else memory.region
            return Address(f"near_{variable}" if near else variable, region, self._row(kind, sweep, store, near), name)
        if memory is CONSTANT:
            return self._constant(kind, sweep, store, name)
        if memory in (PER_PARAMETER, PER_PARAMETER_LANE):
            region = _PARAMETERS.get(store.name, "dp")
            return Address(region, region, None, self._parameter(kind, sweep, store.plain, int(name)))
        region = store.name
        row: Row | None = None
        if memory in (ENERGY, ENERGY_LANE):
            name = str(int("potential" in store.name))
            region = store.name.replace("potential", "energy")
        elif memory in (COEFFICIENTS, COEFFICIENTS_LANE):
            row = Row("COEFFICIENTS", tuple(system.elements[n].first for n in kind.members))
        elif memory not in (SUM, SUM_LANE):
            of_loop = store.owner is LOOP
            column, of = self._begin_of[memory, of_loop]
            row = self.of_loops(kind, store, column, of) if of_loop else self.of_links(kind, sweep, store, column, of)
        return Address(variable, region, row, name)

    @cached_property
    def _begin_of(self) -> dict[tuple[Memory, bool], tuple[str, list[int] | None]]:
        """By type of memory, and whether loops own it: the name of a table column, and for each link (or loop) the
        index of its first entry in the array. None stands for the link's or loop's own number."""
        links, loops = self.system.links, range(len(self.system.model.loops))
        return {
            (memory, of_loops): (column, of)
            for memories, of_loops, column, of in (
                ((PER_ANGLE,), False, "TRIG", self.layout.trig_of),
                ((PER_COORDINATE, PER_COORDINATE_LANE), False, "Q", [link.q for link in links]),
                ((PER_SPEED, PER_SPEED_LANE), False, "U", [link.u for link in links]),
                ((PER_MOTION, PER_MOTION_LANE), False, "MOTION", [3 * link.driven for link in links]),
                ((PER_DRIVE, PER_DRIVE_LANE), False, "DRIVEN", [link.driven for link in links]),
                ((WRENCH, WRENCH_LANE), False, "WRENCH", [6 * i for i in range(len(links))]),
                ((WRENCH, WRENCH_LANE), True, "_WRENCH", [6 * n for n in loops]),
                ((PER_CONDITION, PER_CONDITION_LANE), True, "_ROWS", self.first_conditions),
                ((PER_LOOP,), True, "", None),
            )
            for memory in memories
        }

    def _parameter(self, kind: UnitKind, sweep: str, store: Store, j: int) -> Row:
        """Number of the j-th design parameter on which the constants of a link, loop or force element depend."""
        system = self.system
        if store.owner is ELEMENT:
            owners, column = [system.elements[n].constants for n in kind.members], f"P{j}"
        elif store.owner is LOOP:
            owners = [system.closure_constants[n] for n in self.accessed_loops(kind, store)]
            column = f"LOOP{store.place}_P{j}"
        else:
            owners = [system.constants_of[i] for i in self.accessed_links(kind, sweep, store)]
            column = f"P{j}" if store.place is None else f"LINK{store.place}_P{j}"
        return Row(column, tuple(self._parameter_places[c.parameters[j]] for c in owners))

    def _constant(self, kind: UnitKind, sweep: str, store: Store, name: str) -> Address:
        """A constant that differs within a kind: it is a number, or a function of design parameters."""
        variable = store.label.replace("#", "_")
        shared = self._shared(kind, store)
        data = shared.data.get(name)
        owner = store.owner if store.owner in (ELEMENT, LOOP) else LINK
        column, begins = ("CONSTANTS", self.constants_begin) if data is None else ("NUMBERS", self.numbers_begin)
        if owner is ELEMENT:
            row = Row(column, tuple(begins[owner][n] for n in kind.members))
        elif owner is LOOP:
            row = self.of_loops(kind, store, f"_{column}", begins[owner])
        else:
            row = self.of_links(kind, sweep, store, column, begins[owner])
        if data is None:
            return Address(variable, "constants", row, name, self.layout.forms[shared.shape.index])
        return Address("k" if owner is ELEMENT else f"k_{variable}", "numbers", row, str(data))

    @cached_property
    def constants_begin(self) -> dict[Owner, list[int]]:
        """First entry of the constants of every link, loop and force element."""
        system = self.system
        owners = {
            LINK: system.constants_of,
            LOOP: system.closure_constants,
            ELEMENT: [e.constants for e in system.elements],
        }
        return {owner: [self._place_of_constants(c.index) for c in found] for owner, found in owners.items()}

    @cached_property
    def numbers_begin(self) -> dict[Owner, list[int]]:
        """First entry of the numbers of every link, loop and force element."""
        layout = self.layout
        numbers = (layout.number_offsets, layout.closure_number_offsets, layout.element_number_offsets)
        return dict(zip((LINK, LOOP, ELEMENT), numbers, strict=True))

    def _shared(self, kind: UnitKind, store: Store) -> SharedConstants:
        """The constants that a store accesses, as links, loops or force elements share them."""
        if isinstance(kind, EarKind):
            assert store.place is not None
            return kind.links[store.place] if store.owner is LINK else kind.closures[store.place]
        assert isinstance(kind, SharedConstants)
        return kind

    def _place_of_constants(self, index: int) -> int:
        return self.layout.constant_offsets[index] if self.numbered else index

    def stopped_at(self, kind: Kind, sweep: str, name: str) -> Row:
        """For each instance, the number that a function reports if the named pivot is zero. Links are numbered first,
        then loops, then force elements."""
        assert isinstance(kind, UnitKind)
        regions, links = self.system.regions, len(self.system.links)
        if isinstance(kind, RegionKind):
            sources = (regions.regions[regions.order[i].number].freedoms[int(name)][0] for i in kind.units)
            return Row(f"SOURCE{name}", tuple(sources))
        if isinstance(kind, ElementKind):
            first = links + len(self.system.model.loops)
            return Row("CULPRIT", tuple(first + n for n in kind.members))
        if isinstance(kind, EarKind):
            ears = (regions.ears[regions.order[i].number] for i in kind.units)
            return Row("LOOP", tuple(links + ear.closures[0].loop for ear in ears))
        instances = self.instances(kind, sweep)
        return Row("LINK", tuple(regions.order[i].number if SWEEP[sweep].units else i for i in instances))
