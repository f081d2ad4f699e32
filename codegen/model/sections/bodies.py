"""Reads bodies and their joints."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from .. import checks
from ..entries import ZERO
from ..errors import count_of_values, nearest
from ..expressions import Expression
from ..grammar import ExpressionError
from ..model import GROUND, Body, Joint, Vector, joint_coordinates
from ..parts import Instance
from ..positions import Path_
from ..problems import TooManyProblems
from ..reading import Reader
from ..repetition import CannotGoOn, name_of
from ..schema import BodyEntry, BodyJoint
from ..shapes import Inertia, mass_properties
from ..unknown_names import some
from ..visuals import Visual
from .digits import check_axis
from .placement import Bound, bound_entry, expressions_of, rotation, vector
from .visuals import check_sizes, read_visuals

MAX_BODIES: Final = 200_000
LARGE, FEW_WRONG = 5000, 100
"""A model of more than `LARGE` bodies is rejected before its numbers are read if at most `FEW_WRONG` of its parents are wrong."""

MAX_DIFFERENT: Final = 40_000
"""Largest number of repeated bodies with different numbers; repeated bodies with equal numbers are read once."""

_Parts = tuple[Joint, Expression, Vector, Inertia, tuple[Visual, ...] | None, bool]
_Listed = list[tuple[Path_, Expression]]


@dataclass(slots=True)
class BodySection:
    """The bodies and their entries, in the order of the file.

    Attributes
    ----------
    instances : list of Instance
    specs : list of BodyEntry or None
        None for an entry with errors.
    names : list of str
    index : dict of str to int
        Index of each body in `names`.
    frames : dict of str to int
        Index of each body, and of the ground.
    bodies : list of Body
        The bodies without errors; without any error, as many as `names`.
    is_tree : bool
        Whether every body leads to the ground.
    is_sound : bool
        Whether the joints and mass properties of all bodies are known.
    rigid_parts : list of int, optional
        See `checks.rigid_parts`; computed when first needed.
    """

    instances: list[Instance] = field(default_factory=list)
    specs: list[BodyEntry | None] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    index: dict[str, int] = field(default_factory=dict)
    frames: dict[str, int] = field(default_factory=dict)
    bodies: list[Body] = field(default_factory=list)
    is_tree: bool = True
    is_sound: bool = False
    rigid_parts: list[int] | None = None


def read_bodies(reader: Reader) -> BodySection:
    """Read the bodies. Expressions of the scope ``motion`` that are read later may contain coordinates and speeds of
    their joints."""
    section = BodySection()
    for at in _entries(reader):
        if len(section.names) == MAX_BODIES:
            reader.report(at, (), f"more than {MAX_BODIES} bodies; reading them would take too long: use fewer")
            raise CannotGoOn
        name = reader.key_name(at, "body", "body")
        spec = reader.spec(BodyEntry, at)
        if name is not None:
            section.instances.append(at)
            section.specs.append(spec)
            section.names.append(name)
    if not section.names and not any(p.severity == "error" for p in reader.problems):
        at = reader.top("bodies")
        message = "there are no bodies; give at least one: arm: {parent: ground, joint: {type: revolute, axis: y}}"
        reader.report(at, (), message)
    section.index = {n: i for i, n in enumerate(section.names)}
    section.frames = {**section.index, "ground": GROUND}
    _build(reader, section)
    of_motion, allowed = reader.units_of_motion, reader.allowed["motion"]
    for spec, name in zip(section.specs, section.names, strict=True):
        if spec is not None:
            groups = joint_coordinates(name, spec.joint.type)
            all_units = (spec.joint.coordinate_units, spec.joint.speed_units)
            for prefix, group, units in zip("qu", groups, all_units, strict=True):
                of_motion[prefix, name] = units
                for n, unit in zip(group, units, strict=True):
                    of_motion[prefix, n] = (unit,)
                    allowed[f"{prefix}.{n}"] = None
        if not reader.is_whole(spec):
            reader.broken.add(name)
    return section


def _entries(reader: Reader) -> Iterator[Instance]:
    """The bodies of all files; the bodies of a submodel follow the body that replaces its ground."""
    for part in reader.parts:
        if part.frame is not None:
            yield part.frame
        yield from reader.section("bodies", [part])


def _build(reader: Reader, section: BodySection) -> None:
    """Make the bodies; bodies with errors are reported and left out."""
    if len(section.names) > LARGE:
        _refuse_few_wrong_parents(reader, section)
    parts = _PartsReader(reader)
    sound: list[tuple[Instance, Body]] = []
    tolerated: list[int] = []
    parents = [GROUND] * len(section.names)
    for i, (at, spec, name) in enumerate(zip(section.instances, section.specs, section.names, strict=True)):
        if spec is None:
            continue
        parent = body_index(reader, spec.parent, at, ("parent",), section.frames)
        if parent == i:
            reader.report(at, ("parent",), f"body {name!r} is its own parent; give another body or ground")
        elif parent is not None:
            parents[i] = parent
        section.is_tree = section.is_tree and parent is not None and parent != i
        joint, mass, com, inertia, visuals, is_sound = parts.of(spec, at)
        section.bodies.append(Body(name, parents[i], joint, mass, com, inertia, visuals))
        if is_sound:
            if spec.inertia is not None and spec.inertia.check == "warn":
                tolerated.append(len(sound))
            sound.append((at, section.bodies[-1]))
    for cycle in checks.cycles(parents):
        section.is_tree = False
        circle = [section.names[i] for i in cycle]
        chain = " -> ".join([*circle, circle[0]]) if len(circle) <= 8 else some(circle)
        message = f"the parents form a circle, {chain}; one of them must lead to ground"
        reader.report(section.instances[cycle[0]], ("parent",), message)
    section.is_sound = section.is_tree and len(sound) == len(section.names)
    for found in checks.check_inertia([b for _, b in sound], reader.numeric, tolerated, section.is_sound):
        _report_finding(reader, sound[found[0]][0], found)


def _refuse_few_wrong_parents(reader: Reader, section: BodySection) -> None:
    """Reject a large model with a few wrong parents at once, because reading all of its numbers would take longest.

    Errors in many repetitions end the reading in any case.

    Raises
    ------
    CannotGoOn
    """
    wrong = []
    for at, spec in zip(section.instances, section.specs, strict=True):
        if spec is not None:
            try:
                known = at.part.referred(name_of(spec.parent.tree, reader.numbers(at))) in section.frames
            except ExpressionError:
                known = False
            if not known:
                wrong.append((spec, at))
                if len(wrong) > FEW_WRONG:
                    return
    for spec, at in wrong:
        body_index(reader, spec.parent, at, ("parent",), section.frames)
    if wrong:
        raise CannotGoOn


def check_freedoms(
    reader: Reader, section: BodySection, held: Collection[int] = (), prescribed: Collection[str] = ()
) -> None:
    """Report joints that move no mass. `held` are bodies connected to others by loops.

    `prescribed` coordinates need no mass.
    """
    if section.is_sound:
        driven: dict[int, list[int]] = {}
        for k, body in enumerate(section.bodies) if prescribed else ():
            names = joint_coordinates(body.name, body.joint.type)[0]
            if of := [i for i, name in enumerate(names) if name in prescribed]:
                driven[k] = of
        for found in checks.check_freedoms(section.bodies, reader.numeric, held, driven):
            _report_finding(reader, section.instances[found[0]], found)


def _report_finding(reader: Reader, at: Instance, found: checks.Finding) -> None:
    _, sub, message, severity = found
    if sub[0] not in at.value:
        sub = ("shape",) if "shape" in at.value else ()
    reader.report(at, sub, message, severity=severity)


def body_index(reader: Reader, reference: Expression, at: Instance, sub: Path_, frames: dict[str, int]) -> int | None:
    """Index of the body that a reference names; None after an error."""
    name = reader.reference(reference, at, sub)
    if name is None:
        return None
    found = frames.get(name)
    if found is None:

        def message() -> str:
            hint = nearest(name, frames)
            if at.indices and sub == ("parent",) and at.section == ("bodies",):
                hint = "; for the first repetition write first: {parent: ground}"
            return (
                f"unknown body {name!r}; ground or one of {some(n for n in frames if n != 'ground')} is allowed{hint}"
            )

        reader.report(at, sub, message)
    return found


class _PartsReader:
    """Joint and mass properties of bodies; equal repetitions share the same objects."""

    def __init__(self, reader: Reader) -> None:
        self.reader = reader
        self._plans: dict[tuple[int, int], tuple[dict[Path_, Expression], _Listed, bool]] = {}
        self._parts: dict[tuple[Any, ...], _Parts] = {}

    def of(self, spec: BodyEntry, at: Instance) -> _Parts:
        """Joint and mass properties of a body, and whether they are valid; bodies with equal expressions share the objects."""
        reader = self.reader
        before = reader.errors
        plan = self._plans.get((id(spec), id(at.part)))
        if plan is None:
            listed = list(expressions_of(spec))
            fixed = {}
            if not at.part.is_submodel:  # the numbers of submodels may differ from use to use
                fixed = {
                    s: reader.bound(e, at, s, "parameters") for s, e in listed if at.indices.keys().isdisjoint(e.names)
                }
            plan = fixed, [(s, e) for s, e in listed if s not in fixed], reader.errors == before
            self._plans[id(spec), id(at.part)] = plan
        fixed, varying, sound = plan
        before = reader.errors
        bound = {sub: reader.bound(e, at, sub, "parameters") for sub, e in varying}
        sound = sound and reader.errors == before and reader.is_whole(spec)
        key = id(spec), sound, *bound.values()
        found = self._parts.get(key)
        if found is None:
            if at.indices and len(self._parts) > MAX_DIFFERENT:
                message = (
                    f"more than {MAX_DIFFERENT} repeated bodies with different numbers; reading them would take too long: use "
                    f"fewer repetitions, or the same numbers in several of them"
                )
                reader.report(at, (), message, key=True)
                raise TooManyProblems
            found = self._parts[key] = _body_parts(reader, spec, at, {**fixed, **bound}, sound)
        return found


def _body_parts(reader: Reader, spec: BodyEntry, at: Instance, result: Bound, sound: bool) -> _Parts:
    """Joint and mass properties; `sound` is False if names or values have errors. The joint is checked separately."""
    before = reader.errors
    joint = _joint(reader, spec.joint, at, result, sound)
    visuals = read_visuals(reader, spec, at, result) if sound else None
    sound = sound and reader.errors == before
    if spec.mass is not None or spec.shape is None:
        com = vector(result, "com") if spec.com is not None else (ZERO, ZERO, ZERO)
        keys = ("xx", "yy", "zz", "xy", "xz", "yz")
        six: Any = tuple(result.get(("inertia", k), ZERO) for k in keys)
        return joint, result.get(("mass",), ZERO), com, six, visuals, sound
    check_sizes(reader, spec.shape.type, at, ("shape",), result)
    if ("shape", "axis", 0) in result:
        reader.direction(vector(result, "shape", "axis"), at, ("shape", "axis"))
    sound = sound and reader.errors == before
    nothing: _Parts = (joint, ZERO, (ZERO, ZERO, ZERO), (ZERO,) * 6, None, False)
    if not sound:
        return nothing
    try:
        mass, center, inertia = mass_properties(bound_entry(spec.shape, result, ("shape",)))
    except ExpressionError as error:
        reader.report(at, ("shape",), error.message)
        return nothing
    for e in (mass, *inertia):
        if isinstance(why := reader.value(e), str):
            reader.report(at, ("shape",), f"no finite mass properties at the default parameters: {why}")
            return nothing
    return joint, mass, center, inertia, visuals, True


def _joint(reader: Reader, spec: BodyJoint, at: Instance, bound: Bound, sound: bool) -> Joint:
    axes = tuple(vector(bound, "joint", *key) for key in spec.axis_keys)
    if sound:
        for axis, key in zip(axes, spec.axis_keys, strict=True):
            reader.direction(axis, at, ("joint", *key))
            check_axis(reader, axis, at, ("joint", *key))
        wrong = spec.wrong_axes([[reader.numeric(e) for e in axis] for axis in axes])
        if wrong is not None:
            reader.report(at, ("joint", wrong[0]), wrong[1])
        axes = spec.axes_of_motion(axes, reader.defaults)
    turns = rotation(reader, spec, at, ("joint",), bound)
    factors = tuple(bound["joint", key] for key in spec.factor_keys)
    armature = _armature(reader, spec, at, bound, sound)
    return Joint(spec.name, axes, vector(bound, "joint", "at"), turns, factors, armature)


def _armature(reader: Reader, spec: BodyJoint, at: Instance, bound: Bound, sound: bool) -> tuple[Expression, ...]:
    """Reflected inertia of rotors, one for each speed of the joint; empty if all are the number 0."""
    if spec.armature is None:
        return ()
    given = tuple(bound["joint", "armature", i] for i in range(len(spec.armature)))
    wanted = spec.armature_units()
    if not wanted:
        message = (
            f"a {spec.name} joint has no motor, so armature is not allowed; leave it out, or add it to the mass and inertia of "
            f"the body"
        )
        reader.report(at, ("joint", "armature"), message)
        return ()
    if len(given) != len(wanted):
        each = ", ".join(f"{motion} ({unit})" for motion, unit in wanted)
        needed = f"{len(wanted)} are needed, for {each}; 0 where there is no rotor"
        if len(wanted) == 1:
            needed = f"one is needed, for {each}" + (", the same about every axis" if len(spec.speed_units) > 1 else "")
        reader.report(at, ("joint", "armature"), f"{count_of_values(len(given))} for a {spec.name} joint; {needed}")
        return ()
    for i, e in enumerate(given if sound else ()):
        if reader.numeric(e) < 0:
            seen = checks.with_value(e, reader.numeric(e))
            message = (
                f"{seen} is negative; the reflected inertia of a rotor is its inertia times the square of the gear ratio, "
                f"at least 0 {wanted[i][1]}"
            )
            reader.report(at, ("joint", "armature", i) if len(given) > 1 else ("joint", "armature"), message)
    if all(e.tree == ("number", 0) for e in given):
        return ()
    return given * (len(spec.speed_units) // len(given))
