"""Memory that a call of a header function needs in addition to the memory of the sweeps: pointers, and arrays of the
call."""

from __future__ import annotations

from dataclasses import field

from ...program import procedure as steps
from ...program.procedure import Array, Procedure, walk, within
from ...records import dataclass


@dataclass(slots=True)
class Memory:
    """The pointers and arrays of the call that procedures need. The pointers are members of the two structs of a call: one
    for values, one for values per direction.

    Attributes
    ----------
    fields, lane_fields : dict of str to bool
        Names of arrays to which the structs have pointers; the value is true if some function writes the array.
    numbers : dict of str to bool
        Arguments that are passed by value; the value is true if they are written.
    own : dict of Array to int
        Arrays in the workspace, with their offsets in scalars. Arrays that no procedure uses at the same time share memory.
    size : int
    """

    fields: dict[str, bool] = field(default_factory=dict)
    lane_fields: dict[str, bool] = field(default_factory=dict)
    numbers: dict[str, bool] = field(default_factory=dict)
    own: dict[Array, int] = field(default_factory=dict)
    size: int = 0

    def declarations(
        self, kept: dict[str, str], kept_lanes: dict[str, str], real: str
    ) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
        """Types and names of the members of both structs; `kept` gives the regions of the sweeps with their types."""

        def pointers(type_: str, fields: dict[str, bool]) -> list[tuple[str, str]]:
            known = kept.keys() | kept_lanes.keys()
            return [(f"{'' if written else 'const '}{type_} *", n) for n, written in fields.items() if n not in known]

        of_values = pointers(real, self.fields) + [(f"{real} ", name) for name in self.numbers]
        of_values += [(f"{type_} *", name) for name, type_ in kept.items()]
        of_lanes = pointers("LANES", self.lane_fields) + [(f"{type_} *", name) for name, type_ in kept_lanes.items()]
        return of_values, of_lanes


def call_memory(procedures: tuple[Procedure, ...]) -> Memory:
    """The pointers and arrays of procedures that are not part of the memory of sweeps."""
    found = Memory()
    together: dict[Array, set[Array]] = {}
    for p in procedures:
        held, apart = p.held(), p.written_apart()
        if p.modes is not None:
            found.fields.setdefault(p.modes.name, False)
        for a in (*p.arguments, *p.seeds):
            name = held[a.name].name if a.name in held else a.name
            if not a.shape and not a.lanes:
                found.numbers[name] = False
            elif not read_apart(p, a):
                (found.lane_fields if a.lanes else found.fields).setdefault(name, False)
        for r in p.results:
            if r.name not in apart:
                (found.lane_fields if r.lanes else found.fields)[r.name] = True
        own: dict[Array, None] = {}
        for step in walk(p.steps):
            written: list[Array] = []
            match step:
                case steps.Own() | steps.Hold():
                    written, own[step.array] = [step.array], None
                case steps.Bind() | steps.Zero() | steps.ZeroEntries():
                    written = [step.array]
                case steps.AddEntry() | steps.Combine():
                    written = [step.to]
                case steps.Single():
                    for a, _ in (*step.reads, *step.writes):
                        found.lane_fields.setdefault(a.name, False)
                    written = [a for a, _ in step.writes]
                case steps.AllColumns():
                    found.lane_fields |= {a.name: True for a in step.arrays}
                case steps.Primitives():
                    found.lane_fields[step.of.name] = True
                case _:
                    pass
            for a in written:
                (found.lane_fields if a.lanes else found.fields)[a.name] = True
        for a in own:
            together.setdefault(a, set()).update(own)
    _place(found, together)
    return found


def read_apart(procedure: Procedure, array: Array) -> bool:
    """Whether an argument is an array for the single direction of a `Single` step."""
    return any(of is array or of == array for s in procedure.steps if isinstance(s, steps.Single) for _, of in s.reads)


def _place(found: Memory, together: dict[Array, set[Array]]) -> None:
    """Place each array of a call at the first offset at which it overlaps no array that is used at the same time."""
    for array, others in together.items():
        at = 0
        for other in sorted((o for o in others if o in found.own), key=lambda o: found.own[o]):
            if found.own[other] < at + room(array) and at < found.own[other] + room(other):
                at = found.own[other] + room(other)
        found.own[array] = at
        found.size = max(found.size, at + room(array))


def room(array: Array) -> int:
    """Space of an array in the workspace, in whole cache lines."""
    return -(-array.size * (8 if array.lanes else 1) // 8) * 8


def lays_out(procedure: Procedure) -> bool:
    """Whether a function needs the whole workspace, instead of the regions of a few sweeps."""
    return any(
        isinstance(s, (steps.Prepare, steps.Perform, steps.Own, steps.AllColumns)) for s in within(procedure.steps)
    )
