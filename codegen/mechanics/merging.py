"""Sweeps over few links, each merged into one block: values that links pass to neighbours become local variables.

If every link has a function of its own (`statements.laid_out`), the blocks of a sweep run in a known order, and each of their
components has a known address. They are merged (`codegen.program.fusion`) if the result is short enough.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from ..program.addresses import Kind
from ..program.block import Block, Component
from ..program.formula import Formula
from ..program.fusion import fused
from ..program.passes import drop_dead, propagate_copies, share_values
from ..program.plan import Merged, Plan
from ..program.store import MARGIN, Store, argument
from .address import SystemAddresses
from .expansion import Program
from .fields import remainder
from .memory import SystemLayout
from .plan import plan_of, read_of_ground
from .stores import GROUND_LINK, KEPT, RECORD, SLOT
from .structure.kinds import UnitKind
from .sweeps import FALLING, INWARD, SWEEP, transpose_name

LONGEST, LONGEST_ALONG = 1000, 300
"""Largest number of symbols that a merged sweep may read, because compilers take long for long functions. The second
limit is for sweeps over directions: values common to all directions stay in registers only if the loop is short."""

OF_LINKS = RECORD, KEPT[RECORD], SLOT
"""Types of memory that exist for the ground as well as for links."""

GRAVITY = argument("gravity")
"""Minus the acceleration of gravity, which functions of single links read from the record of the ground."""


def with_merged_sweeps(program: Program, formulas: list[Formula]) -> Plan:
    """The plan of a program after merging sweeps where possible and removing memory that is no longer needed."""
    addresses = SystemAddresses(program, SystemLayout(program), True)
    called = {s.then for s in SWEEP.values()}
    found = {}
    for name in program.blocks:
        sweep = SWEEP[name]
        kinds = [k for k in sweep.sequence(program.system) if program.blocks[name].get(k.index, Block("", "")).stores]
        alone = len(kinds) > 1 and all(len(addresses.instances(k, name)) == 1 for k in kinds)
        length = sum(program.blocks[name][k.index].length for k in kinds)
        if (
            alone
            and length <= (LONGEST_ALONG if sweep.lanes else LONGEST)
            and not (sweep.groups or sweep.then or name in called)
        ):
            found[name] = _Merging(program, addresses, name).run(
                reversed(kinds) if sweep.direction == INWARD else kinds
            )
    slots, gravity = program.slots, program.system.gravity
    if gravity is None or not any(n in gravity.shape.varying for s in FALLING for n in slots.get(s, ())):
        # A varying gravity puts its tangent into the ground's slot, so the fields of this slot stay. Formulas use the
        # ground's slot of a sweep and of its transpose alike, so both keep the same fields.
        both = {s: [x for x in slots if _base(x) == _base(s) and x in program.blocks] for s in slots}
        slots = {
            s: [n for n in of if any(x not in found or (SLOT, n) in found[x].names for x in both[s])]
            for s, of in slots.items()
        }
    program = replace(program, merged=found, slots=slots)
    read = {n for m, _, n in program.read_outside if m[0] is RECORD}
    read |= read_of_ground(program, RECORD) | read_of_ground(program, KEPT[RECORD])
    return plan_of(replace(program, ground_fields=program.ground_fields & read), formulas)


def _base(sweep: str) -> str:
    """The sweep of which the given sweep is the transpose; otherwise the given sweep."""
    return sweep.removesuffix(transpose_name(""))


class _Merging:
    """Merges the blocks of a sweep into one.

    Attributes
    ----------
    first : dict of address to (Store, str)
        The component that represents all components with this address.
    of : dict of Store to (kind, Store)
        See `Merged`.
    shared : set of (Store, str)
        Components that only neighbouring links exchange, within this sweep; they become local variables.
    ground : set of Store
        The ground's stores, whose values are known before the sweep.
    """

    def __init__(self, program: Program, addresses: SystemAddresses, sweep: str):
        self.program, self.addresses, self.sweep = program, addresses, sweep
        self.first: dict[object, Component] = {}
        self.of: dict[Store, tuple[Kind, Store]] = {}
        self.shared: set[Component] = set()
        self.ground: set[Store] = set()
        of = program.system.fields_of_gravity
        self.of_gravity = {name: str(remainder.a.components.index(of[name])) for name in of}
        self._stores: dict[tuple[UnitKind, Store], Store] = {}

    def run(self, kinds: Iterable[UnitKind]) -> Merged:
        blocks = [self.placed(kind) for kind in kinds]
        block = fused(self.sweep, SWEEP[self.sweep].title, blocks, lambda store, name: (store, name) in self.shared)
        block.stores = [(a, n, e) for a, n, e in block.stores if (a.plain, n) not in self.shared]
        for improve in (propagate_copies, share_values, drop_dead):
            block = improve(block)
        block.early = True
        components = [*block.loads.values(), *((a.plain, n) for a, n, _ in block.stores)]
        ground = {(self.of[a][1].memory, n) for a, n in block.loads.values() if a in self.ground}
        return Merged(block, self.of, {(a.memory, n) for a, n in components}, ground)

    def placed(self, kind: UnitKind) -> Block:
        """The block of a kind, with components of equal address replaced by one."""
        block = self.program.blocks[self.sweep][kind.index]
        loads = {s: self.component(kind, a, n) for s, (a, n) in block.loads.items()}
        stores = []
        for a, n, e in block.stores:
            store, name = self.component(kind, a.plain, n)
            stores.append((store.sum if a.adds else store, name, e))
        return Block(block.name, block.title, loads, block.statements, stores)

    def component(self, kind: UnitKind, store: Store, name: str) -> Component:
        """The component that represents a component of a kind's store."""
        mine = self._stores.get((kind, store))
        if mine is None:
            mine = self._stores[kind, store] = Store(store.label, store.owner, store.memory)
            self.of[mine] = kind, store
            if store.memory in OF_LINKS and self.is_ground(kind, store):
                self.ground.add(mine)
        if store.memory is MARGIN:
            return mine, f"{kind.index}.{name}"
        if mine in self.ground and store.memory is not SLOT and name in self.of_gravity:
            self.of[GRAVITY] = kind, GRAVITY
            return GRAVITY, self.of_gravity[name]
        at = self.addresses.address(kind, self.sweep, store, name)
        part = at.component if isinstance(at.component, str) else at.component.values
        found = self.first.setdefault((at.region, at.row and at.row.values, part, at.form), (mine, name))
        if (store.memory is SLOT or at.region == "near") and mine not in self.ground:
            self.shared.add(found)
        return found

    def is_ground(self, kind: UnitKind, store: Store) -> bool:
        """Whether a store accesses the ground's memory."""
        if store.owner is GROUND_LINK:
            return True
        return len(self.program.system.links) in self.addresses.accessed_links(kind, self.sweep, store)


__all__ = ["with_merged_sweeps"]
