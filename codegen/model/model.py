"""The model described by a file or by the builder, checked and ready for the engines and the generator.

Every quantity that a model may give as an expression is an `Expression`. Nothing is evaluated here, so one model serves
for floats, mpmath numbers and symbols. Repeated structure is shared: bodies made by the same lines of a ``repeat`` hold
the same `Expression` objects, and the generator recognises them by identity.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

from ..html_tables import html_of
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
from .outputs import MEASURES, Distance, Output
from .places import GROUND, Face, Point
from .rates import rate, rates_of
from .straight import signed_length
from .switches import Switches
from .visuals import Visual

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
"""Default of `Model.loop_tolerance`. Angles with five significant digits, such as 1.5708 for pi/2 or 3.1416 for pi, have
errors of 4e-6 to 1e-5 rad, and a few of them add up. A closure matrix half a degree from a singular pose has singular values
of 1e-2."""


@dataclass(frozen=True, eq=False)
class Model:
    """A checked multibody model.

    `codegen.load_model`, `codegen.parse_model` and `codegen.ModelBuilder` make models.

    Attributes
    ----------
    gravity : Vector or None
        Gravity in the ground frame, m/s^2.
    bodies : tuple of Body
        Bodies in the order of the file after ``repeat``. Arrays q and u follow it.
    initial_q, initial_u : dict of str to Expression
        Initial values by coordinate and speed name. Missing ones are 0, or the unit quaternion; dependent ones are
        guesses.
    initial_at_rest : bool
        Whether the model begins in the equilibrium that the initial coordinates lead to.
    independent : tuple of str
        Coordinates that the model asks to be independent; possibly fewer than its degrees of freedom.
    forces : tuple of JointForce
        Forces in joints, in the order of the file.
    loads : tuple of ForceElement
        Forces on bodies, in the order of the file.
    motion : dict of str to Expression
        Prescribed coordinates by name, as functions of t, parameters and inputs.
    loop_tolerance : float
        Relative tolerance within which conditions of loops count as redundant.
    warnings : tuple of str
        Doubtful entries.
    file : str
        File of the model, for messages; ``<string>`` for a text, ``builder`` for a builder.
    places : dict of str to dict of str to (str, int, int)
        File, line and column of entries by section and name.
    files : tuple of str
        Other files of the model: included files and submodels.
    digest : str
        SHA-256 of the texts of all its files; ``""`` for a model of the builder.
    points : tuple of Point
        Named points, in the order of the file.
    visuals : tuple of Visual
        Solids and meshes on the ground that views show.
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
    visuals: tuple[Visual, ...] = ()

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
        """The inputs that are time derivatives of other inputs."""
        return {x for n in inputs for x in rates_of(n) if x in inputs}

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """Inputs that the file declares: the first entries of `inputs`, before their time derivatives."""
        rates = self._rates(set(self.inputs))
        return tuple(n for n in self.inputs if n not in rates)

    @cached_property
    def moving_inputs(self) -> tuple[str, ...]:
        """Inputs that prescribed motion reads, in the order of their time derivatives."""
        known = set(self.inputs)
        return tuple(n for n in self.inputs if rates_of(n)[0] in known)

    def problem(self, path: str, message: str) -> Problem:
        """Return a problem that was found after loading, with the place of its entry.

        Parameters
        ----------
        path : str
            Keys that lead to the entry, such as ``forces.spring``.
        message : str
            What is wrong.

        Returns
        -------
        Problem
            The problem with file, line and column.

        Examples
        --------
        >>> import ordernm
        >>> model = ordernm.load_model("examples/pendulum.yaml")
        >>> model.problem("gravity", "is too large").message
        'is too large'
        """
        section, _, rest = path.partition(".")
        file, line, column = self.places.get(section, {}).get(rest.partition(".")[0], (self.file, None, None))
        return Problem(file, line, column, path, message)

    def __repr__(self) -> str:
        return (
            f"<Model {self.name}: {len(self.bodies)} bodies, {len(self.loops)} loops, nq={self.nq}, nu={self.nu}, "
            f"np={len(self.parameters)}, ninputs={len(self.inputs)}, noutputs={len(self.outputs)}>"
        )

    def _repr_html_(self) -> str:
        names = ["ground", *(b.name for b in self.bodies)]
        rows = ((b.name, names[b.parent + 1], b.joint.type) for b in self.bodies)
        return html_of([repr(self), *self.warnings], ("body", "parent", "joint"), rows)

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates q of all joints, without prescribed ones."""
        every = (q for b in self.bodies for q in joint_coordinates(b.name, b.joint.type)[0])
        return tuple(q for q in every if q not in self.motion)

    @cached_property
    def speed_names(self) -> tuple[str, ...]:
        """Names of the speeds u of all joints, without prescribed ones."""
        every = (u for b in self.bodies for u in joint_coordinates(b.name, b.joint.type)[1])
        return tuple(u for u in every if u not in self.motion)

    @cached_property
    def prescribed(self) -> tuple[Prescribed, ...]:
        """Prescribed coordinates, body by body."""
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
        """Names of the prescribed coordinates, in array order."""
        return tuple(x.name for x in self.prescribed)

    @cached_property
    def places_of_prescribed(self) -> dict[tuple[int, int], int]:
        """Index of each prescribed coordinate, by body and coordinate of its joint."""
        return {(x.body, x.index): n for n, x in enumerate(self.prescribed)}

    @cached_property
    def released(self) -> Model:
        """The model with nothing prescribed.

        Prescribed coordinates become coordinates that are requested as independent, and begin with their values at t =
        0.
        """
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
        """Return the model with ``from`` and ``to`` of some loops exchanged.

        Their conditions are then along the axes of ``to``. Only a joint with three linear conditions remains the same
        joint; other joints then constrain the motion differently.

        Parameters
        ----------
        loops : collection of int
            Indices of the loops.

        Returns
        -------
        Model
            The other model.

        Examples
        --------
        >>> import ordernm
        >>> model = ordernm.load_model("examples/four_bar.yaml")
        >>> model.with_turned([0]).loops[0].turned
        True
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
        """Units of the coordinates; empty for the entries of quaternions."""
        return self._free("coordinate_units")

    @cached_property
    def speed_units(self) -> tuple[str, ...]:
        """Units of the speeds."""
        return self._free("speed_units")

    def _free(self, units: str) -> tuple[str, ...]:
        """Units of the coordinates, or of the speeds, that are not prescribed."""
        held = self.places_of_prescribed
        every = enumerate(getattr(b.joint.kind, units) for b in self.bodies)
        return tuple(unit for k, of in every for i, unit in enumerate(of) if (k, i) not in held)

    @cached_property
    def output_units(self) -> tuple[str, ...]:
        """Units of the outputs; empty for expressions and for numbers without unit."""
        return tuple(MEASURES[o.measure].unit_of(o) for o in self.outputs)

    @cached_property
    def closure_names(self) -> tuple[str, ...]:
        """Names of the conditions of all loops, in the order of the residuals."""
        return tuple(name for loop in self.loops for name in closure_row_names(loop))

    @property
    def elements(self) -> tuple[ForceElement, ...]:
        """All force elements: first forces on joints, then forces on bodies."""
        return (*self.forces, *self.loads)

    @cached_property
    def switches(self) -> Switches:
        """Expressions at whose zeros prescribed motion, forces and outputs change their branches."""
        found = Switches(self.inputs)
        for x in self.prescribed:
            found.add(x.value.tree, f"motion.{x.name}", moves=True)
        for force in self.elements:
            keys = force.keys or ("value",) * len(force.coefficients)
            for key, e in zip(keys, force.coefficients, strict=True):
                found.add(e.tree, f"forces.{force.name}.{key}")
            if not force.needs_direction:
                continue
            if isinstance(force, Torsion):
                found.add_turn(force.name)
            elif not self.loops and (line := signed_length(self.bodies, self.motion, force)) is not None:
                found.add_line(force.name, *line)
                continue
            if len(force.ends) == 2 and len({isinstance(end, Face) for end in force.ends}) == 1:
                found.add_ends(force.ends, force.axis, f"forces.{force.name}")
        for i, output in enumerate(self.outputs):
            if output.expression is not None:
                found.add(output.expression.tree, f"outputs.{output.name}.value", i)
            elif output.measure == Distance.name:
                found.add_ends(output.points, None, f"outputs.{output.name}", i)
        return found

    @cached_property
    def defaults(self) -> dict[str, float]:
        """Default values of the parameters by name."""
        return {p.name: p.value for p in self.parameters}

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in array order."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def initial_depends_on_parameters(self) -> bool:
        """Whether initial values depend on parameters, and so have derivatives."""
        given = (*self.initial_q.values(), *self.initial_u.values())
        return any(e.names & set(self.parameter_names) for e in given)

    @property
    def points_depend_on_parameters(self) -> bool:
        """Whether parameters move a named point in its body."""
        return any(e.names for point in self.points for e in point.at)

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return len(self.coordinate_names)

    @property
    def nu(self) -> int:
        """Number of speeds."""
        return len(self.speed_names)

    @cached_property
    def coordinate_slices(self) -> tuple[tuple[slice, slice], ...]:
        """Places of the coordinates and speeds of each body's joint in q and u."""
        result, i, j = [], 0, 0
        for b in self.bodies:
            q, u = (sum(n not in self.motion for n in of) for of in joint_coordinates(b.name, b.joint.type))
            result.append((slice(i, i + q), slice(j, j + u)))
            i, j = i + q, j + u
        return tuple(result)

    @cached_property
    def quaternions(self) -> tuple[tuple[int, slice], ...]:
        """Bodies whose joints have a quaternion, and its place in q."""
        return tuple(
            (k, slice(q.start + place.start, q.start + place.stop))
            for k, (b, (q, _)) in enumerate(zip(self.bodies, self.coordinate_slices, strict=True))
            for place in b.joint.kind.quaternions
        )

    @cached_property
    def outward(self) -> tuple[int, ...]:
        """Indices of the bodies, every parent before its children, each subtree contiguous (depth first)."""
        return tuple(outward(self.bodies)[1])

    def expressions(self) -> Iterator[Expression]:
        """Iterate over every expression of the model; shared ones appear as often as they are used.

        Returns
        -------
        iterator of Expression
            The expressions.

        Examples
        --------
        >>> import ordernm
        >>> sum(1 for _ in ordernm.load_model("examples/pendulum.yaml").expressions()) > 0
        True
        """
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
