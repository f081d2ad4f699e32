"""Where everything lies: fields of records, constants, tables of numbers, the caller's workspace."""

from __future__ import annotations

from ..mechanics.expansion import Program
from ..mechanics.kinds import LinkKind, System
from ..model.model import GROUND


class Layout:
    """Places of the values of a program.

    Attributes
    ----------
    record, lane : dict of str to int
        Index of a field in a link's record, and in what is kept per link and direction.
    slots : dict of str to dict of str to int
        The same for the slots, by sweep: slots are used anew by every sweep.
    near : dict of str to dict of str to int
        The same for what a sweep's links only tell their neighbours, without direction.
    constant_fields : dict of int to dict of str to int
        By shape: index of a constant among those of its links.
    constant_offsets : dict of int to int
        By constants: where they begin.
    numbers, number_offsets
        Constants that differ within a kind but depend on no parameter, and where each link's begin.
    angles, trig_of
        Coordinates that are angles, and for each link the number of its angle.
    """

    def __init__(self, program: Program):
        self.program = program
        system = self.system = program.system
        used: dict[str, set[str]] = {}
        for sweep, blocks in program.blocks.items():
            for b in blocks.values():
                for a, n in [*b.loads.values(), *((a, n) for a, n, _ in b.stores)]:
                    if a in ("me", "up"):
                        used.setdefault(n, set()).add(sweep)
        passing = {n for n, sweeps in used.items() if all(n in program.transient.get(x, ()) for x in sweeps)}
        self.record = {name: i for i, name in enumerate(n for n in program.records if n not in passing)}
        self.near = {sweep: {name: i for i, name in enumerate(fields)} for sweep, fields in program.transient.items()}
        self.near_size = -(-max((len(f) for f in program.transient.values()), default=0) // 8) * 8
        self.lane = {name: i for i, name in enumerate(program.lanes)}
        self.slots = {sweep: {name: i for i, name in enumerate(fields)} for sweep, fields in program.slots.items()}
        self.slot_size = max((len(f) for f in program.slots.values()), default=0)
        self._constants(system)
        self.trig_of, count = [], 0
        for link in system.links:
            self.trig_of.append(count)
            count += link.joint == "revolute"
        self.angles = [link.q for link in system.links if link.joint == "revolute"]
        self.angles_padded = -(-len(self.angles) // 8) * 8

    def _constants(self, system: System) -> None:
        self.constant_fields = {
            shape.index: {name: i for i, (_, name, _) in enumerate(shape.block.stores)} for shape in system.shapes
        }
        self.constant_offsets: dict[int, int] = {}
        size = 0
        for c in system.constants:
            self.constant_offsets[c.index] = size
            size += len(self.constant_fields[c.shape.index])
        self.constants_size = size
        self.numbers: list[float] = []
        self.number_offsets: list[int] = []
        rows: dict[tuple[float, ...], int] = {}
        for kind, c in zip(system.kind_of, system.constants_of, strict=True):
            row = tuple(c.values.get(name, 0.0) for name in kind.data)
            if row not in rows:
                rows[row] = len(self.numbers)
                self.numbers += row
            self.number_offsets.append(rows[row])


class LinkTable:
    """The table of links: a column is added when something uses it, and none where all links of a kind agree."""

    def __init__(self, layout: Layout):
        system = layout.system
        n = len(system.links)
        places = {name: i for i, name in enumerate(system.model.parameter_names)}
        most = max((len(c.parameters) for c in system.constants_of), default=0)
        self.values: dict[str, list[int]] = {
            "KIND": [k.index for k in system.kind_of],
            "UP": [n if link.parent == GROUND else link.parent for link in system.links],
            "Q": [link.q for link in system.links],
            "U": [link.u for link in system.links],
            "TRIG": layout.trig_of,
            "CONSTANTS": [layout.constant_offsets[c.index] for c in system.constants_of],
            "NUMBERS": layout.number_offsets,
            "SLOT": system.slot_of,
            "UPSLOT": [0 if link.parent == GROUND else system.slot_of[link.parent] for link in system.links],
        }
        for j in range(most):
            self.values[f"P{j}"] = [
                places[c.parameters[j]] if j < len(c.parameters) else 0 for c in system.constants_of
            ]
        self.used: list[str] = []

    def entry(self, column: str, kind: LinkKind) -> str:
        """C expression of an entry of link i of a kind."""
        values = self.values[column]
        entries = {values[i] for i in kind.members}
        if len(entries) == 1:
            return str(entries.pop())
        offsets = {values[i] - i for i in kind.members}
        if len(offsets) == 1:
            offset = offsets.pop()
            return "i" if offset == 0 else f"(i {'+' if offset > 0 else '-'} {abs(offset)})"
        self.use(column)
        return f"link[i][{column}]"

    def use(self, column: str) -> None:
        if column not in self.used:
            self.used.append(column)

    def rows(self) -> list[str]:
        n = len(self.values["KIND"])
        return [", ".join(str(self.values[c][i]) for c in self.used) for i in range(n)]
