"""Bodies and the joints that carry them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from .. import checks
from ..errors import nearest
from ..expressions import Expression, ExpressionError
from ..model import GROUND, Body, Joint, Vector, joint_coordinates
from ..positions import Path_
from ..reading import Reader, some
from ..repetition import Instance
from ..schema import ZERO, BodyEntry, JointEntry
from ..shapes import Inertia, mass_properties
from .placement import Bound, expressions_of, rotation, vector

_Parts = tuple[Joint, Expression, Vector, Inertia, bool]


@dataclass(slots=True)
class BodySection:
    """The bodies and what was read of them, in the order of the file.

    Attributes
    ----------
    instances : list of Instance
    specs : list of BodyEntry or None
        None where an entry could not be read.
    names : list of str
    index : dict of str to int
        Where each body stands in `names`.
    frames : dict of str to int
        The same, and the ground.
    bodies : list of Body
        Those that could be read: as long as `names` if nothing is wrong.
    is_tree : bool
        Whether every body leads to the ground.
    is_sound : bool
        Whether joints and mass properties of all bodies are known.
    """

    instances: list[Instance] = field(default_factory=list)
    specs: list[BodyEntry | None] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    index: dict[str, int] = field(default_factory=dict)
    frames: dict[str, int] = field(default_factory=dict)
    bodies: list[Body] = field(default_factory=list)
    is_tree: bool = True
    is_sound: bool = False


def read_bodies(reader: Reader) -> BodySection:
    """Read the bodies; coordinates and speeds of their joints are allowed in expressions of the motion from now on."""
    section = BodySection()
    for at in reader.section("bodies"):
        name = reader.key_name(at, "body", "body")
        spec = reader.spec(BodyEntry, at)
        if name is not None:
            section.instances.append(at)
            section.specs.append(spec)
            section.names.append(name)
    if not section.names and not reader.problems:
        at = reader.top("bodies")
        message = "no bodies; a model has at least one, such as arm: {parent: ground, joint: {type: revolute, axis: y}}"
        reader.report(at, (), message)
    section.index = {n: i for i, n in enumerate(section.names)}
    section.frames = {**section.index, "ground": GROUND}
    _build(reader, section)
    for spec, name in zip(section.specs, section.names, strict=True):
        if spec is not None:
            for prefix, group in zip("qu", joint_coordinates(name, spec.joint.type), strict=True):
                reader.allowed["motion"].update(dict.fromkeys(f"{prefix}.{n}" for n in group))
        if not reader.is_whole(spec):
            reader.broken.add(name)
    return section


def _build(reader: Reader, section: BodySection) -> None:
    """The bodies; those that could not be read are left out, after their report."""
    parts = _PartsReader(reader)
    sound: list[tuple[Instance, Body]] = []
    parents = [GROUND] * len(section.names)
    for i, (at, spec, name) in enumerate(zip(section.instances, section.specs, section.names, strict=True)):
        if spec is None:
            continue
        parent = body_index(reader, spec.parent, at, ("parent",), section.frames)
        if parent == i:
            reader.report(at, ("parent",), f"body {name!r} is its own parent; another body or ground is allowed")
        elif parent is not None:
            parents[i] = parent
        section.is_tree = section.is_tree and parent is not None and parent != i
        joint, mass, com, inertia, is_sound = parts.of(spec, at)
        section.bodies.append(Body(name, parents[i], joint, mass, com, inertia))
        if is_sound:
            sound.append((at, section.bodies[-1]))
    for cycle in checks.cycles(parents):
        section.is_tree = False
        circle = [section.names[i] for i in cycle]
        chain = " -> ".join([*circle, circle[0]]) if len(circle) <= 8 else some(circle)
        message = f"the parents form a circle, {chain}; one of them must lead to ground"
        reader.report(section.instances[cycle[0]], ("parent",), message)
    for found in checks.check_inertia([b for _, b in sound], reader.numeric):
        _report_finding(reader, sound[found[0]][0], found)
    section.is_sound = section.is_tree and len(sound) == len(section.names)


def check_freedoms(reader: Reader, section: BodySection, held: Collection[int] = ()) -> None:
    """Report joints that move no mass; `held` are the bodies that a loop holds, which others may carry."""
    if section.is_sound:
        for found in checks.check_freedoms(section.bodies, reader.numeric, held):
            _report_finding(reader, section.instances[found[0]], found)


def _report_finding(reader: Reader, at: Instance, found: checks.Finding) -> None:
    _, sub, message, severity = found
    if sub[0] not in at.value:
        sub = ("shape",) if "shape" in at.value else ()
    reader.report(at, sub, message, severity=severity)


def body_index(reader: Reader, reference: Expression, at: Instance, sub: Path_, frames: dict[str, int]) -> int | None:
    """The body that a reference means, or None after a problem."""
    name = reader.reference(reference, at, sub)
    if name is None:
        return None
    found = frames.get(name)
    if found is None:
        names = [n for n in frames if n != "ground"]
        hint = nearest(name, frames)
        if at.indices and sub == ("parent",):
            hint = "; for the first repetition write first: {parent: ground}"
        reader.report(at, sub, f"unknown body {name!r}; ground or one of {some(names)} is allowed{hint}")
    return found


class _PartsReader:
    """Joint and mass properties of bodies; the same objects for repetitions that mean the same."""

    def __init__(self, reader: Reader) -> None:
        self.reader = reader
        self._indices: dict[int, list[tuple[Path_, Expression]]] = {}
        self._parts: dict[tuple[Any, ...], _Parts] = {}

    def of(self, spec: BodyEntry, at: Instance) -> _Parts:
        """Joint, mass properties and whether they are sound; the same objects where the indices used are equal."""
        listed = self._indices.get(id(spec))
        if listed is None:
            listed = self._indices[id(spec)] = list(expressions_of(spec))
        used = set().union(*(e.names for _, e in listed)) if at.indices else set()
        key = (id(spec), *((i, v) for i, v in at.indices.items() if i in used))
        found = self._parts.get(key)
        if found is None:
            found = self._parts[key] = _body_parts(self.reader, spec, at, listed)
        return found


def _body_parts(reader: Reader, spec: BodyEntry, at: Instance, listed: list[tuple[Path_, Expression]]) -> _Parts:
    before = len(reader.problems)
    result = {sub: reader.bound(e, at, sub, "parameters") for sub, e in listed}
    sound = len(reader.problems) == before and reader.is_whole(
        spec
    )  # names and values; the joint is checked for itself

    joint = _joint(reader, spec.joint, at, result)
    if spec.mass is not None or spec.shape is None:
        com = vector(result, "com") if spec.com is not None else (ZERO, ZERO, ZERO)
        keys = ("xx", "yy", "zz", "xy", "xz", "yz")
        inertia: Any = tuple(result.get(("inertia", k), ZERO) for k in keys)
        return joint, result.get(("mass",), ZERO), com, inertia, sound
    for what in ("length", "radius"):
        if ("shape", what) in result:
            _check_size(reader, result["shape", what], at, ("shape", what))
    for i in range(3):
        if ("shape", "size", i) in result:
            _check_size(reader, result["shape", "size", i], at, ("shape", "size", i))
    if ("shape", "axis", 0) in result and all(reader.numeric(e) == 0 for e in vector(result, "shape", "axis")):
        reader.report(at, ("shape", "axis"), "the axis is zero; a direction is needed: x, y, z or [x, y, z]")
    sound = sound and len(reader.problems) == before
    nothing: _Parts = (joint, ZERO, (ZERO, ZERO, ZERO), (ZERO,) * 6, False)
    if not sound:
        return nothing
    try:
        mass, _, inertia6 = mass_properties(spec.shape)
        bound = [reader.binder(e, at.indices) for e in (mass, *inertia6)]
    except ExpressionError as error:
        reader.report(at, ("shape",), error.message)
        return nothing
    for e in bound:
        if isinstance(why := reader.value(e), str):
            reader.report(at, ("shape",), f"no finite mass properties at the default parameters: {why}")
            return nothing
    six: Any = tuple(bound[1:])
    return joint, bound[0], vector(result, "shape", "center"), six, True


def _check_size(reader: Reader, size: Expression, at: Instance, sub: Path_) -> None:
    if reader.numeric(size) < 0:
        seen = checks.with_value(size, reader.numeric(size))
        reader.report(at, sub, f"{seen} is negative; a size is at least 0")


def _joint(reader: Reader, spec: JointEntry, at: Instance, bound: Bound) -> Joint:
    axes: list[Vector] = []
    if hasattr(spec, "axis"):
        axes = [vector(bound, "joint", "axis")]
    elif hasattr(spec, "axes"):
        axes = [vector(bound, "joint", "axes", i) for i in range(2)]
    for i, axis in enumerate(axes):
        sub = ("joint", "axis") if hasattr(spec, "axis") else ("joint", "axes", i)
        reader.direction(axis, at, sub)
    if len(axes) == 2:
        a, b = ([reader.numeric(e) for e in axis] for axis in axes)
        product = sum(x * y for x, y in zip(a, b, strict=True))
        lengths = (sum(x * x for x in a) * sum(x * x for x in b)) ** 0.5
        if abs(product) > 1e-9 * lengths:
            cosine = product / lengths
            message = f"the two axes have cosine {cosine:.3g}; those of a universal joint are perpendicular (to 1e-9)"
            reader.report(at, ("joint", "axes"), message)
    turns = rotation(reader, spec, at, ("joint",), bound)
    return Joint(spec.type, tuple(axes), vector(bound, "joint", "at"), turns)  # type: ignore[attr-defined]
