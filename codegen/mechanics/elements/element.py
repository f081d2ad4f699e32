"""The interface of force laws: wrenches at the attachment points, and potential energy.

A law is written once, as values; its tangents and transposes follow from its statements (`loads`). Vectors are along the ground's
axes unless stated otherwise.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from functools import cached_property
from typing import NamedTuple

from ...model.grammar import Tree
from ...program import algebra
from ...program.algebra import Expr, Number, Symbol
from ...program.block import Expansion, FieldError, Scope
from ...program.digits import long_number
from ...program.limits import limits
from ...program.scalar import Matrix, Value, Vector
from ...program.store import Store
from .. import fields
from ..formulas import slopes_of
from ..spatial import add, cross, dot, is_zero, matmul, matvec, minus, transpose
from ..stores import COEFFICIENT, DRIVE, ELEMENT_CONSTANTS, ENDS, PIVOT
from ..structure.constants import written
from ..structure.element_kinds import ElementKind, end_name

SHORTEST = 1e-100
"""Shortest length, m, at which a line has a direction; below it, the square of a quotient by the length can
overflow."""


def shortest() -> float:
    """`SHORTEST` for the scalar type of the generated code."""
    return limits().tiny(SHORTEST, 3)


class Wrench(NamedTuple):
    """Wrench on a body at an attachment point: a force through the point, N, and a torque, N m.

    `in_link`: both are along the axes of the link instead of the ground's.
    """

    force: Vector | None = None
    torque: Vector | None = None
    in_link: bool = False


class Law(ABC):
    """The force law of a type of force elements."""

    @abstractmethod
    def wrenches(self, e: Element) -> Sequence[Wrench]:
        """The wrench on each body, in the order of the attachment points."""

    def energy(self, e: Element) -> Value:
        """Potential energy of the element, J, if its type has one."""
        raise TypeError(f"{type(self).__name__} has no energy")


class End:
    """An attachment point of a force element, or a point that its formulas read; each quantity is computed on first use.

    Parameters
    ----------
    e : Element
    number : int
        Index among the points of the element.

    Attributes
    ----------
    is_face : bool
        The element uses axes at this point.
    is_grounded : bool
    """

    def __init__(self, e: Element, number: int):
        self._e = e
        self._name = end_name(number)
        self.is_face = e.kind.oriented[number]
        self.link: Store = ENDS[e.kind.ends[number]]
        self.is_grounded = e.kind.grounded[e.kind.ends[number]]

    @cached_property
    def arm(self) -> Vector:
        """Vector from the link's origin to the point, along the link's axes, m."""
        return self._e.x.load(ELEMENT_CONSTANTS, fields.face_place(self._name))

    @property
    def attitude(self) -> Matrix:
        """Rotation matrix of the link: ground from link components."""
        return self._e.x.load(self.link, fields.attitude)

    @cached_property
    def position(self) -> Vector:
        """Position of the point along the ground's axes, m."""
        e, arm = self._e, self.arm
        moved = matvec(self.attitude, arm)
        return [e.let("point", v) for v in add(e.x.load(self.link, fields.position), moved)]

    @cached_property
    def velocity(self) -> Vector:
        """Velocity of the point along the ground's axes, m/s."""
        e = self._e
        v, w = (e.x.load(self.link, half) for half in (fields.applied_twist.linear, fields.applied_twist.angular))
        own = [e.let("own", c) for c in add(v, cross(w, self.arm))]
        return [e.let("speed", c) for c in matvec(self.attitude, own)]

    @cached_property
    def angular_velocity(self) -> Vector:
        """Angular velocity of the link, rad/s."""
        w = self._e.x.load(self.link, fields.applied_twist.angular)
        return [self._e.let("omega", c) for c in matvec(self.attitude, w)]

    @cached_property
    def axes(self) -> Matrix:
        """Base vectors of the face, as columns; column `Element.axis` is the element's axis."""
        F = self._e.x.load(ELEMENT_CONSTANTS, fields.face_axes(self._name))
        return [[self._e.let("face", c) for c in row] for row in matmul(self.attitude, F)]

    def from_face(self, v: Vector) -> Vector:
        """Components along the link's axes of a vector given along the axes of the face."""
        e = self._e
        return [e.let("own", c) for c in matvec(e.x.load(ELEMENT_CONSTANTS, fields.face_axes(self._name)), v)]


class Element:
    """A kind of force elements in a block; laws are written with it.

    Attributes
    ----------
    x : Scope
    kind : ElementKind
    ends : list of End
        Its attachment points, then the points that its coefficients read.
    axis : int
        Index of the base vector of the faces that lies along the element's axis.
    slopes : dict of Symbol to list of (Expr, Expr)
        For formulas whose derivatives may be infinite: their operands, and the derivatives with respect to these.
    """

    def __init__(self, x: Scope, kind: ElementKind):
        self.x = x
        self.kind = kind
        self.axis = kind.axis
        self._tag = kind.first.type
        self._known: dict[int, Value] = {}
        self._required = 0
        self.slopes: dict[Symbol, list[tuple[Expr, Expr]]] = {}
        self.ends = [End(self, i) for i in range(len(kind.ends))]

    def let(self, name: str, value: Value) -> Value:
        """Gives a name to an intermediate value."""
        return self.x.let(name, value, self._tag)

    def vector(self, name: str, v: Sequence[Value]) -> Vector:
        """Named intermediate values, one for each component of a vector."""
        return [self.let(name, c) for c in v]

    def coefficient(self, key: str) -> Value:
        """The coefficient with this key in the model file."""
        return self._coefficients_of({key}, key)[0]

    @property
    def absent(self) -> dict[str, int]:
        """Keys of coefficients that are zero for every element of the kind."""
        return {
            key: 0 for key, form in zip(self.kind.first.keys, self.kind.forms, strict=False) if form == ("number", 0)
        }

    def coefficients(self, key: str) -> Vector:
        """The coefficients in a list of the model file, by the key of the list."""
        return self._coefficients_of({name for name in self.kind.first.keys if name.startswith(f"{key}[")}, key)

    def _coefficients_of(self, keys: Collection[str], key: str) -> list[Value]:
        first = self.kind.first
        found = [self._coefficient(j) for j, name in enumerate(first.keys) if name in keys]
        if not found:
            raise FieldError(
                f"{self._tag}: {type(first).__name__} has no coefficient {key}; it has {', '.join(first.keys)}"
            )
        return found

    def _coefficient(self, j: int) -> Value:
        if j not in self._known:
            self._known[j] = self.formula(self.kind.forms[j], self._leaf)
        return self._known[j]

    def turned(self, angle: Value) -> Value:
        """An angle plus a number of whole turns, so that it differs by at most half a turn from the mode of its switch.
        During an integration step the mode is constant, so the angle does not jump."""
        return self.let("turned", self.x.call("held_turn", angle, self._mode))

    @property
    def turns_over(self) -> bool:
        """Whether the attachment points move on one fixed line and can pass each other."""
        return len(self.kind.forms) > len(self.kind.first.keys)

    @property
    def _mode(self) -> Value:
        return self._coefficient(len(self.kind.first.keys))

    @property
    def _direction(self) -> Vector:
        """Direction of a line whose ends may pass each other, along the ground's axes."""
        axis = [long_number(form[1]) for form in self.kind.forms[-3:]]
        if axis.count(0) == 2:
            return [int(v) for v in axis]
        size = sum(v * v for v in axis) ** 0.5
        return [Number(v / size) if v else 0 for v in axis]

    def _signed(self, line: Vector) -> Value:
        """Signed length of a line whose ends can pass each other; components across its direction are rounding
        errors."""
        return self.let("way", dot(line, self._direction))

    def along(self, line: Vector, length: Value) -> Vector:
        """The direction of the line between the first two ends."""
        if self.turns_over:
            sign = self.x.call("held_sign", self._signed(line), self._mode)
            return [0 if is_zero(c) else self.let("along", sign * c) for c in self._direction]
        inverse = self.let("inverse", 1 / length)
        return self.vector("along", [c * inverse for c in line])

    def require(self, value: Value) -> None:
        """Require that a value be positive, since otherwise the element has no direction; see `ForceElement.singular`.

        Raises
        ------
        FieldError
            The type of element has no message (`singular`) for states without a direction.
        """
        if not self.kind.first.singular:
            name = type(self.kind.first).__name__
            raise FieldError(
                f"{self._tag} needs a direction, and {name}.singular has no message for states without one"
            )
        self.x.set_entry(PIVOT, self._required, value)
        self._required += 1

    def way(self) -> Vector:
        """Vector from the first end to the second."""
        start, end = (end.position for end in self.ends[:2])
        return self.vector("line", minus(end, start))

    def line(self, directed: bool = True) -> tuple[Vector, Value]:
        """Vector from the first end to the second, and the distance.

        `directed`: require that the distance be positive, since the direction or a derivative of the length is used.
        """
        line = self.way()
        if self.turns_over:
            signed, mode = self._signed(line), self._mode
            if directed:
                self.require(self.let("square", signed * signed) + mode * mode - self.x.number(shortest() ** 2))
            return line, self.let("length", self.x.call("held_abs", signed, mode))
        square = self.let("square", dot(line, line))
        if directed:
            self.require(square - self.x.number(shortest() ** 2))
        return line, self.let("length", self.x.sqrt(square))

    # -- coefficients ----------------------------------------------------------------------------------------------

    def formula(self, tree: Tree, leaf: Callable[[Tree], Value]) -> Value:
        """The value of a tree of the expression grammar; `leaf` gives the values of its names."""
        value = self.x.let("value", written(self.x, tree, leaf))
        if isinstance(self.x, Expansion) and self.x.tangents and (slopes := slopes_of(tree)) is not None:
            sign, symbol = algebra.coefficient(algebra.expression(value))
            if isinstance(symbol, Symbol):
                parts = [(leaf(of), written(self.x, d, leaf)) for of, d in slopes]
                self.slopes[symbol] = [(algebra.expression(of), sign * algebra.expression(d)) for of, d in parts]
        return value

    def _leaf(self, tree: Tree) -> Value:
        what = tree[1]
        if what == "coefficient":
            return self.x.entry(COEFFICIENT if self.kind.first.has_energy else DRIVE, tree[2])
        end = self.ends[tree[2]]
        return (end.position if what == "position" else end.velocity)[tree[3]]

    # -- forces on links ---------------------------------------------------------------------------------------------

    def on_links(self, wrenches: Sequence[Wrench]) -> list[tuple[Store, Vector]]:
        """Moment about the origin and force on each link, along its axes; the ground is left out."""
        found = []
        ends = self.ends[: len(self.kind.first.ends)]
        if len(wrenches) != len(ends):
            raise FieldError(f"{self._tag}: its law gives {len(wrenches)} wrenches for {len(ends)} ends")
        for end, wrench in zip(ends, wrenches, strict=True):
            if end.is_grounded:
                continue
            force: Vector = [0, 0, 0]
            moment: Vector = [0, 0, 0]
            if wrench.force is not None:
                force = self._own(end, wrench.force, wrench.in_link)
                moment = self.vector("moment", cross(end.arm, force))
            if wrench.torque is not None:
                torque = self._own(end, wrench.torque, wrench.in_link)
                moment = torque if all(map(is_zero, moment)) else self.vector("moment", add(moment, torque))
            found.append((end.link, [*moment, *force]))
        return found

    def _own(self, end: End, v: Vector, in_link: bool) -> Vector:
        return v if in_link else self.vector("acting", matvec(transpose(end.attitude), v))
