"""What a type of force elements does, as blocks write it: wrenches at its ends, and its potential energy.

A law is written once, as values; tangents and transposes follow from its statements (see `loads`). Vectors are in the ground
frame unless it says that they are in the axes of a link.
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
"""Of a line, m, that has a direction: squares of what is divided by its length stay finite."""


def shortest() -> float:
    """The same for the scalar type at hand."""
    return limits().tiny(SHORTEST, 3)


class Wrench(NamedTuple):
    """What acts on a body at an end: a force through the end's place, N, and a torque, N m.

    `in_link` says that they are in the axes of the link, not of the ground.
    """

    force: Vector | None = None
    torque: Vector | None = None
    in_link: bool = False


class Law(ABC):
    """A type of force elements."""

    @abstractmethod
    def wrenches(self, e: Element) -> Sequence[Wrench]:
        """What acts on the bodies, end by end."""

    def energy(self, e: Element) -> Value:
        """Potential energy, J, of a type that has one."""
        raise TypeError(f"{type(self).__name__} has no energy")


class End:
    """An end of a force element, or a point that it looks at; what is asked for is computed once.

    Parameters
    ----------
    e : Element
    number : int
        Among the ends of the element.

    Attributes
    ----------
    is_face : bool
        It has axes of its own.
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
        """From the link's origin, in its axes, m."""
        return self._e.x.load(ELEMENT_CONSTANTS, fields.face_place(self._name))

    @property
    def attitude(self) -> Matrix:
        """Of the link: ground components from its own."""
        return self._e.x.load(self.link, fields.attitude)

    @cached_property
    def position(self) -> Vector:
        """m."""
        e, arm = self._e, self.arm
        moved = matvec(self.attitude, arm)
        return [e.let("point", v) for v in add(e.x.load(self.link, fields.position), moved)]

    @cached_property
    def velocity(self) -> Vector:
        """m/s."""
        e = self._e
        v, w = (e.x.load(self.link, half) for half in (fields.applied_twist.linear, fields.applied_twist.angular))
        own = [e.let("own", c) for c in add(v, cross(w, self.arm))]
        return [e.let("speed", c) for c in matvec(self.attitude, own)]

    @cached_property
    def angular_velocity(self) -> Vector:
        """rad/s."""
        w = self._e.x.load(self.link, fields.applied_twist.angular)
        return [self._e.let("omega", c) for c in matvec(self.attitude, w)]

    @cached_property
    def axes(self) -> Matrix:
        """Base vectors of a face, as columns. One of them, `Element.axis`, is the element's axis."""
        F = self._e.x.load(ELEMENT_CONSTANTS, fields.face_axes(self._name))
        return [[self._e.let("face", c) for c in row] for row in matmul(self.attitude, F)]

    def from_face(self, v: Vector) -> Vector:
        """A vector given in the axes of a face, in those of the link."""
        e = self._e
        return [e.let("own", c) for c in matvec(e.x.load(ELEMENT_CONSTANTS, fields.face_axes(self._name)), v)]


class Element:
    """A kind of force elements in a block: what laws are written with.

    Attributes
    ----------
    x : Scope
    kind : ElementKind
    ends : list of End
        Where it acts, then the points that its coefficients look at.
    axis : int
        Which base vector of its faces is its axis.
    slopes : dict of Symbol to list of (Expr, Expr)
        Of formulas whose derivatives may be infinite: operands, and the derivatives by them.
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
        """A name for an intermediate."""
        return self.x.let(name, value, self._tag)

    def vector(self, name: str, v: Sequence[Value]) -> Vector:
        """The same for each component."""
        return [self.let(name, c) for c in v]

    def coefficient(self, key: str) -> Value:
        """The coefficient with that key in the model file."""
        return self._coefficients_of({key}, key)[0]

    @property
    def absent(self) -> dict[str, int]:
        """The keys of coefficients that are zero for the whole kind, with that number."""
        return {
            key: 0 for key, form in zip(self.kind.first.keys, self.kind.forms, strict=False) if form == ("number", 0)
        }

    def coefficients(self, key: str) -> Vector:
        """Those of a list."""
        return self._coefficients_of({name for name in self.kind.first.keys if name.startswith(f"{key}[")}, key)

    def _coefficients_of(self, keys: Collection[str], asked: str) -> list[Value]:
        first = self.kind.first
        found = [self._coefficient(j) for j, name in enumerate(first.keys) if name in keys]
        if not found:
            raise FieldError(
                f"{self._tag}: {type(first).__name__} has no coefficient {asked}, but {', '.join(first.keys)}"
            )
        return found

    def _coefficient(self, j: int) -> Value:
        if j not in self._known:
            self._known[j] = self.formula(self.kind.forms[j], self._leaf)
        return self._known[j]

    def turned(self, angle: Value) -> Value:
        """An angle that jumps at half a turn, within half a turn of its mode."""
        return self.let("turned", self.x.call("held_turn", angle, self._mode))

    @property
    def turns_over(self) -> bool:
        """Its ends move along one line, and may pass each other."""
        return len(self.kind.forms) > len(self.kind.first.keys)

    @property
    def _mode(self) -> Value:
        return self._coefficient(len(self.kind.first.keys))

    @property
    def _direction(self) -> Vector:
        """Of a line that turns over, as components in the ground frame."""
        axis = [long_number(form[1]) for form in self.kind.forms[-3:]]
        if axis.count(0) == 2:
            return [int(v) for v in axis]
        size = sum(v * v for v in axis) ** 0.5
        return [Number(v / size) if v else 0 for v in axis]

    def _signed(self, line: Vector) -> Value:
        """The length of a line that turns over, with a sign; what is across its direction is rounding."""
        return self.let("way", dot(line, self._direction))

    def along(self, line: Vector, length: Value) -> Vector:
        """The direction of the line between the first two ends."""
        if self.turns_over:
            sign = self.x.call("held_sign", self._signed(line), self._mode)
            return [0 if is_zero(c) else self.let("along", sign * c) for c in self._direction]
        inverse = self.let("inverse", 1 / length)
        return self.vector("along", [c * inverse for c in line])

    def require(self, value: Value) -> None:
        """Must be positive for the element to have a direction; see `ForceElement.singular`.

        Raises
        ------
        FieldError
            The element does not say when it has none, so nobody could be told.
        """
        if not self.kind.first.singular:
            name = type(self.kind.first).__name__
            raise FieldError(f"{self._tag} needs a direction, and {name}.singular does not say when there is none")
        self.x.set_entry(PIVOT, self._required, value)
        self._required += 1

    def line(self, directed: bool = True) -> tuple[Vector, Value]:
        """From the first end to the second, and the distance.

        `directed`: without length the line has no direction, nor its length a derivative, which is an error.
        """
        start, end = (end.position for end in self.ends[:2])
        line = self.vector("line", minus(end, start))
        if self.turns_over:  # its ends may pass each other
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
        """The value of a tree of the expression grammar, whose names have the values that `leaf` gives."""
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

    # -- what acts -------------------------------------------------------------------------------------------------

    def on_links(self, wrenches: Sequence[Wrench]) -> list[tuple[Store, Vector]]:
        """Moment about the origin and force on each link, in its axes; nothing of the ground."""
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
