"""Fields: the quantities in a store, with shape, unit, frame and meaning.

A family has a field for each of several numbered objects: ``Z_w(3)`` is the field of the third. Blocks refer to *components* by
strings such as ``w.x`` and ``Z3.w.x``, to which the layout assigns places. The tables of fields are in
`codegen.mechanics.fields`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import ClassVar, Generic, Self, TypeVar

from .scalar import Matrix, Value, Vector

XYZ = "xyz"
PAIRS = ("xx", "yy", "zz", "xy", "xz", "yz")
NINE = tuple(a + b for a in XYZ for b in XYZ)
PLACES = tuple((XYZ.index(pair[0]), XYZ.index(pair[1])) for pair in PAIRS)
"""Row and column of each of `PAIRS`."""

V = TypeVar("V")
V_co = TypeVar("V_co", covariant=True)
F = TypeVar("F", bound="AnyField")
Read = Callable[[str], Value]
"""A function that returns the value of a component."""


class Readable(ABC, Generic[V_co]):
    """A field, or (with ``{}`` in its name) a family of fields, that can be read.

    Attributes
    ----------
    name : str
        Beginning of its components' names.
    unit, frame, meaning : str
        For the glossary. The frame gives the axes of the components; empty for scalars.
    propagated : bool
        Whether other units add to the field. If there are no such units, the field is zero and is not stored.
    unread : str
        The reason why a stored value may remain unread in some models. If empty, a value that is stored and never read is
        an internal error (`mechanics.expansion`).
    """

    shape = ""
    ends: ClassVar[Sequence[str]] = ("",)
    """Suffixes that are appended to the field's name to give the names of its components."""
    called: str
    """Name in generated code, without the endings of components; for listed fields."""

    def __init__(self, name: str, unit: str, frame: str, meaning: str, *, propagated: bool = False, unread: str = ""):
        self.name = name
        self.unit = unit
        self.frame = frame
        self.meaning = meaning
        self.propagated = propagated
        self.unread = unread
        self.family: AnyField = self
        self.suffix = ""
        self.listed = False
        self.called = ""
        self._members: dict[object, Self] = {}

    def __call__(self, *numbers: int | str) -> Self:
        """The member of a family; the same object each time."""
        found = self._members.get(numbers)
        if found is None:
            found = self._member(self.name.format(*numbers))
            self._members[numbers] = found
        return found

    def derivative(self, parameter: int) -> Self:
        """The field of the derivative of a constant with respect to one of its design parameters."""
        found = self._members.get(f"/{parameter}")
        if found is None:
            found = self._member(self.name)
            found.suffix = f"/{parameter}"
            self._members[f"/{parameter}"] = found
        return found

    def _member(self, name: str) -> Self:
        member = type(self)(name, self.unit, self.frame, self.meaning, propagated=self.propagated)
        member.family = self.family
        return member

    @property
    def shown(self) -> tuple[str, ...]:
        """Readable name of the field."""
        return (self.name,)

    @cached_property
    def components(self) -> tuple[str, ...]:
        """Names of the components."""
        return tuple(f"{self.name}{end}{self.suffix}" for end in self.ends)

    @property
    def identifiers(self) -> tuple[str, ...]:
        """Names of the components in generated code, in order; in families, numbers are ``{}``."""
        rest = (c.removeprefix(self.name) for c in self.components)
        return tuple(f"{self.called}{end}".replace(".", "_") for end in rest)

    @abstractmethod
    def read(self, read: Read) -> V_co:
        """The value of the field, from the values of its components."""

    def scalars(self) -> tuple[ScalarField, ...]:
        """The components as separate fields; the same objects each time."""
        return self._scalars

    @cached_property
    def _scalars(self) -> tuple[ScalarField, ...]:
        return tuple(self._part(ScalarField, name) for name in self.components)

    def _part(self, of: type[F], name: str) -> F:
        """A field that consists of selected components of this one."""
        part = of(name, self.unit, self.frame, self.meaning, propagated=self.propagated)
        part.family = self.family
        return part

    def __repr__(self) -> str:
        return self.name


AnyField = Readable[object]
"""A field of any shape, in annotations."""


class Field(Readable[V], Generic[V]):
    """A field that blocks can write as well as read."""

    @abstractmethod
    def parts(self, value: V) -> Iterator[tuple[str, Value]]:
        """The components of the field, each with its part of a value."""


class ScalarField(Field[Value]):
    """A scalar: one number."""

    shape = "scalar"

    def read(self, read: Read) -> Value:
        return read(self.components[0])

    def parts(self, value: Value) -> Iterator[tuple[str, Value]]:
        yield self.components[0], value


class Listed(Field[Vector]):
    """A field whose value is the list of its components."""

    def read(self, read: Read) -> Vector:
        return [read(c) for c in self.components]

    def parts(self, value: Vector) -> Iterator[tuple[str, Value]]:
        yield from zip(self.components, value, strict=True)


class VectorField(Listed):
    """A vector: three components."""

    shape = "vector"
    ends = tuple(f".{i}" for i in XYZ)


class MatrixField(Field[Matrix]):
    """A 3x3 matrix, stored by rows."""

    shape = "3x3 matrix"
    ends = tuple(f".{ij}" for ij in NINE)

    def read(self, read: Read) -> Matrix:
        values = [read(c) for c in self.components]
        return [values[:3], values[3:6], values[6:]]

    def parts(self, value: Matrix) -> Iterator[tuple[str, Value]]:
        yield from zip(self.components, (v for row in value for v in row), strict=True)


class SymmetricField(Field[Matrix]):
    """A symmetric matrix: six components, xx, yy, zz, xy, xz, yz."""

    shape = "symmetric 3x3 matrix"
    ends = tuple(f".{ij}" for ij in PAIRS)

    def read(self, read: Read) -> Matrix:
        xx, yy, zz, xy, xz, yz = (read(c) for c in self.components)
        return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]

    def parts(self, value: Matrix) -> Iterator[tuple[str, Value]]:
        for component, (i, j) in zip(self.components, PLACES, strict=True):
            yield component, value[i][j]


class SixField(Listed):
    """A moment and a force. The names of its two vectors, `halves`, are appended to its own: ``acc.`` has ``acc.n.x`` ...
    ``acc.f.z``."""

    shape = "six components"
    halves = ("n", "f")
    called_halves = ("moment", "force")

    @property
    def shown(self) -> tuple[str, ...]:
        return tuple(f"{self.name}{half}" for half in self.halves)

    @cached_property
    def angular(self) -> VectorField:
        """The first three components: moment, angular velocity or angular acceleration."""
        return self._part(VectorField, f"{self.name}{self.halves[0]}")

    @cached_property
    def linear(self) -> VectorField:
        """The last three components: force, velocity or acceleration of the origin."""
        return self._part(VectorField, f"{self.name}{self.halves[1]}")

    @cached_property
    def components(self) -> tuple[str, ...]:
        return tuple(f"{self.name}{half}.{i}" for half in self.halves for i in XYZ)

    @property
    def identifiers(self) -> tuple[str, ...]:
        prefix = f"{self.called}_" if self.called else ""
        return tuple(f"{prefix}{half}_{i}" for half in self.called_halves for i in XYZ)


class AccelerationField(SixField):
    """Angular acceleration, then acceleration of the origin."""

    halves = ("al", "a")
    called_halves = ("alpha", "acceleration")


class TwistField(SixField):
    """Angular velocity, then velocity of the origin."""

    halves = ("w", "v")
    called_halves = ("omega", "velocity")


class ShiftField(SixField):
    """Rotation vector, then displacement of the origin."""

    halves = ("t", "d")
    called_halves = ("rotation", "displacement")


class EarShiftField(SixField):
    """Rotation vector, then displacement, for links of ears; the components have other names than those of
    `ShiftField`."""

    halves = ("th", "d")
    called_halves = ("rotation", "displacement")


class BlockField(Field[Matrix]):
    """A 6x6 matrix, stored by rows."""

    shape = "6x6 matrix"
    ends = tuple(f"{i}{k}" for i in range(6) for k in range(6))

    @property
    def shown(self) -> tuple[str, ...]:
        return (f"{self.name}{{}}{{}}",)

    def read(self, read: Read) -> Matrix:
        values = [read(c) for c in self.components]
        return [values[i : i + 6] for i in range(0, 36, 6)]

    def parts(self, value: Matrix) -> Iterator[tuple[str, Value]]:
        yield from zip(self.components, (v for row in value for v in row), strict=True)
