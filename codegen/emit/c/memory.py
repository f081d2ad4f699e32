"""The workspace of the C functions: regions of memory, their types and offsets."""

from __future__ import annotations

from functools import cached_property, partial

from ...program.procedure import Procedure, Run
from .call_memory import lays_out
from .columns import ColumnsInC
from .sweeps import CSweeps
from .types import ABOUT, LANE_REGIONS, TYPES, UNUSED_WORK, Type, cast, members, near_name, of_width


class CMemory(CSweeps):
    """Lays out the workspace of the C functions."""

    @cached_property
    def columns(self) -> ColumnsInC:
        """The functions that compute all columns of matrices at once."""
        return ColumnsInC(self.asked, self.scalar)

    def regions(self) -> list[tuple[str, bool, int]]:
        """Regions of the sweeps in the workspace: name, whether per direction, number of entries."""
        layout, forced = self.layout, self.model.nu if self.model.forces else 0
        # slots of sweeps that only NumPy runs, column by column, are left out
        sizes = {region: len(fields) for region, fields in layout.fields.items()} | {
            "near": layout.near_size,
            "slots": max((len(of) for sweep, of in layout.slots.items() if sweep in self.blocks), default=0),
        }

        def rows(*names: str) -> list[tuple[str, bool, int]]:
            return [(name, name in LANE_REGIONS, sizes[name] * layout.rows[name]) for name in names]

        found = [
            *rows(
                "records", "near", "ears", "couplings", "regions", "kept", "kept_regions", "adjoints", "kept_adjoints"
            ),
            ("gravity", False, len(self.plan.ground.gravity)),
            ("constants", False, layout.constants_size),
            ("trig", False, 2 * layout.angles_padded),
            ("tau", False, forced),
            *((name, False, n) for name, n in self.plan.arrays.items()),
            *self.column_regions(),
            *rows("slots", "lanes", "region_lanes", "tangents", "adjoint_tangents", "mass_tangents", "adjoint_changes"),
            ("dtau", True, forced),
            *((f"d{name}", True, n) for name, n in self.plan.arrays.items()),
        ]
        return [r for r in found if r[2]]

    def column_regions(self) -> list[tuple[str, bool, int]]:
        """Regions of the workspace for columns of matrices."""
        return self.columns.regions(len(self.layout.fields["columns"]), len(self.plan.links))

    def _type(self, region: str, lanes: bool) -> str:
        """The element type of a region of memory."""
        type_ = TYPES.get(region, "LANES" if lanes else self.scalar.word)
        return f"DIRECTIONS({type_})" if region in LANE_REGIONS else type_

    def types(self, lanes: bool) -> list[Type]:
        """Types of rows of memory, for values and for values per direction."""
        layout, number = self.layout, "LANES" if lanes else self.scalar.word
        found: list[Type] = []

        def add(about: str, name: str, lines: list[str], kind: str = "struct") -> None:
            attribute = "DIRECTIONS(ALIASES) " if lanes else ""
            found.append(Type(about, kind, lines, f"{attribute}{of_width(name, lanes)}"))

        if not lanes:
            for form, constants in layout.constant_fields.items():
                if constants and layout.forms[form] == form:
                    about = "Constants of one shape; _d0: derivative with respect to their first parameter."
                    add(about, f"constants_of_shape_{form}", members(constants, number))
        else:
            chosen = self.used_forms(layout.slot_forms, layout.slots)
            for sweep, users in chosen.items():
                add(f"In {', '.join(users)}.", f"slot_{sweep}", members(layout.slots[sweep], number))
            if chosen:
                lines = [f"{of_width(f'slot_{sweep}', lanes)} {sweep};" for sweep in chosen]
                add(ABOUT["slots"], TYPES["slots"], lines, "union")
        for region in ABOUT:
            fields = layout.fields.get(region)
            if fields and (region in LANE_REGIONS) == lanes:
                add(ABOUT[region], TYPES[region], members(fields, number))
        return found

    def used_forms(self, forms: dict[str, str], fields: dict[str, dict[str, int]]) -> dict[str, list[str]]:
        """Sweeps with equal fields: maps the first of these sweeps to all of them."""
        users = {f: [s for s, of in forms.items() if of == f and s in self.blocks] for f in forms if fields[f]}
        return {sweep: found for sweep, found in users.items() if found}

    def near_names(self) -> list[tuple[str, list[str]]]:
        """Places in the scratch shared by neighbouring links: for each set of fields, the sweeps that have it, and the lines
        of an enum with the places."""
        layout = self.layout
        return [
            (f"In {', '.join(users)}.", members(layout.near[sweep], "", ",", partial(near_name, sweep)))
            for sweep, users in self.used_forms(layout.near_forms, layout.near).items()
        ]

    def laid_out(self, procedure: Procedure, places: dict[str, int]) -> list[str]:
        """Lines that assign memory to a call: the whole workspace, or the regions of a few sweeps."""
        if lays_out(procedure):
            return ["lay_out(&c, work);"]
        touched = set[str]().union(*(self.touched.get(s.sweep, ()) for s in procedure.steps if isinstance(s, Run)))
        lines = [f"c.{name} = {cast(name)}(aligned(work) + {at});" for name, at in places.items() if name in touched]
        return lines if lines or procedure.seeds else UNUSED_WORK
