"""The plan of a system's solver, from which targets print code."""

from __future__ import annotations

from functools import partial

from ..program.addresses import Kind
from ..program.digits import value_of
from ..program.formula import Formula
from ..program.plan import Ground, Plan, Swept
from ..program.shape import Constants
from ..program.store import Memory
from .address import SystemAddresses
from .expansion import Program
from .fields import remainder
from .memory import SystemLayout
from .procedures import arrays
from .stores import KEPT, LINK, RECORD, TANGENT
from .structure.element_kinds import ElementKind
from .structure.kinds import EarKind, RegionKind, UnitKind
from .structure.system import System
from .sweeps import FALLING, INWARD, SWEEP


def plan_of(program: Program, formulas: list[Formula]) -> Plan:
    """The plan of an expanded system."""
    system = program.system
    model, layout = system.model, SystemLayout(program)
    owners = [
        *((link.name, c) for link, c in zip(system.links, system.constants_of, strict=True)),
        *((loop.name, c) for loop, c in zip(model.loops, system.closure_constants, strict=True)),
        *((e.element.name, e.constants) for e in system.elements),
    ]
    called: dict[Kind, tuple[str, str]] = {
        kind: _called(system, kind) for kind in (*system.kinds, *system.unit_kinds, *system.element_kinds)
    }
    return Plan(
        {name: _swept(program, name) for name in program.blocks},
        formulas,
        [link.name for link in system.links],
        called,
        system.constants,
        system.shapes,
        owners,
        _ground(program),
        arrays(system),
        system.arrays,
        layout,
        partial(SystemAddresses, program, layout),
    )


def _swept(program: Program, name: str) -> Swept:
    sweep, system = SWEEP[name], program.system
    return Swept(
        sweep.title,
        sweep.lanes,
        sweep.direction == INWARD,
        sweep.groups,
        sweep.then,
        sweep.kinds(system),
        sweep.sequence(system),
        program.blocks[name],
        program.merged.get(name),
    )


def _called(system: System, kind: UnitKind) -> tuple[str, str]:
    """Name for the members of a kind in comments, and name of the first member."""
    what = "ears" if isinstance(kind, EarKind) else "regions" if isinstance(kind, RegionKind) else "links"
    return f"{kind.first.type}s" if isinstance(kind, ElementKind) else what, unit_name(system, kind, kind.members[0])


def unit_name(system: System, kind: Kind, member: int) -> str:
    """The name by which comments call a member of a kind."""
    if isinstance(kind, RegionKind):
        return f"region of {kind.sources} sources"
    if isinstance(kind, ElementKind):
        return system.elements[member].element.name
    if not isinstance(kind, EarKind):
        return system.links[member].name
    ear = system.regions.ears[member]
    names = ", ".join(system.links[i].name for i in ear.links)
    loops = ", ".join(system.model.loops[c.loop].name for c in ear.closures)
    return f"{names} closed by {loops}" if loops else names


def _ground(program: Program) -> Ground:
    """The ground's record: at rest, with acceleration -g; and its tangent if gravity depends on parameters."""
    g, of_gravity = program.system.gravity, program.system.fields_of_gravity
    fields: dict[str, float | str] = {
        name: of_gravity.get(name, float(name.endswith(("W.xx", "W.yy", "W.zz"))))
        for name in sorted(program.ground_fields)
    }
    kept = fields.keys() & read_of_ground(program, KEPT[RECORD])
    if g is None:
        return Ground(fields, kept, {}, None, [], FALLING, [])
    shape = g.shape
    components = {name: shape.varying.get(name) or g.values.get(name, 0.0) for name in remainder.a.components}
    slots = dict.fromkeys(n for s in FALLING for n in program.slots.get(s, ()))
    tangents = [(name, _derivatives(program.system, g, name)) for name in slots if name in shape.varying]
    places = {n: k for k, n in enumerate(program.system.model.parameter_names)}
    twice = []
    for name in program.fields.get(TANGENT, ()):
        if of_gravity.get(name) in shape.varying:
            first = _derivatives(program.system, g, of_gravity[name])
            second = [
                (factor, places[p], k)
                for j, p in enumerate(g.parameters)
                for factor, k in _derivatives(program.system, g, f"{of_gravity[name]}/{j}")
            ]
            twice.append((name, first, second))
    return Ground(fields, kept, components, g, tangents, FALLING, twice)


def _derivatives(system: System, g: Constants, name: str) -> list[tuple[float | str, int]]:
    """The nonzero derivatives of a component of gravity, each as a number or constant with its parameter."""
    shape = g.shape
    places = {n: k for k, n in enumerate(system.model.parameter_names)}
    terms: list[tuple[float | str, int]] = []
    for j, p in enumerate(g.parameters):
        key = f"{name}/{j}"
        if key in shape.fixed and value_of(shape.fixed[key]) != 0:
            terms.append((value_of(shape.fixed[key]), places[p]))
        elif key in shape.varying:
            terms.append((shape.varying[key], places[p]))
    return terms


def read_of_ground(program: Program, memory: Memory) -> set[str]:
    """Components of the ground's record, or of its kept record, that sweeps may read."""
    found = {n for merged in program.merged.values() for m, n in merged.ground if m is memory}
    for sweep in program.blocks.keys() - program.merged.keys():
        loads = [at for block in program.blocks[sweep].values() for at in block.loads.values()]
        found |= {n for store, n in loads if store.memory is memory and store.owner is not LINK}
    return found
