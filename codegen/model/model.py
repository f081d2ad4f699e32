"""The model: what a file or the builder describes, checked and ready for the engines and the generator.

Every quantity that a model may give as an expression is an `Expression`; nothing is evaluated here, so one
model serves floats, mpmath numbers and symbols alike. Repeated structure is shared: bodies made by the same
lines of a ``repeat`` hold the same `Expression` objects, and the generator recognises them by identity.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

from .axes import Vector, coordinate_axis, least_along
from .errors import Problem
from .expressions import Expression
from .forces import ForceElement, JointForce
from .forces.torsion import Torsion
from .members import (
    CLOSURE_ROWS,
    COUPLING,
    Body,
    Coupling,
    Joint,
    Kind,
    Loop,
    Parameter,
    PointCondition,
    Prescribed,
    Term,
    closure_row_names,
    coupling,
    joint_coordinates,
    outward,
)
from .outputs import MEASURES, Output
from .places import GROUND, Face, Point
from .rates import rate, rates_of
from .straight import signed_length
from .switches import Switches

__all__ = [
    "CLOSURE_ROWS",
    "COUPLING",
    "GROUND",
    "LOOP_TOLERANCE",
    "Body",
    "Coupling",
    "Face",
    "Joint",
    "JointForce",
    "Kind",
    "Loop",
    "Model",
    "Output",
    "Parameter",
    "Point",
    "PointCondition",
    "Prescribed",
    "Term",
    "Vector",
    "closure_row_names",
    "coordinate_axis",
    "coupling",
    "joint_coordinates",
    "least_along",
]

LOOP_TOLERANCE = 1e-4
"""Of models that give none. Angles of five significant digits, such as 1.5708 for pi/2 or 3.1416 for pi, are off by 4e-6 to
1e-5 rad, and a few of them add up; a closure matrix half a degree from a dead point has singular values of 1e-2."""


@dataclass(frozen=True, eq=False)
class Model:
    """A checked multibody model. Made by `codegen.load_model` or `codegen.ModelBuilder`, never by hand.

    Attributes
    ----------
    gravity : Vector or None
        m/s^2 in the ground frame.
    bodies : tuple of Body
        In file order after ``repeat``; arrays q and u follow it.
    initial_q, initial_u : dict of str to Expression
        Initial values by coordinate and speed name (missing: 0, unit quaternion); guesses where loops decide.
    initial_at_rest : bool
        Whether the model begins in the equilibrium that the initial coordinates lead to.
    independent : tuple of str
        Coordinates that the model asks to be independent: a hint, may be fewer than the freedoms.
    forces : tuple of JointForce
    loads : tuple of ForceElement
        What acts on bodies; both in the order of the file.
    motion : dict of str to Expression
        Coordinates that are prescribed, by name, as functions of t, parameters and inputs.
    loop_tolerance : float
        Conditions of loops that follow from others but for this part of them are taken to follow.
    warnings : tuple of str
    file : str
        Where the model was read, for messages: ``<string>`` and ``builder`` too.
    places : dict of str to dict of str to (str, int, int)
        File, line and column of entries by section and name.
    files : tuple of str
        The other files that it was read from: included ones and those of submodels.
    digest : str
        SHA-256 of the texts of all its files as they were read; ``""`` for a model of the builder.
    points : tuple of Point
        Those that have a name, in the order of the file.
    """

    name: str
    gravity: Vector | None
    parameters: tuple[Parameter, ...]
    inputs: tuple[str, ...]
    bodies: tuple[Body, ...]
    loops: tuple[Loop, ...] = ()
    forces: tuple[JointForce, ...] = ()
    loads: tuple[ForceElement, ...] = ()
    outputs: tuple[Output, ...] = ()
    motion: dict[str, Expression] = field(default_factory=dict)
    initial_q: dict[str, Expression] = field(default_factory=dict)
    initial_u: dict[str, Expression] = field(default_factory=dict)
    initial_at_rest: bool = False
    independent: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    loop_tolerance: float = LOOP_TOLERANCE
    file: str = "builder"
    places: dict[str, dict[str, tuple[str, int | None, int | None]]] = field(default_factory=dict, repr=False)
    files: tuple[str, ...] = ()
    digest: str = field(default="", repr=False, compare=False)
    points: tuple[Point, ...] = ()

    def __post_init__(self) -> None:
        known = set(self.inputs)
        read = frozenset[str]().union(*(e.names for e in self.motion.values()))
        more = [
            x for n in self.inputs if n in read and n not in self._rates(known) for x in rates_of(n) if x not in known
        ]
        if more:
            object.__setattr__(self, "inputs", (*self.inputs, *more))

    @staticmethod
    def _rates(inputs: Collection[str]) -> set[str]:
        """Those of some inputs that are time derivatives of others."""
        return {x for n in inputs for x in rates_of(n) if x in inputs}

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """The inputs that the file names: the first of `inputs`, without the time derivatives that follow from them."""
        rates = self._rates(set(self.inputs))
        return tuple(n for n in self.inputs if n not in rates)

    @cached_property
    def moving_inputs(self) -> tuple[str, ...]:
        """The signals that prescribed motion reads, in the order in which their time derivatives follow the signals."""
        known = set(self.inputs)
        return tuple(n for n in self.inputs if rates_of(n)[0] in known)

    def problem(self, path: str, message: str) -> Problem:
        """A problem found after loading, such as a force without a value, at the entry that a path leads to."""
        section, _, rest = path.partition(".")
        file, line, column = self.places.get(section, {}).get(rest.partition(".")[0], (self.file, None, None))
        return Problem(file, line, column, path, message)

    def __repr__(self) -> str:
        return (
            f"<Model {self.name}: {len(self.bodies)} bodies, {len(self.loops)} loops, nq={self.nq}, nu={self.nu}, "
            f"np={len(self.parameters)}, ninputs={len(self.inputs)}, noutputs={len(self.outputs)}>"
        )

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Those of q: of all joints, but for what is prescribed."""
        every = (q for b in self.bodies for q in joint_coordinates(b.name, b.joint.type)[0])
        return tuple(q for q in every if q not in self.motion)

    @cached_property
    def speed_names(self) -> tuple[str, ...]:
        every = (u for b in self.bodies for u in joint_coordinates(b.name, b.joint.type)[1])
        return tuple(u for u in every if u not in self.motion)

    @cached_property
    def prescribed(self) -> tuple[Prescribed, ...]:
        """What is prescribed, body by body."""
        found = []
        for k, b in enumerate(self.bodies) if self.motion else ():
            for i, name in enumerate(joint_coordinates(b.name, b.joint.type)[0]):
                if name in self.motion:
                    value = self.motion[name]
                    moving = frozenset(self.moving_inputs)
                    first = rate(value, moving=moving)
                    found.append(Prescribed(name, k, i, (value, first, rate(first, moving=moving))))
        return tuple(found)

    @property
    def prescribed_names(self) -> tuple[str, ...]:
        """Coordinates that are prescribed, in array order."""
        return tuple(x.name for x in self.prescribed)

    @cached_property
    def places_of_prescribed(self) -> dict[tuple[int, int], int]:
        """The number of what is prescribed, by body and coordinate of its joint."""
        return {(x.body, x.index): n for n, x in enumerate(self.prescribed)}

    @cached_property
    def released(self) -> Model:
        """The model with nothing prescribed: what was is among q and u, wanted as independent, and begins as at t = 0."""
        if not self.motion:
            return self
        start = self.defaults | dict.fromkeys(self.inputs, 0.0) | {"t": 0.0}
        known = [Expression.number(float(x.values[i].evaluate(start))) for i in (0, 1) for x in self.prescribed]
        n, names = len(self.prescribed), self.prescribed_names
        return replace(
            self,
            motion={},
            initial_q=self.initial_q | dict(zip(names, known[:n], strict=True)),
            initial_u=self.initial_u | dict(zip(names, known[n:], strict=True)),
            independent=(*self.independent, *names) if self.loops else self.independent,
        )

    def with_turned(self, loops: Collection[int]) -> Model:
        """The model with ``from`` and ``to`` of some loops exchanged, whose conditions are along the axes of ``to`` then.

        Of joints that hold all three directions of the way between the faces, so that it is the same joint.
        """
        if not loops:
            return self
        turned = [
            replace(x, axes=x.axes[::-1], start=x.end, end=x.start, turned=True) if i in loops and not x.turned else x
            for i, x in enumerate(self.loops)
        ]
        return replace(self, loops=type(self.loops)(turned))

    @cached_property
    def coordinate_units(self) -> tuple[str, ...]:
        """Empty for the entries of quaternions."""
        return self._free("coordinate_units")

    @cached_property
    def speed_units(self) -> tuple[str, ...]:
        return self._free("speed_units")

    def _free(self, units: str) -> tuple[str, ...]:
        """Of what is not prescribed."""
        held = self.places_of_prescribed
        every = enumerate(getattr(b.joint.kind, units) for b in self.bodies)
        return tuple(unit for k, of in every for i, unit in enumerate(of) if (k, i) not in held)

    @cached_property
    def output_units(self) -> tuple[str, ...]:
        """Empty for what has none, and for expressions."""
        return tuple(MEASURES[o.measure].unit_of(o) for o in self.outputs)

    @cached_property
    def closure_names(self) -> tuple[str, ...]:
        """The conditions of all loops, in the order of residuals."""
        return tuple(name for loop in self.loops for name in closure_row_names(loop))

    @property
    def elements(self) -> tuple[ForceElement, ...]:
        """All that exerts forces: on joints, then on bodies."""
        return (*self.forces, *self.loads)

    @cached_property
    def switches(self) -> Switches:
        """Where prescribed motion, forces and outputs change their branches."""
        found = Switches(self.inputs)
        for x in self.prescribed:
            found.add(x.value.tree, f"motion.{x.name}", moves=True)
        for force in self.elements:
            keys = force.keys or ("value",) * len(force.coefficients)
            for key, e in zip(keys, force.coefficients, strict=True):
                found.add(e.tree, f"forces.{force.name}.{key}")
            if isinstance(force, Torsion):
                found.add_turn(force.name)
            elif not self.loops and (line := signed_length(self.bodies, self.motion, force)) is not None:
                found.add_line(force.name, *line)
        for i, output in enumerate(self.outputs):
            if output.expression is not None:
                found.add(output.expression.tree, f"outputs.{output.name}.value", i)
        return found

    @cached_property
    def defaults(self) -> dict[str, float]:
        """Values of the parameters by name."""
        return {p.name: p.value for p in self.parameters}

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @cached_property
    def initial_depends_on_parameters(self) -> bool:
        """Whether initial values change with parameters, and so have derivatives."""
        given = (*self.initial_q.values(), *self.initial_u.values())
        return any(e.names & set(self.parameter_names) for e in given)

    @property
    def points_depend_on_parameters(self) -> bool:
        """Whether a point with a name lies in its body where parameters say."""
        return any(e.names for point in self.points for e in point.at)

    @property
    def nq(self) -> int:
        return len(self.coordinate_names)

    @property
    def nu(self) -> int:
        return len(self.speed_names)

    @cached_property
    def coordinate_slices(self) -> tuple[tuple[slice, slice], ...]:
        """For each body, where its joint's coordinates stand in q and its speeds in u."""
        result, i, j = [], 0, 0
        for b in self.bodies:
            q, u = (sum(n not in self.motion for n in of) for of in joint_coordinates(b.name, b.joint.type))
            result.append((slice(i, i + q), slice(j, j + u)))
            i, j = i + q, j + u
        return tuple(result)

    @cached_property
    def quaternions(self) -> tuple[tuple[int, slice], ...]:
        """The bodies whose joints have a quaternion, and where that stands in q."""
        return tuple(
            (k, slice(q.start + place.start, q.start + place.stop))
            for k, (b, (q, _)) in enumerate(zip(self.bodies, self.coordinate_slices, strict=True))
            for place in b.joint.kind.quaternions
        )

    @cached_property
    def outward(self) -> tuple[int, ...]:
        """Body indices, every parent before its children, each subtree contiguous (depth first)."""
        return tuple(outward(self.bodies)[1])

    def expressions(self) -> Iterator[Expression]:
        """Every expression of the model, shared ones as often as they are used."""
        gravity = self.gravity or ()
        return _expressions_in((*gravity, *self.bodies, *self.loops, *self.elements, *self.outputs, *self.prescribed))


def _expressions_in(part: Any) -> Iterator[Expression]:
    """The expressions of a part of a model, in the order of its attributes."""
    if isinstance(part, Expression):
        yield part
    elif isinstance(part, tuple):
        for inner in part:
            yield from _expressions_in(inner)
    elif is_dataclass(part):
        for attribute in fields(part):
            yield from _expressions_in(getattr(part, attribute.name))
