"""Preparations of functions before their sweeps, in C: the ground, sines and cosines, adjoints."""

from __future__ import annotations

from functools import cached_property

from ...program import procedure as procedures
from ...program.field_table import identifier
from ..function import Function
from .functions import in_all
from .memory import CMemory
from .types import TWICE, TYPES, near_name

FEW_ANGLES = 16
"""Up to this number of angles, sine and cosine of each are computed in variables. With more angles they are stored in memory,
where they arrive well before they are read."""


class CPrepared(CMemory):
    """Writes the computations that precede the sweeps, in C."""

    def loop(self, sweep: str) -> Function:
        f = super().loop(sweep)
        f.lines = self.ground(sweep) + f.lines or ["(void)a;"]
        return f

    # -- the ground ------------------------------------------------------------------------------------------------

    @cached_property
    def keeping(self) -> set[str]:
        """Sweeps that store scalars for transposed sweeps."""
        return {
            s
            for s, of in self.blocks.items()
            if any(a.memory.region in ("kept", "kept_regions") for b in of.values() for a, _, _ in b.stores)
        }

    def ground(self, sweep: str | None = None) -> list[str]:
        """Lines that set the state of the ground, at rest with acceleration -g, for one sweep or for all sweeps."""
        lines = []
        near = self.layout.near.get(sweep, {}) if sweep else {}
        kept = self.plan.ground.kept if sweep in self.keeping else ()
        for name, value in self.plan.ground.fields.items():
            if sweep and name in near:
                region, place = "near", f"a->near[{near_name(self.layout.near_forms[sweep], name)}]"
            elif name in kept:
                region, place = "kept", f"a->kept[LINKS].{identifier(name)}"
            elif not sweep and name in self.layout.fields["records"]:
                region, place = "records", f"a->records[LINKS].{identifier(name)}"
            else:
                continue
            touched = self.touched.setdefault(sweep or "", set())
            touched.add(region)
            if isinstance(value, str):
                touched.add("gravity")
                lines.append(f"{place} = a->gravity[{list(self.plan.ground.gravity).index(value)}];")
            else:
                lines.append(f"{place} = {in_all(self.text(value))};")
        return lines

    def gravity(self) -> list[str]:
        """Lines that set the acceleration of the ground, -g."""
        found = map(self._gravity, self.plan.ground.gravity.values())
        return [f"a->gravity[{i}] = {v if v.startswith('a->') else in_all(v)};" for i, v in enumerate(found)]

    def _gravity(self, value: float | str) -> str:
        """The C expression of a component of gravity: a number, or a constant that depends on parameters."""
        if not isinstance(value, str):
            return self.text(value)
        g = self.plan.ground.constants
        assert g is not None
        index = self.layout.constant_offsets[g.index] + self.layout.constant_fields[g.shape.index][value]
        return f"a->constants[{index}]"

    def ground_tangent(self) -> tuple[list[str], list[str]]:
        """If gravity depends on parameters: lines that set the tangent of the ground, and lines that set this tangent
        to zero."""
        lines: list[str] = []
        zero: list[str] = []
        for name, terms in self.plan.ground.tangents:
            place = f"{self._ground_slot()}.{identifier(name)}"
            text = " + ".join(f"{self._gravity(factor)}*a->dp[{p}].at[h]" for factor, p in terms) or "(VECTOR){0}"
            lines.append(f"EACH_VECTOR {place}.at[h] = {text};")
            zero.append(f"{place} = NOTHING;")
        return lines, zero

    def _ground_slot(self) -> str:
        forms = self.layout.slot_forms  # all these sweeps have the same form
        return f"a->slots[0].{next(forms[s] for s in self.plan.ground.sweeps if s in forms)}"

    def ground_transposed(self) -> list[str]:
        """Lines that add the contributions of the ground's tangent to the adjoints of parameters."""
        return [
            f"EACH_VECTOR a->dp[{p}].at[h] += {self._gravity(factor)}*{self._ground_slot()}.{identifier(name)}.at[h];"
            for name, terms in self.plan.ground.tangents
            for factor, p in terms
        ]

    def no_adjoints(self) -> list[str]:
        """Lines that set the adjoints of one vector of weights to zero."""
        return [
            f"for (long i = 0; i < {n}L; ++i) (({self.scalar.word} *)a->{name})[i] = {in_all(self.zero)};"
            for name, _, n in self.regions()
            if name == "adjoints" and not self.assigned(name)
        ]

    def copied(self, to: str, of: str) -> list[str]:
        """Lines that copy adjoints of one vector of weights."""
        names = map(identifier, self.layout.fields["kept_adjoints"])
        copies = [f"    a->{to}[i].{n} = a->{of}[i].{n};" for n in names]
        return [f"for (int i = 0; i < {self.layout.rows[to]}; ++i) {{", *copies, "}"] if copies else []

    def assigned(self, region: str) -> bool:
        """Whether first contributions to a region of memory are assigned, so that it need not be set to zero before."""
        blocks = [b for of in self.blocks.values() for b in of.values()]
        return any(not a.adds and a.memory.region == region for b in blocks for a, _, _ in b.stores)

    def no_tangents(self, regions: tuple[str, ...] = TWICE) -> list[str]:
        """Lines that set the tangents of adjoints and the tangents of the ground's values to zero."""
        lines = []
        for name, _, n in self.regions():
            if name in regions and (name == "tangents" or not self.assigned(name)):
                first = n - n // self.layout.rows[name] if name == "tangents" else 0
                lines.append(f"for (long i = {first}L; i < {n}L; ++i) ((LANES *)a->{name})[i] = NOTHING;")
        return lines

    def ground_along(self) -> list[str]:
        """Lines that set the tangent of the ground's record."""
        lines = []
        for name, first, _ in self.plan.ground.twice:
            text = " + ".join(f"{self._gravity(factor)}*a->dp[{p}].at[h]" for factor, p in first) or "(VECTOR){0}"
            lines.append(f"EACH_VECTOR a->tangents[LINKS].{identifier(name)}.at[h] = {text};")
        return lines

    def ground_twice(self) -> list[str]:
        """Lines that add the contributions of the ground's adjoint to the tangents of gradients."""
        lines = []
        for name, first, second in self.plan.ground.twice:
            along, value = f"a->adjoint_tangents[LINKS].{identifier(name)}", f"a->adjoints[LINKS].{identifier(name)}"
            terms = [(p, f"{self._gravity(factor)}*{along}.at[h]") for factor, p in first]
            terms += [(p, f"{self._gravity(factor)}*{value}*a->dp[{k}].at[h]") for factor, p, k in second]
            lines += [f"EACH_VECTOR a->dgp[{p}].at[h] += {text};" for p, text in terms]
        return lines

    def ground_gradient(self) -> list[str]:
        """Lines that add the contributions of the ground's adjoint to the gradient."""
        return [
            f"a->gp[{p}] += {self._gravity(factor)}*a->adjoints[LINKS].{identifier(name)};"
            for name, first, _ in self.plan.ground.twice
            for factor, p in first
        ]

    # -- the files -------------------------------------------------------------------------------------------------

    @property
    def few_angles(self) -> bool:
        """Whether there are few enough angles to pass each by name."""
        return len(self.layout.angles) + len(self.layout.driven_angles) <= FEW_ANGLES

    def sines(self) -> list[str]:
        """Names of the template files for sines and cosines."""
        if not self.layout.angles_padded or not self.prepares(procedures.ANGLES):
            return []
        return [
            "c/angles_at_once.c.jinja", *(["c/put_angles.c.jinja"] if self.few_angles else []), "c/sincos.c.jinja"
        ]  # fmt: skip

    def prepared(self, what: str) -> list[str]:
        layout = self.layout
        angles, driven = layout.angles, layout.driven_angles
        free, n = len(angles), len(angles) + len(driven)
        match what:
            case procedures.CONSTANTS:
                return self.constants[1]
            case procedures.GROUND:
                return self.gravity() + self.ground()
            case procedures.ANGLES if n and self.few_angles:
                each = [*(f"a->q[{i}]" for i in angles), *(f"a->prescribed[{i}]" for i in driven)]
                each = [
                    f"{x} + {in_all(self.text(v))}" if v else x for x, v in zip(each, layout.added_angles, strict=True)
                ]
                each += [in_all(self.zero)] * (-n % 4)
                return [
                    *(f"PUT_ANGLES(a->trig + ANGLES + {i}, {', '.join(each[i : i + 4])});" for i in range(0, n, 4)),
                    f"sines_and_cosines({n}, a->trig);",
                ]
            case procedures.ANGLES if n:
                angle = "i" if angles == list(range(free)) else "angle_of[i]"
                places = f"a->trig[ANGLES + {free} + i] = a->prescribed[driven_angle_of[i]];"
                return [
                    *([f"for (int i = 0; i < {free}; ++i) a->trig[ANGLES + i] = a->q[{angle}];"] if angles else []),
                    *([f"for (int i = 0; i < {n - free}; ++i) {places}"] if driven else []),
                    *(
                        [f"for (int i = 0; i < {n}; ++i) a->trig[ANGLES + i] += added_angle[i];"]
                        if any(layout.added_angles)
                        else []
                    ),
                    f"for (int i = {n}; i < ANGLES; ++i) a->trig[ANGLES + i] = {in_all(self.zero)};",
                    f"sines_and_cosines({n}, a->trig);",
                ]
            case procedures.GROUND_AT_REST if self.plan.ground.gravity:
                record = [line for line in self.ground() if "gravity" in line]
                return [f"for (int i = 0; i < 3; ++i) a->gravity[i] = {in_all(self.zero)};", *record]
            case procedures.GROUND_TANGENT:
                return self.ground_tangent()[0]
            case procedures.GROUND_TANGENT_AT_REST:
                return self.ground_tangent()[1]
            case procedures.GROUND_TANGENT_TRANSPOSED:
                return self.ground_transposed()
            case procedures.ADJOINTS | procedures.PASSING_ADJOINTS:
                return [
                    f"for (long i = 0; i < {n}L; ++i) {f'((LANES *)a->{name})' if name in TYPES else f'a->{name}'}[i] = NOTHING;"
                    for name, lanes, n in self.regions()
                    if lanes and name not in ("columns", *TWICE) and (name != "lanes" or what == procedures.ADJOINTS)
                ]
        return self.prepared_twice(what)

    def prepared_twice(self, what: str) -> list[str]:
        """Lines of a preparation for second derivatives."""
        match what:
            case procedures.ADJOINT_VALUES:
                return self.no_adjoints()
            case procedures.ADJOINT_TANGENTS:
                return [*self.no_tangents(), *self.ground_along()]
            case procedures.NO_TANGENTS:
                return self.no_tangents()
            case procedures.KEPT_ADJOINTS:
                return self.copied("kept_adjoints", "adjoints")
            case procedures.RESTORED_ADJOINTS:
                return self.copied("adjoints", "kept_adjoints")
            case procedures.GROUND_TWICE:
                return self.ground_twice()
            case procedures.GROUND_GRADIENT:
                return self.ground_gradient()
        return []
