"""Lists the contents of a model or a generated package as lines of text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from .loops.errors import loops_counted
from .measure.machine import instructions
from .model.expressions import Expression, combine
from .model.forces import ForceElement
from .model.model import GROUND, Body, Coupling, Face, Joint, Model, Output, Point, Vector, joint_coordinates
from .model.outputs import MEASURES
from .wording import counted

FEW, FIRST = 40, 10
"""Sections with at most `FEW` entries are shown completely, longer ones with their first `FIRST` entries. If there are
more than `FEW` bodies, equal bodies share a line."""
LEVELS = 12
"""Maximum number of levels of indentation in the printed tree."""
LONG = 32
"""Length of an expression above which only its value at the default parameters is shown."""


def list_model(model: Model, verbose: bool = False) -> list[str]:
    """The sections of a model: parameters, bodies with their joints, loops, forces, motion, initial values, outputs.

    Parameters
    ----------
    verbose : bool
        Whether to list every entry of a large model.
    """
    return _Listing(model, verbose).lines()


class _Listing:
    """Writes the lines that list a model.

    Parameters
    ----------
    verbose : bool
        Whether to show all entries of long sections.
    """

    def __init__(self, model: Model, verbose: bool):
        self.model = model
        self.verbose = verbose
        self.defaults: dict[str, float] = {p.name: p.value for p in model.parameters}

    def lines(self) -> list[str]:
        model = self.model
        sizes = [
            counted(len(model.bodies), "body", "bodies"),
            counted(model.nq, "coordinate"),
            counted(model.nu, "speed"),
        ]
        if model.loops:
            sizes.append(loops_counted(model))
        lines = [f"{model.name}: {', '.join(sizes)}"]
        gravity = f"{self.vector(model.gravity)} m/s^2" if model.gravity else "none"
        lines.append(f"  gravity: {gravity}")
        lines += self.section("parameter", [self.parameter(p) for p in model.parameters])
        lines += self.row("inputs", model.inputs)
        lines += self.bodies()
        names = self.name
        lines += self.section(
            "loop",
            [
                f"{loop.name}: {loop.type}{self.axes(loop.axes)} from {self.face(loop.start)} to {self.face(loop.end)}"
                for loop in model.loops
                if not loop.is_coupling
            ],
        )
        lines += self.section("coupling", [self.coupling(x) for x in model.loops if isinstance(x, Coupling)])
        lines += self.section(
            "force",
            [f"{f.name}: on joint {names(f.body)}: {', '.join(self.long(v) for v in f.values)}" for f in model.forces],
        )
        for type_ in dict.fromkeys(e.type for e in model.loads):
            lines += self.section(type_, [self.element(e) for e in model.loads if e.type == type_])
        lines += self.section("motion", [f"{x.name} = {self.long(x.value)}" for x in model.prescribed])
        lines += self.row("initial q", self.initial(model.initial_q))
        lines += self.row("initial u", self.initial(model.initial_u))
        lines += self.row("independent, as the model asks", model.independent)
        return lines + self.section("output", [f"{o.name}: {self.output(o)}" for o in model.outputs])

    # -- sections --------------------------------------------------------------------------------------------------------

    def section(self, noun: str, entries: Sequence[str]) -> list[str]:
        shown = entries if self.verbose or len(entries) <= FEW else entries[:FIRST]
        lines = [f"  {noun} {entry}" for entry in shown]
        if len(shown) < len(entries):
            lines.append(f"  and {counted(len(entries) - len(shown), f'{noun} more', f'{noun}s more')}")
        return lines

    def row(self, title: str, entries: Sequence[str]) -> list[str]:
        limit = len(entries) if self.verbose or len(entries) <= FEW else FIRST
        return [f"  {title}: {self.some(entries, limit)}"] if entries else []

    def some(self, entries: Sequence[str], limit: int) -> str:
        shown = entries[:limit]
        return ", ".join(shown) + (f" and {len(entries) - len(shown)} more" if len(shown) < len(entries) else "")

    def parameter(self, p: Any) -> str:
        bounds = [f"{word} {x:g}" for word, x in (("at least", p.min), ("at most", p.max)) if x is not None]
        return f"{p.name} = {p.value} {p.unit}".rstrip() + (f" ({', '.join(bounds)})" if bounds else "")

    def initial(self, values: Mapping[str, Expression]) -> list[str]:
        return [f"{name} = {self.long(value)}" for name, value in values.items()]

    def coupling(self, x: Coupling) -> str:
        """The line of a coupling, such as ``gear: wheel = -(z1/z2) crank + 0.1``."""
        names = [
            joint_coordinates(self.name(t.body), self.model.bodies[t.body].joint.type)[0][t.index] for t in x.terms
        ]
        text = ""
        for name, term in zip(names[1:], x.terms[1:], strict=True):
            ratio = self.long(Expression(combine("neg", term.factor.tree)))
            sign, size = ("-", ratio[1:]) if re.fullmatch(r"-[\w.]+", ratio) else ("+", ratio)
            size = "" if size == "1" else f"{size} " if re.fullmatch(r"[\w.]+", size) else f"({size}) "
            text += f" {sign} {size}{name}" if text or sign == "-" else f" {size}{name}"
        offset = "" if x.offset.tree == ("number", 0) else f" + {self.long(x.offset)}"
        return f"{x.name}: {names[0]} ={text}{offset}"

    def output(self, o: Output) -> str:
        return MEASURES[o.measure].words(o, self)

    def bodies(self) -> list[str]:
        """The tree of bodies as lines; in large models, equal bodies share a line."""
        model = self.model
        if self.verbose or len(model.bodies) <= FEW:
            depth = {GROUND: 0}
            lines = []
            for k in model.outward:
                body = model.bodies[k]
                depth[k] = depth[body.parent] + 1
                on = "" if body.parent != GROUND and depth[k] <= LEVELS else f" on {self.name(body.parent)}"
                lines.append(
                    f"  {'  ' * min(depth[k] - 1, LEVELS)}body {body.name}: {self.joint(body)}{on}; {self.mass(body)}"
                )
            return lines
        alike: dict[Any, list[int]] = {}
        for k, b in enumerate(model.bodies):
            alike.setdefault(
                (
                    *(b.joint.type, b.joint.axes, b.joint.at, b.joint.rotation, b.joint.factors, b.joint.armature),
                    *(b.mass, b.com, b.inertia),
                ),
                [],
            ).append(k)
        entries = []
        for group in alike.values():
            first = model.bodies[group[0]]
            names = self.some([model.bodies[k].name for k in group], 3)
            parents = list(dict.fromkeys(self.name(model.bodies[k].parent) for k in group[:4]))
            on = ", ".join([*parents[:3], *["..."][: len(parents) > 3]])
            entries.append(f"{names}: {self.joint(first)} on {on}; {self.mass(first)}")
        return self.section("body", entries)

    def element(self, e: ForceElement) -> str:
        """The line of a force element on bodies: attachment points, and coefficients by their keys."""
        ends = [self.face(x) if isinstance(x, Face) else self.point(x) for x in e.ends]
        where = f"from {ends[0]} to {', '.join(ends[1:])}" if len(ends) > 1 else f"on {', '.join(ends)}"
        about = f" about {self.axis(e.axis)}" if e.axis else ""
        keyed: dict[str, list[str]] = {}
        for key, value in zip(e.keys, e.coefficients, strict=True):
            stem, listed, _ = key.partition("[")
            keyed.setdefault(stem + listed, []).append(self.long(value))
        if len(keyed) > 1:  # of several lists, lists of zeros are omitted
            keyed = {key: values for key, values in keyed.items() if not key.endswith("[") or set(values) != {"0"}}
        parts = [self._keyed(key, values) for key, values in keyed.items()]
        return f"{e.name}: {where}{about}; {', '.join([*parts, *e.remarks])}"

    @staticmethod
    def _keyed(key: str, values: list[str]) -> str:
        text = f"[{', '.join(values)}]" if key.endswith("[") else values[0]
        return f"{key.rstrip('[').replace('_', ' ')} {text}"

    # -- parts -----------------------------------------------------------------------------------------------------------

    def name(self, body: int) -> str:
        return "ground" if body == GROUND else self.model.bodies[body].name

    def joint(self, body: Body) -> str:
        joint = body.joint
        at = "" if all(_is_zero(x) for x in joint.at) else f" at {self.vector(joint.at)}"
        axes = self.axes(joint.axes[: len(joint.kind.axis_keys)])
        factors = "".join(
            f", {key} {self.short(e)}" for key, e in zip(joint.kind.factor_keys, joint.factors, strict=True)
        )
        return f"{joint.type}{axes}{factors}{self.armature(joint)}{at}{self.turned(joint.rotation)}"

    def armature(self, joint: Joint) -> str:
        if not joint.armature:
            return ""
        values = [self.short(e) for e in joint.armature[: len(joint.kind.armature_units())]]
        return f", armature {values[0] if len(values) == 1 else '[' + ', '.join(values) + ']'}"

    def turned(self, rotation: Iterable[tuple[Vector, Expression]]) -> str:
        turns = [f"{self.short(angle)} about {self.axis(axis)}" for axis, angle in rotation]
        return f" turned {', '.join(turns)}" if turns else ""

    def axes(self, axes: Sequence[Vector]) -> str:
        return f" {' and '.join(self.axis(a) for a in axes)}" if axes else ""

    def axis(self, axis: Vector) -> str:
        text = self.vector(axis)
        return {
            f"[{', '.join(str(sign * (i == j)) for j in range(3))}]": f"{'-' * (sign < 0)}{'xyz'[i]}"
            for i in range(3) for sign in (1, -1)
        }.get(text, text)  # fmt: skip

    def mass(self, body: Body) -> str:
        if _is_zero(body.mass) and all(_is_zero(x) for x in body.inertia):
            return "no mass"
        if len(str(body.mass)) > LONG:
            mass = f"{self.number(body.mass)} kg (of {', '.join(sorted(body.mass.names))})"
        else:
            mass = self.long(body.mass) + ("" if body.mass.is_number else f" = {self.number(body.mass)}") + " kg"
        com = "" if all(_is_zero(x) for x in body.com) else f" at {self.vector(body.com)}"
        inertia = ", ".join(self.number(x) for x in body.inertia)
        return f"mass {mass}{com}, inertia [{inertia}] kg m^2"

    def face(self, face: Face) -> str:
        return f"{self.place(face.body, face.at)}{self.turned(face.rotation)}"

    def point(self, point: Point) -> str:
        return self.place(point.body, point.at)

    def place(self, body: int, at: Vector) -> str:
        return self.name(body) + ("" if all(_is_zero(x) for x in at) else f" {self.vector(at)}")

    def vector(self, vector: Vector) -> str:
        return f"[{', '.join(self.short(x) for x in vector)}]"

    def short(self, expression: Expression) -> str:
        text = self.long(expression)
        return text if len(text) <= LONG else self.number(expression)

    def long(self, expression: Expression) -> str:
        return self.number(expression) if expression.is_number else str(expression)

    def number(self, expression: Expression) -> str:
        """The value at the default parameters, with six digits."""
        return f"{float(expression.evaluate(self.defaults)):.6g}"


def _is_zero(expression: Expression) -> bool:
    return expression.is_number and expression.value == 0


def list_package(folder: Path, verbose: bool = False) -> list[str]:
    """The origin, target and functions of a generated package, and the lines of its model.

    Parameters
    ----------
    verbose : bool
        Whether to list the functions if the package has all of them.

    Raises
    ------
    FolderError
        If the folder contains no package.
    """
    from .folders import FolderError
    from .runtime.standalone.files.manifest import read_manifest

    try:
        manifest = read_manifest(folder)
    except ValueError as error:
        raise FolderError(str(error)) from None
    origin = f" from {manifest['origin']['file']}" if manifest.get("origin") else ""
    lines = [
        f"package {folder.absolute()}, generated{origin} by ordernm {manifest.get('version')}",
        f"  target {manifest.get('target')}, scalar {manifest.get('scalar', 'float64')}, "
        f"layout {manifest.get('layout')}; {_code(folder, manifest)}",
        *_functions(manifest, verbose),
        *manifest.get("description", ()),
    ]
    return lines


def _functions(manifest: Mapping[str, Any], verbose: bool) -> list[str]:
    """Lines about the methods of a package's Solver, and about methods that were not generated."""
    made = list(dict.fromkeys(f.get("member", name) for name, f in manifest["functions"].items()))
    left_out = manifest.get("left_out", ())
    if not left_out and not verbose:
        extra = ", ".join(f"{'with' if name in made else 'without'} {name}" for name in ("reactions", "frames"))
        return [f"  all functions, {extra}"]
    lines = [f"  functions: {', '.join(made)}"]
    return lines + ([f"  generated without: {', '.join(left_out)}"] if left_out else [])


def _code(folder: Path, manifest: Mapping[str, Any]) -> str:
    """A line about the code that runs when the package is loaded on this machine."""
    if manifest.get("target") == "numpy":
        return "NumPy computes"
    from .runtime import CompileError
    from .runtime.standalone.files.build import builds

    try:
        kept = [(build, build.key()) for build in list(builds(folder, manifest).values())[:2]]
    except (CompileError, OSError) as error:
        return f"C cannot be compiled: {error}"
    for build, key in kept:
        for place in build.places:
            for library in sorted(place.glob(f"{key}-*.so")):
                used = instructions([*build.compiler, *build.flags])
                return f"compiled C computes: {library.name}{used and f', {used}'}"
    if build.compiler:
        return f"C computes: {build.compiler[0]} compiles it when it is loaded first"
    return "NumPy computes, since there is no C compiler"
